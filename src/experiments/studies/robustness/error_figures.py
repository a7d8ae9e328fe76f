"""The figures of the robustness study in which every trial counts: errors, residual against error, time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.labels import axis_label, method_label, method_styles
from experiments.studies.robustness.grouping import by_condition, groups, methods, with_condition
from experiments.studies.robustness.metrics import lies
from experiments.studies.robustness.style import (
    MAX_SHOWN_MM,
    MIN_SHOWN_MM,
    legend_above,
    log_axis,
    panel_title,
)
from registration.metrics.surface_distance import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTE = (
    "Boxes: quartiles and median; whiskers: 5th and 95th percentiles; failures without a result at "
    f"{MAX_SHOWN_MM:g} mm"
)


def error_boxes(turned: pd.DataFrame) -> Figure:
    """Draw RMSE and TRE by method and overlap, on logarithmic axes, with the lines of success.

    Each condition has a row of panels.

    Parameters
    ----------
    turned : pandas.DataFrame
        Rows of the trials in which rotation and overlap are crossed.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.figure import Figure

    names = methods(turned)
    overlaps = list(turned["overlap"].drop_duplicates())
    parts = by_condition(turned)
    width = max(3.6, 0.22 * len(names) * len(overlaps) + 1.2)
    figure = Figure(figsize=(2 * width, 3.2 * len(parts) + 1.0), layout="constrained")
    grid = figure.subplots(len(parts), 2, squeeze=False, sharey=True)
    for row, (condition, part) in zip(grid, parts, strict=True):
        for axes, column, limit in zip(
            row, ("rmse_mm", "tre_mm"), (SUCCESS_RMSE_MM, SUCCESS_TRE_MM), strict=True
        ):
            axes.axhline(limit, color="grey", linestyle=":")
            _boxes(axes, part, column, names, overlaps)
            axes.set_title(panel_title("", condition), fontsize="medium")
    legend_above(figure, grid[0][0])
    figure.supxlabel(NOTE, fontsize="small", wrap=True)
    return figure


def _boxes(
    axes: Axes, part: pd.DataFrame, column: str, names: Sequence[str], overlaps: Sequence[float]
) -> None:
    """The boxes of one error, side by side by method, at every overlap."""
    step = 0.8 / len(names)
    for number, (name, look) in enumerate(method_styles(names).items()):
        for place, overlap in enumerate(overlaps):
            chosen = part[(part["method"] == name) & (part["overlap"] == overlap)]
            _box(axes, _shown(chosen[column]), place + (number - (len(names) - 1) / 2) * step, step, look)
        axes.plot([], [], "s", color=look["color"], label=method_label(name))
    axes.set(xlabel=axis_label("overlap"), ylabel=axis_label(column), xticks=range(len(overlaps)))
    log_axis(axes, "y")
    axes.set_xticklabels([f"{overlap:g}" for overlap in overlaps])
    axes.set_xlim(-0.6, len(overlaps) - 0.4)
    axes.tick_params(labelleft=True)
    axes.grid(axis="y", alpha=0.25)


def residual_against_error(cases: pd.DataFrame) -> Figure:
    """Draw RMSE against TRE, a panel for each method, a row for each condition.

    The shaded corner is where RMSE calls a wrong pose a success.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.figure import Figure

    parts = list(groups(cases, with_condition(cases, ("method",))))
    names = methods(cases)
    columns = min(len(parts), 3) if len(parts) == len(names) else len(names)
    rows = -(-len(parts) // columns)
    figure = Figure(figsize=(3.3 * columns + 0.5, 3.0 * rows + 0.3), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    look = method_styles(names)
    for axes in grid.flat[len(parts) :]:
        axes.set_visible(False)
    for axes, ((*condition, name), group) in zip(grid.flat, parts, strict=False):
        axes.fill_between(
            [SUCCESS_TRE_MM, 2 * MAX_SHOWN_MM],
            MIN_SHOWN_MM,
            SUCCESS_RMSE_MM,
            color="0.88",
            linewidth=0,
        )
        axes.scatter(
            _shown(group["tre_mm"]),
            _shown(group["rmse_mm"]),
            s=9,
            alpha=0.5,
            linewidths=0,
            color=look[name]["color"],
        )
        hidden = lies(group)
        hides = f"{method_label(str(name))}: RMSE hides {hidden.sum()} of {len(group)}"
        axes.set_title("\n".join([*map(str, condition), hides]), fontsize="medium")
        axes.axhline(SUCCESS_RMSE_MM, color="grey", linestyle=":", linewidth=0.8)
        axes.axvline(SUCCESS_TRE_MM, color="grey", linestyle=":", linewidth=0.8)
        axes.set_xlim(MIN_SHOWN_MM, 1.5 * max(_shown(cases["tre_mm"]).max(), 10.0))
        axes.set_ylim(MIN_SHOWN_MM, 1.5 * max(_shown(cases["rmse_mm"]).max(), 10.0))
        log_axis(axes, "x")
        log_axis(axes, "y")
        axes.grid(alpha=0.2)
    figure.supxlabel(axis_label("tre_mm"), fontsize="medium")
    figure.supylabel(axis_label("rmse_mm"), fontsize="medium")
    return figure


def runtimes(cases: pd.DataFrame) -> Figure:
    """Draw the seconds per trial by condition and method, on a logarithmic axis, with the median at the right.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.figure import Figure

    look = method_styles(methods(cases))
    parts = list(groups(cases, with_condition(cases, ("method",))))
    figure = Figure(figsize=(6.4, 0.45 * len(parts) + 1.2), layout="constrained")
    axes = figure.subplots()
    for number, ((*_, name), group) in enumerate(parts):
        seconds = group["runtime_s"]
        _box(axes, seconds.to_numpy(), number, 0.8, look[name], vertical=False)
        axes.annotate(
            f"{seconds.median():.2f} s",
            (1.01, number),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize="small",
        )
    axes.set(
        xlabel=f"{axis_label('runtime_s')} of a trial, one thread (median at the right)",
        yticks=range(len(parts)),
    )
    axes.set_yticklabels(
        [panel_title(method_label(str(name)), " ".join(condition)) for (*condition, name), _ in parts]
    )
    axes.invert_yaxis()
    log_axis(axes, "x")
    axes.grid(axis="x", alpha=0.25)
    return figure


def _shown(values: pd.Series[float]) -> np.ndarray:
    shown: np.ndarray = values.clip(MIN_SHOWN_MM, MAX_SHOWN_MM).to_numpy()
    return shown


def _box(
    axes: Axes, values: np.ndarray, at: float, width: float, look: dict[str, Any], *, vertical: bool = True
) -> None:
    if not len(values):
        return
    axes.boxplot(
        [values],
        positions=[at],
        widths=0.8 * width,
        whis=(5, 95),
        orientation="vertical" if vertical else "horizontal",
        manage_ticks=False,
        patch_artist=True,
        showfliers=False,
        boxprops={"facecolor": look["color"], "alpha": 0.45, "edgecolor": look["color"]},
        whiskerprops={"color": look["color"]},
        capprops={"color": look["color"]},
        medianprops={"color": "black"},
    )
