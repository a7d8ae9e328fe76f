"""The page of ``make bench``: table, plot and profiles from what was measured, and the sentences about them."""

from __future__ import annotations

import math
import os
import platform
import re
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from side_by_side import (
    NO_DIFFERENCE,
    OURS_FASTER,
    PEER_FASTER,
    Measured,
    Times,
    conclusion,
    correct,
    installed,
    ratio_of,
    version_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKAGES = (
    *("numpy", "scipy", "torch", "lightning", "monai", "open3d", "small_gicp", "vtk", "scikit-image"),
    *("rustcpd", "rcpd", "pycpd", "kiss-matcher", "surface-distance", "onnxruntime", "hydra-core", "mlflow"),
)
HEAD = """# Speed, side by side

Made by `{command}`{commit}, {date}.

{machine}.

How to read it: within a round every side did the same work on the same problem, one after the other, in one process
on one core; the order was turned round from round to round. Seconds are medians with the least and the greatest. A
**ratio** is the peer's seconds by ours within one round: its median, least and greatest over the rounds. Above 1 ours
is faster. Nobody is called faster unless every round says so. Cores are shared with other programs, so that **ratios
count, not seconds**; `by cpu` is the same ratio in processor time, which others disturb less. A result is right where
its error is at most the limit: a fast side with wrong results has gained nothing. Libraries use one thread, which is
how this project uses them; peers that would use all cores are not shown at their best. A claim without a peer has no
ratio.

![Seconds of peers by ours]({name}.png)

"""

MENDED = """## What was mended

The rows *Mended* time today's code beside that of an earlier commit, unpacked from git, in processes of their own:

- composing a configuration: once instead of twice, with YAML parsed in C;
- contours and filters: masks are described within their boxes;
- borders of a rough surface: each looks up the triangles around it instead of going through all;
- a figure in two formats: laid out once for both.

The row *Closing of masks* has the earlier way, by distance transforms, as one of its peers. Mended without a row here:
a rough surface, such as the masks of a network that has hardly learnt make, has many small pieces, whose walls are now
sampled no finer than their triangles are wide. Nothing was mended in the three slowest stages of the table above.
"""


def _pairs(measured: Sequence[Measured]) -> Iterator[tuple[Measured, Times, Times | None]]:
    """Each claim with ours and each of its peers; None for a claim without any."""
    for claim in measured:
        ours, *peers = claim.sides
        for peer in peers or [None]:
            yield claim, ours, peer


def rows_of(measured: Sequence[Measured]) -> pd.DataFrame:
    """Make one row for each peer of each claim, and one for a claim without any.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.

    Returns
    -------
    pandas.DataFrame
        Numbers; NaN where there is none.
    """
    rows = []
    for claim, ours, peer in _pairs(measured):
        row = {"claim": claim.title, "work": claim.work, "rounds": len(ours.seconds), **_side("ours", ours)}
        row |= {"error": claim.error_name, "limit": claim.max_error}
        row["ours_right"] = correct(ours, claim.max_error)
        if peer is not None:
            row |= {"peer_version": peer.version, **_side("peer", peer)}
            row["peer_right"] = correct(peer, claim.max_error)
            ratio = ratio_of(ours, peer)
            if ratio is not None:
                row |= {"ratio": ratio.median, "ratio_low": ratio.low, "ratio_high": ratio.high}
                row["ratio_by_cpu"] = ratio.by_cpu
            row["conclusion"] = conclusion(claim, peer)
        row |= {"load_before": claim.load[0], "load_after": claim.load[1], "remarks": " ".join(claim.remarks)}
        rows.append(row)
    return pd.DataFrame(rows)


def _side(who: str, times: Times) -> dict[str, Any]:
    return {
        who: times.name,
        f"{who}_s": statistics.median(times.seconds),
        f"{who}_s_low": min(times.seconds),
        f"{who}_s_high": max(times.seconds),
        f"{who}_error": statistics.median(times.errors),
        f"{who}_error_high": max(times.errors),
    }


def shown_table(measured: Sequence[Measured]) -> pd.DataFrame:
    """Make the table of the page: a row for each peer, in words.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.

    Returns
    -------
    pandas.DataFrame
        Texts.
    """
    rows = []
    for claim, ours, peer in _pairs(measured):
        ratio = None if peer is None else ratio_of(ours, peer)
        named = "none" if peer is None else f"{peer.name} ({peer.version})" if peer.version else peer.name
        rows.append(
            {
                "claim": claim.title,
                "ours": f"{ours.name}: {_seconds(ours)}",
                "peer": named if peer is None else f"{named}: {_seconds(peer)}",
                "ratio": "-"
                if ratio is None
                else f"**{ratio.median:.2f}** ({ratio.low:.2f} to {ratio.high:.2f})",
                "by cpu": "-" if ratio is None or math.isnan(ratio.by_cpu) else f"{ratio.by_cpu:.2f}",
                "error of ours": _errors(ours, claim.max_error),
                "error of the peer": "-" if peer is None else _errors(peer, claim.max_error),
                "shows": "no peer" if peer is None else conclusion(claim, peer),
            }
        )
    return pd.DataFrame(rows)


def _seconds(times: Times) -> str:
    median = statistics.median(times.seconds)
    if len(times.seconds) < 2:
        return f"{_number(median)} s"
    return f"{_number(median)} s ({_number(min(times.seconds))} to {_number(max(times.seconds))})"


def _errors(times: Times, limit: float) -> str:
    right, of = correct(times, limit), len(times.errors)
    return f"{_number(statistics.median(times.errors))}; right {right} of {of}"


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def remarks_of(measured: Sequence[Measured]) -> list[str]:
    """Say of each claim what was done, how it was checked, and what a reader must know.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.

    Returns
    -------
    list of str
        A sentence or some for each.
    """
    return [
        f"**{claim.title}**: {claim.work}; {len(claim.sides[0].seconds)} rounds, {claim.date}, load "
        f"{claim.load[0]:.1f} before and {claim.load[1]:.1f} after. Error: {claim.error_name}, right up to "
        f"{claim.max_error:g}. " + " ".join(claim.remarks)
        for claim in measured
    ]


def findings(measured: Sequence[Measured]) -> list[str]:
    """Sum up who is faster: where ours is, where a peer is, where none is shown to be.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.

    Returns
    -------
    list of str
        Sentences.
    """
    pairs = [(claim, ours, peer) for claim, ours, peer in _pairs(measured) if peer is not None]
    said: dict[str, list[str]] = {PEER_FASTER: [], NO_DIFFERENCE: [], OURS_FASTER: []}
    for claim, ours, peer in pairs:
        ratio = ratio_of(ours, peer)
        if ratio is not None:
            wrong = correct(peer, claim.max_error) < len(peer.errors)
            note = f", right in {correct(peer, claim.max_error)} of {len(peer.errors)}" if wrong else ""
            said[ratio.verdict].append(f"{claim.title} ({peer.name}: {ratio.median:.2f}{note})")
    heads = {
        PEER_FASTER: "The peer is faster",
        NO_DIFFERENCE: "No difference is shown",
        OURS_FASTER: "Ours is faster",
    }
    return [
        f"{heads[verdict]} in {len(names)} of {len(pairs)} rows: {'; '.join(names)}."
        for verdict, names in said.items()
        if names
    ]


def ratio_figure(measured: Sequence[Measured]) -> Figure:
    """Draw the ratio of every row on a logarithmic axis, with its least and greatest.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.

    Returns
    -------
    matplotlib.figure.Figure
        A line for each peer; filled where all results of the peer are right, hollow where some are not.
    """
    from matplotlib.figure import Figure

    rows = rows_of(measured)
    rows = rows.dropna(subset=["ratio"]) if "ratio" in rows else rows.iloc[:0]
    figure = Figure(figsize=(10.0, 1.6 + 0.34 * max(len(rows), 1)), layout="constrained")
    axes = figure.add_subplot()
    # Blue and orange of Okabe and Ito, which colour-blind readers tell apart; markers differ too.
    looks = {OURS_FASTER: ("#0072B2", "o"), PEER_FASTER: ("#D55E00", "s"), NO_DIFFERENCE: ("#666666", "D")}
    for place, row in enumerate(rows.to_dict("records")):
        verdict = next(each for each in looks if str(row["conclusion"]).startswith(each))
        colour, marker = looks[verdict]
        right = row["peer_right"] == row["rounds"]
        axes.plot([row["ratio_low"], row["ratio_high"]], [place, place], color=colour, linewidth=2)
        axes.plot(
            row["ratio"],
            place,
            marker,
            color=colour,
            markerfacecolor=colour if right else "white",
            markersize=7,
        )
    for verdict, (colour, marker) in looks.items():
        axes.plot([], [], marker, color=colour, label=verdict, linestyle="-")
    axes.plot([], [], "o", color="black", markerfacecolor="white", label="peer not always right")
    axes.axvline(1.0, color="black", linewidth=1)
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), [_line_name(row) for row in rows.to_dict("records")])
    axes.invert_yaxis()
    axes.set_xlabel("Peer's time by ours (right of 1: ours faster)")
    axes.grid(axis="x", color="#dddddd")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure


def _line_name(row: dict[Any, Any]) -> str:
    peer = re.split(r", | \(|: ", str(row["peer"]))[0]
    package = str(row["peer_version"]).split(" ")[0]
    return f"{row['claim']}: {peer} ({package})" if package else f"{row['claim']}: {peer}"


def machine() -> str:
    """Describe this machine and the versions of what was measured.

    Returns
    -------
    str
        Cores, processor, system, Python, packages.
    """
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count()
    packages = ", ".join(version_of(name) for name in PACKAGES if installed(name))
    return (
        f"Machine: {cores} cores of {_processor()}, shared with other programs, {platform.system()}, "
        f"Python {platform.python_version()}; {packages}"
    )


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.is_file() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def profiles_text(profile: dict[str, Any]) -> str:
    """Write the stages of the pipeline and the functions of the slowest ones.

    Parameters
    ----------
    profile : dict
        What ``pipeline_profile.profile_pipeline`` found.

    Returns
    -------
    str
        Section in Markdown.
    """
    from experiments.running.terminal import markdown

    whole_s = statistics.median(profile["whole_s"])
    stages = pd.DataFrame(
        {
            "stage": stage,
            "seconds": f"{statistics.median(seconds):.2f} ({min(seconds):.2f} to {max(seconds):.2f})",
            "share": f"{statistics.median(seconds) / whole_s:.0%}",
        }
        for stage, seconds in sorted(profile["stages"].items(), key=lambda pair: -statistics.median(pair[1]))
    )
    tables = {f"stages of study=pipeline, {len(profile['whole_s'])} calls of {whole_s:.1f} s": stages}
    for stage, functions in profile["functions"].items():
        shown = [{**each, "share": f"{each['share']:.0%}"} for each in functions]
        tables[f"profile: {stage}"] = pd.DataFrame(shown)
    return (
        "## Profiles\n\nBy `python scripts/pipeline_profile.py`: `ctus study=pipeline phantom=artery`, in fresh "
        "processes on one core; seconds are medians with least and greatest. Of the three slowest stages the functions "
        "with most time of their own, as shares of the stage under Python's profiler, which makes Python's own calls "
        "look slower than they are. A stage of 0.00 s did not run: the deformable one is left out where the rigid "
        "registration has failed, as it does on the masks of a network that has learnt too little.\n\n"
        + markdown(tables)
    )


def page_text(
    measured: Sequence[Measured],
    profile: dict[str, Any] | None,
    failed: Sequence[str],
    head: dict[str, str],
) -> str:
    """Write the page.

    Parameters
    ----------
    measured : sequence of Measured
        The claims.
    profile : dict or None
        Profiles; None where they were left out.
    failed : sequence of str
        Sentences about claims that could not be measured.
    head : dict of str to str
        ``command``, ``commit``, ``date``, ``machine`` and ``name`` of the page.

    Returns
    -------
    str
        Markdown.
    """
    from experiments.analysis.pages.page_parts import listed
    from experiments.running.terminal import markdown

    parts = [HEAD.format(**head) + listed([*findings(measured), *failed]), ""]
    parts += [markdown({"all rows": shown_table(measured)}).replace("### all rows", "## Every row"), ""]
    parts += ["## What was done", "", listed(remarks_of(measured)), ""]
    if profile is not None:
        parts += [profiles_text(profile), MENDED]
    return "\n".join(parts).rstrip() + "\n"
