"""What the runtime study shows: each stage by phantom, the whole workflow, and what was published of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from experiments.reporting.measured import SIMULATED
from experiments.reporting.published import published
from experiments.statistics import summary
from experiments.studies.runtime.chain import ACQUISITION, PREPROCESSING, SEGMENTATION, STAGES

if TYPE_CHECKING:
    import pandas as pd

WITHOUT = "without pre-processing and segmentation"


def totals(costs: pd.DataFrame) -> pd.DataFrame:
    """Add up the stages of each repeat.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of one phantom.

    Returns
    -------
    pandas.DataFrame
        One row a repeat: ``total_s``, ``computing_s`` (without the modelled acquisition), ``frames_per_s`` of the
        computing and ``segmentation_frames_per_s`` of pre-processing and segmentation; NaN where a stage failed or
        was left out.
    """
    import pandas as pd

    rows = []
    for _, repeat in costs.groupby("repeat", sort=False):
        seconds, frames = dict(zip(repeat["stage"], repeat["seconds"], strict=True)), repeat["frames"].iloc[0]
        total_s = sum(seconds.values())
        computing_s = total_s - seconds[ACQUISITION]
        segmentation_s = sum(seconds.get(stage, np.nan) for stage in (PREPROCESSING, SEGMENTATION))
        rows.append(
            {
                "total_s": total_s,
                "computing_s": computing_s,
                "frames_per_s": frames / computing_s,
                "segmentation_frames_per_s": frames / segmentation_s,
                "peak_memory_mb": repeat["peak_memory_mb"].max(),
            }
        )
    return pd.DataFrame(rows)


def metrics(costs: pd.DataFrame) -> dict[str, float]:
    """Summarise the whole workflow and each stage; with several phantoms, each under its own name.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Returns
    -------
    dict
        Scalars by name, after ``<phantom>/`` if there are several.
    """
    found: dict[str, float] = {}
    parts = list(phantoms(costs))
    for name, part in parts:
        each, place = totals(part), f"{name}/" if len(parts) > 1 else ""
        own = summary("total_s", each["total_s"].tolist())
        for column in ("computing_s", "frames_per_s", "segmentation_frames_per_s", "peak_memory_mb"):
            if each[column].notna().any():
                own[f"{column}_median"] = float(np.median(each[column]))
        for stage, rows in _stages(part):
            own[f"{stage}_s_median"] = float(np.median(rows["seconds"]))
        own["tre_mm"] = float(part["tre_mm"].iloc[0])
        found |= {f"{place}{key}": value for key, value in own.items()}
    return found


def tables(costs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Tabulate the whole workflow of each phantom and its stages.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Returns
    -------
    dict
        Two tables by title.
    """
    import pandas as pd

    stages = [
        {
            "phantom": name,
            "stage": f"{stage} (modelled)" if rows["modelled"].all() else stage,
            "seconds": float(np.median(rows["seconds"])),
            "lowest": rows["seconds"].min(skipna=False),
            "highest": rows["seconds"].max(skipna=False),
            "peak_memory_mb": rows["peak_memory_mb"].median(),
            "data": _data(rows),
        }
        for name, part in phantoms(costs)
        for stage, rows in _stages(part)
    ]
    return {
        "runtime of the workflow": pd.DataFrame([_workflow(name, part) for name, part in phantoms(costs)]),
        "runtime by stage": pd.DataFrame(stages),
    }


def _workflow(name: str, costs: pd.DataFrame) -> dict[str, object]:
    each = totals(costs)
    return {
        "phantom": name,
        "frames": int(costs["frames"].iloc[0]),
        "total_s": _spread(each["total_s"]),
        "computing_s": _spread(each["computing_s"]),
        "frames_per_s": float(np.median(each["frames_per_s"])),
        "peak_memory_mb": float(np.median(each["peak_memory_mb"])),
        "without": ", ".join(
            [*([] if has_segmentation(costs) else [PREPROCESSING, SEGMENTATION]), *failed_stages(costs)]
        ),
        "published": published("runtime", "total_s").text_with_unit,
        "data": _data(costs),
    }


def _spread(values: pd.Series[float]) -> str:
    """Median with the range over the repeats; empty where a repeat has no value."""
    if values.isna().any():
        return ""
    middle = f"{np.median(values):.2f}"
    return f"{middle} [{values.min():.2f}, {values.max():.2f}]" if len(values) > 1 else middle


def failed_stages(costs: pd.DataFrame) -> list[str]:
    """List the stages that failed in any repeat.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of one phantom.

    Returns
    -------
    list of str
        Their names.
    """
    return [str(stage) for stage in costs.loc[costs["error"] != "", "stage"].drop_duplicates()]


def describe(costs: pd.DataFrame) -> tuple[str, ...]:
    """State the findings for each phantom, and what was published.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Returns
    -------
    tuple of str
        Sentences.
    """
    found = [_sentence(name, part) for name, part in phantoms(costs)]
    for name, part in phantoms(costs):
        failed = part[part["error"] != ""].drop_duplicates("stage")
        found += [
            f"{name}: the stage {row['stage']} failed: {row['error']}." for row in failed.to_dict("records")
        ]
    total, share = published("runtime", "total_s"), published("runtime", "share")
    return (
        *found,
        f"Published: {total.text_with_unit} on {total.data}; {share.text} ({total.place}). These sweeps are simulated "
        "and the machine is another one: not comparable.",
    )


def _sentence(name: str, costs: pd.DataFrame) -> str:
    each, failed = totals(costs), failed_stages(costs)
    acquired_s = costs.loc[costs["stage"] == ACQUISITION, "seconds"].iloc[0]
    modelled = f"{acquired_s:.1f} s are the modelled acquisition of {costs['frames'].iloc[0]} frames"
    tre = f"TRE of the rigid pose {costs['tre_mm'].iloc[0]:.2f} mm."
    if failed:
        return f"{name} (simulated): no total, for {' and '.join(failed)} failed; {modelled}. {tre}"
    spread = f" ({each['total_s'].min():.2f} to {each['total_s'].max():.2f} s over {len(each)} repeats)"
    if len(each) == 1:
        spread = " (one repeat)"
    measured = costs[~costs["modelled"]].groupby("stage", sort=False)["seconds"].median()
    without, rate = f", {WITHOUT}", ""
    if has_segmentation(costs):
        without = ""
        rate = (
            f" Pre-processing and segmentation: {np.median(each['segmentation_frames_per_s']):.1f} frames/s."
        )
    return (
        f"{name} (simulated): {np.median(each['total_s']):.1f} s from acquisition to registration{without}"
        f"{spread if len(each) > 1 else ' (one run, no spread)'}, of which {modelled} and "
        f"{np.median(each['computing_s']):.2f} s computing; the longest is {measured.idxmax()}, "
        f"{measured.max():.2f} s.{rate} {tre}"
    )


def has_segmentation(costs: pd.DataFrame) -> bool:
    """Tell whether frames were segmented, or exact masks taken.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat.

    Returns
    -------
    bool
        Whether there is such a stage.
    """
    return bool((costs["stage"] == SEGMENTATION).any())


def phantoms(costs: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Split the rows by phantom.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Yields
    ------
    tuple[str, pandas.DataFrame]
        Name and rows of each phantom.
    """
    for name in costs["phantom"].drop_duplicates():
        yield str(name), costs[costs["phantom"] == name]


def _stages(costs: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for stage in STAGES:
        rows = costs[costs["stage"] == stage]
        if len(rows):
            yield stage, rows


def _data(costs: pd.DataFrame) -> str:
    return SIMULATED if costs["simulated"].all() else ""
