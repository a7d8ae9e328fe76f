"""The figure of the runtime study: stages stacked on each other, a bar for each phantom, the published range beside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments.reporting.labels import COLOURS
from experiments.reporting.published import published
from experiments.studies.runtime.chain import STAGES
from experiments.studies.runtime.report import WITHOUT, has_segmentation, phantoms, totals

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS = {"acquisition": "Acquisition (modelled)", "preprocessing": "Pre-processing"}
WIDTH = 0.6


def stacked_bars(costs: pd.DataFrame) -> Figure:
    """Draw the median seconds of each stage as stacked bars, with the range of the total over the repeats.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Returns
    -------
    Figure
        The figure; a stage that failed is missing in its bar, which says so.
    """
    from matplotlib.figure import Figure

    parts = list(phantoms(costs))
    figure = Figure(figsize=(max(6.4, 2.6 + 1.3 * len(parts)), 4.8), layout="constrained")
    axes = figure.subplots()
    timed = costs[costs["seconds"].notna()]
    stages = [stage for stage in STAGES if (timed["stage"] == stage).any()]
    bottoms = np.zeros(len(parts))
    for stage, colour in zip(STAGES, COLOURS, strict=False):
        if stage not in stages:
            continue
        heights = np.nan_to_num([_median(part, stage) for _, part in parts])
        label = LABELS.get(stage, stage.capitalize())
        axes.bar(range(len(parts)), heights, WIDTH, bottoms, color=colour, label=label)
        bottoms += heights
    for place, ((_, part), top) in enumerate(zip(parts, bottoms, strict=True)):
        _total(axes, place, float(top), part)
    _published(axes, len(parts))
    names = [name.replace("_", " ") for name, _ in parts]
    axes.set_xticks(range(len(parts) + 1), [*names, "Published"])
    axes.set(ylabel="Time (s)", xlim=(-0.6, len(parts) + 0.6))
    axes.set_ylim(top=1.08 * axes.dataLim.y1)
    axes.grid(axis="y", alpha=0.3)
    axes.set_axisbelow(True)
    # In the order of the bars, the last stage on top.
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside right center", fontsize="small")
    without = "" if has_segmentation(costs) else f", {WITHOUT}"
    figure.suptitle(
        f"From acquisition to registration{without}\n(simulated sweeps; published: gel-wax phantoms, laptop with a "
        "GPU; not comparable)",
        fontsize="medium",
    )
    return figure


def _median(costs: pd.DataFrame, stage: str) -> float:
    rows = costs.loc[costs["stage"] == stage, "seconds"]
    return float(np.median(rows)) if len(rows) else 0.0


def _total(axes: Axes, place: int, top: float, costs: pd.DataFrame) -> None:
    """The total's median as a number and its range as an error bar."""
    each = totals(costs)["total_s"]
    middle, low, high = float(np.median(each)), float(each.min()), float(each.max())
    if np.isnan(each).any():
        axes.text(place, top, "a stage failed", ha="center", va="bottom", fontsize="small")
        return
    if len(each) > 1:
        axes.errorbar(place, middle, [[middle - low], [high - middle]], color="black", capsize=4, linewidth=1)
    axes.text(place, max(top, high), f"{middle:.1f} s", ha="center", va="bottom", fontsize="small")


def _published(axes: Axes, place: int) -> None:
    value = published("runtime", "total_s")
    low, high = value.bounds
    axes.bar(place, low, WIDTH, color="0.88", edgecolor="0.5")
    axes.bar(
        place, high - low, WIDTH, low, color="none", edgecolor="0.5", hatch="//", label="Published range"
    )
    axes.text(place, high, value.text_with_unit, ha="center", va="bottom", fontsize="small")
