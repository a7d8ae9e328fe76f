"""The figure of the accuracy study: what each stage leaves, by phantom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.reporting.labels import COLOURS, axis_label, method_label, method_styles
from experiments.studies.accuracy.published_values import published_rmse
from experiments.studies.accuracy.sweeps import METHOD

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = ("rmse_mm", "hd95_mm", "tre_covered_mm", "tre_uncovered_mm")
PUBLISHED = COLOURS[6]


def stage_figure(cases: pd.DataFrame, method: str = METHOD) -> Figure:
    """Draw a box for each method by phantom, of residuals in the upper row and of true errors in the lower one.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages.
    method : str, optional
        Column with the name of the method.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    from matplotlib.figure import Figure

    several = len(cases["share"].unique()) > 1
    group = cases["phantom"].astype(str)
    if several:
        group = group + cases["share"].map(lambda share: f"\n{100 * share:.0f} % swept")
    cases = cases.assign(group=group)
    # A part of which no target is measured has no panel.
    shown = [name for name in PANELS if np.isfinite(cases[name]).any()]
    rows = -(-len(shown) // 2)
    wide = 2.2 + 1.5 * cases["group"].nunique()
    figure = Figure(figsize=(2 * min(wide, 7.5), 3.4 * rows + 0.6), layout="constrained")
    count = int(cases.groupby(["group", method]).size().max())
    figure.suptitle(f"Residual and true error by stage, {count} simulated sweeps of each phantom")
    methods = list(dict.fromkeys(cases[method]))
    styles = method_styles(methods)
    panels = np.atleast_1d(figure.subplots(rows, 2 if len(shown) > 1 else 1)).ravel()
    for axes, name in zip(panels, shown, strict=False):
        _boxes(axes, cases, name, methods, [styles[each]["color"] for each in methods], method)
    for axes in panels[len(shown) :]:
        axes.remove()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _boxes(
    axes: Axes, cases: pd.DataFrame, name: str, methods: Sequence[str], colours: Sequence[str], method: str
) -> None:
    groups = list(dict.fromkeys(cases["group"]))
    width = 0.8 / len(methods)
    for place, (each, colour) in enumerate(zip(methods, colours, strict=True)):
        at = np.arange(len(groups)) + width * (place - 0.5 * (len(methods) - 1))
        own = cases[cases[method] == each]
        values = [own.loc[own["group"] == group, name].to_numpy() for group in groups]
        # What failed is in the table; a box has no place for it.
        finite = [one[np.isfinite(one)] for one in values]
        drawn = axes.boxplot(finite, positions=at, widths=0.8 * width, patch_artist=True, showfliers=False)
        for box, middle in zip(drawn["boxes"], drawn["medians"], strict=True):
            box.set(facecolor=colour, alpha=0.4)
            middle.set(color="black")
        for x, one in zip(at, finite, strict=True):
            axes.plot(x + np.linspace(-0.2, 0.2, len(one)) * width, one, ".", color=colour, markersize=4)
        axes.plot([], [], "s", color=colour, label=method_label(each))
    if name == "rmse_mm":
        _mark_published(axes, cases, groups)
    axes.set_xticks(range(len(groups)), groups)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(axis_label(name))
    axes.grid(axis="y", alpha=0.3)


def _mark_published(axes: Axes, cases: pd.DataFrame, groups: Sequence[str]) -> None:
    """A short line at each published value of a phantom."""
    first = True
    for place, group in enumerate(groups):
        phantom = str(cases.loc[cases["group"] == group, "phantom"].iloc[0])
        for stage in ("rigid", "deformable"):
            value = published_rmse(phantom, stage)
            if value is None or value.value is None:
                continue
            label = "Published (gel wax), not comparable" if first else None
            axes.plot([place - 0.45, place + 0.45], [value.value] * 2, ":", color=PUBLISHED, label=label)
            first = False
