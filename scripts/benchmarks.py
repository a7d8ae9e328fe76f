"""Every claim of speed beside its peers, same work, same minute, and the page results/benchmarks.md.

    python scripts/benchmarks.py [--only hd95,rigid] [--out results] [--resume] [--quick]

Each claim is measured in a process of its own, on one core and with one thread, ours and the peers in turn. Peers that
are not installed are named on the page with the line that installs them. --resume takes what earlier calls have
measured (outputs/benchmarks/measured; the page names their commits), and measures the rest. --quick shows that all of
it runs: one round of small problems, no ratio, into outputs/benchmarks/quick.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from quick_budget import REPOSITORY, parsed

# Module and function of each claim, with what the function takes before ``quick``; in the order of the page.
CLAIMS: dict[str, tuple[str, ...]] = {
    "drift": ("claims_registration", "drift"),
    "drift_small": ("claims_registration", "drift_small"),
    "rigid": ("claims_registration", "rigid"),
    "hd95": ("claims_segmentation", "hd95"),
    "hd95_surfel": ("claims_segmentation", "hd95_surfel"),
    "closing": ("claims_segmentation", "closing"),
    "mesh_distance": ("claims_registration", "mesh_distance"),
    "step_unet": ("claims_segmentation", "step", "unet"),
    "step_attention_unet": ("claims_segmentation", "step", "attention_unet"),
    "step_unet3plus": ("claims_segmentation", "step", "unet3plus"),
    "training": ("claims_segmentation", "training"),
    "inference": ("claims_segmentation", "inference"),
    "simulator": ("claims_framework", "simulator"),
    "reconstruction": ("claims_registration", "reconstruction"),
    "pipeline": ("claims_framework", "pipeline"),
    "help": ("claims_framework", "help_page"),
    "metrics": ("claims_framework", "metrics_logged"),
    "composing": ("claims_mended", "composing"),
    "contours": ("claims_mended", "contours"),
    "borders": ("claims_mended", "borders"),
    "figures": ("claims_mended", "figures"),
}
PROFILE = "profile"
# Read by numerical libraries when they are imported.
ONE_THREAD = dict.fromkeys(
    (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"),
        *("VTK_SMP_MAX_THREADS", "TBB_NUM_THREADS"),
    ),
    "1",
) | {"OMP_WAIT_POLICY": "PASSIVE"}


def claim_of(name: str) -> Callable[[bool], Any]:
    """Find what makes a claim.

    Parameters
    ----------
    name : str
        One of ``CLAIMS``.

    Returns
    -------
    callable
        Takes whether a small budget is enough, returns the claim.
    """
    module, function, *given = CLAIMS[name]
    return partial(getattr(importlib.import_module(module), function), *given)


def on_one_core() -> None:
    """Keep this process and its children to one core, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def child(name: str, quick: bool, out: Path) -> None:
    """Measure one claim, or the profiles, in this process.

    Parameters
    ----------
    name : str
        Name of the claim.
    quick : bool
        Whether a small budget is enough.
    out : Path
        File that gets the result, as JSON.
    """
    from side_by_side import measure

    on_one_core()
    if name == PROFILE:
        from pipeline_profile import profile_pipeline

        work = Path(os.environ["CTUS_BENCH_WORK"])
        out.write_text(json.dumps(profile_pipeline(work, 1 if quick else 2, quick)))
        return
    out.write_text(json.dumps(measure(claim_of(name)(quick)).as_plain()))


def apart(name: str, quick: bool, work: Path) -> dict[str, Any] | str:
    """Measure one claim in a process of its own.

    Parameters
    ----------
    name : str
        Name of the claim.
    quick : bool
        Whether a small budget is enough.
    work : Path
        Folder that is kept from one claim to the next.

    Returns
    -------
    dict or str
        The result, or why there is none.
    """
    with tempfile.TemporaryDirectory() as folder:
        out, temporary = Path(folder) / "found.json", Path(folder) / "temporary"
        temporary.mkdir()
        places = {"CTUS_BENCH_WORK": str(work), "CTUS_HOME": str(work), "TMPDIR": str(temporary)}
        words = [
            sys.executable,
            __file__,
            "--child",
            name,
            "--out",
            str(out),
            *(["--quick"] if quick else []),
        ]
        begin_s = time.perf_counter()
        done = subprocess.run(
            words, capture_output=True, text=True, env={**os.environ, **ONE_THREAD, **places}, check=False
        )
        print(f"{name}: {time.perf_counter() - begin_s:.0f} s", file=sys.stderr, flush=True)
        if done.returncode or not out.is_file():
            lines = done.stderr.strip().splitlines() or ["ended without a word"]
            print("\n".join(lines[-12:]), file=sys.stderr)
            return f"{name}: not measured, {lines[-1]}"
        found: dict[str, Any] = json.loads(out.read_text())
        return found


def kept_or_measured(name: str, quick: bool, work: Path, commit: str, resume: bool) -> dict[str, Any] | str:
    """Take what an earlier call has measured, or measure, and keep it.

    Parameters
    ----------
    name : str
        Name of the claim.
    quick : bool
        Whether a small budget is enough.
    work : Path
        Folder that keeps results.
    commit : str
        Commit of the code that runs.
    resume : bool
        Whether earlier results are taken.

    Returns
    -------
    dict or str
        ``found``, ``commit`` and ``date``; or why there is no result.
    """
    path = work / ("measured_quick" if quick else "measured") / f"{name}.json"
    if resume and path.is_file():
        kept: dict[str, Any] = json.loads(path.read_text())
        return kept
    date = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
    found = apart(name, quick, work)
    if isinstance(found, str):
        return found
    made = {"commit": commit, "date": date, "found": found}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(made))
    return made


def main() -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", help=f"of {','.join([*CLAIMS, PROFILE])}")
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder of the page")
    parser.add_argument("--resume", action="store_true", help="take what earlier calls have measured")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parsed(parser, {"out": Path("outputs/benchmarks/quick")})
    if given.child:
        child(given.child, given.quick, given.out)
        return 0
    names = given.only.split(",") if given.only else [*CLAIMS, PROFILE]
    unknown = sorted(set(names) - {*CLAIMS, PROFILE})
    if unknown:
        parser.error(f"--only: expected of {', '.join([*CLAIMS, PROFILE])}, received {', '.join(unknown)}")
    return measured_page(names, given)


def measured_page(names: list[str], given: argparse.Namespace) -> int:
    """Measure claims and write their page; 1 where one could not be measured."""
    from benchmark_page import machine, page_text, ratio_figure, rows_of, shown_table
    from side_by_side import Measured

    from experiments.analysis.pages.page_parts import save_page_figure
    from experiments.provenance import running_commit

    commit, work = running_commit(), (REPOSITORY / "outputs" / "benchmarks").resolve()
    work.mkdir(parents=True, exist_ok=True)
    every = {name: kept_or_measured(name, given.quick, work, commit, given.resume) for name in names}
    failed = [each for each in every.values() if isinstance(each, str)]
    kept = {name: each for name, each in every.items() if not isinstance(each, str)}
    measured = [
        replace(Measured.of_plain(each["found"]), commit=each["commit"], date=each["date"])
        for name, each in kept.items()
        if name != PROFILE
    ]
    profile = kept[PROFILE]["found"] if PROFILE in kept else None
    dates, commits = ({each[key] for each in kept.values() if each[key]} for key in ("date", "commit"))
    given.out.mkdir(parents=True, exist_ok=True)
    words = [word for word in sys.argv[1:] if word != "--resume"]
    head = {
        "command": " ".join(["python scripts/benchmarks.py", *words]) if words else "make bench",
        "commit": "" if not commits else f", commit {' and '.join(sorted(commits))}",
        "date": " to ".join(sorted({min(dates), max(dates)})) if dates else "nothing measured",
        "machine": machine(),
        "name": "benchmarks",
    }
    shown = page_text(measured, profile, failed, head)
    (given.out / "benchmarks.md").write_text(shown, encoding="utf-8")
    rows_of(measured).to_csv(given.out / "benchmarks.csv", index=False, float_format="%.5g")
    save_page_figure(ratio_figure(measured), given.out / "benchmarks")
    print(shown_table(measured).to_string(index=False))
    print(f"Page: {given.out / 'benchmarks.md'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
