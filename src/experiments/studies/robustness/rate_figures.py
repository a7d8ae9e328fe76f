"""The figures of the robustness study in which rates are drawn: against angles, factors, thresholds and acceptance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.labels import axis_label, method_label, method_styles
from experiments.studies.robustness.design import CROSSED, WHOLE
from experiments.studies.robustness.error_figures import error_boxes, residual_against_error, runtimes
from experiments.studies.robustness.grouping import (
    by_condition,
    crossed,
    groups,
    methods,
    with_condition,
)
from experiments.studies.robustness.metrics import by_bin
from experiments.studies.robustness.style import (
    MAX_SHOWN_MM,
    draw_rates,
    legend_above,
    log_axis,
    panel_title,
    piece_title,
    rate_axis,
)
from registration.metrics.surface_distance import SUCCESS_TRE_MM
from registration.perturbation.random_pose import ANY, FLIP, ROLL

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Where a flip stands next to the angles, and how far the curve of success reaches.
FLIP_AT_DEG = 202.0
MAX_THRESHOLD_MM = 10.0
RATE_LABEL = axis_label("success_tre_rate")


def figures(cases: pd.DataFrame) -> dict[str, Figure]:
    """Draw all figures for which there are trials.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    dict
        Figures by file stem.
    """
    turned, varied = crossed(cases), cases[cases["factor"] != CROSSED]
    found: dict[str, Figure] = {}
    kinds = set(turned["rotation"])
    if kinds & {ANY, FLIP}:
        found["success_by_angle"] = _success_by_angle(
            turned[turned["rotation"] != ROLL], axis_label("angle_deg")
        )
    if ROLL in kinds:
        found["success_by_roll"] = _success_by_angle(
            turned[turned["rotation"] == ROLL], axis_label("roll_deg")
        )
    if len(turned):
        found["errors"] = error_boxes(turned)
        found["success_curve"] = _success_curve(turned)
    if len(varied):
        found["factors"] = _factors(varied)
    found["rmse_tre"] = residual_against_error(cases)
    found["runtime"] = runtimes(cases)
    if cases["tre_high_mm"].notna().any():
        found["risk_coverage"] = _risk_coverage(cases)
    return found


def _success_by_angle(turned: pd.DataFrame, label: str) -> Figure:
    """A panel for each condition and piece, a line for each method; flips stand apart at the right."""
    from matplotlib.figure import Figure

    names = methods(turned)
    rows = [key for key, _ in groups(turned, with_condition(turned, ("overlap",)))]
    places = [place for place in turned["place"].drop_duplicates() if place != WHOLE] or [WHOLE]
    size = (max(4.3 * len(places), 6.4) + 0.4, max(2.4 * len(rows), 3.0) + 0.9)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), len(places), squeeze=False, sharey=True)
    for axes in grid.flat:
        axes.set_visible(False)
    for (*row, place), piece in groups(turned, with_condition(turned, ("overlap", "place"))):
        *condition, overlap = row
        axes = grid[rows.index(tuple(row))][0 if place == WHOLE else places.index(place)]
        axes.set_visible(True)
        counts = _angles(axes, piece, names)
        axes.set_title(f"{piece_title(overlap, place, *condition)}{_each(counts)}", fontsize="medium")
        axes.set_xlabel(label)
    figure.supylabel(f"{RATE_LABEL} (Wilson 95 %)", fontsize="medium" if len(rows) > 1 else "small")
    legend_above(figure, grid[0][0])
    return figure


def _each(counts: Sequence[int]) -> str:
    """How many trials a point stands for, as the end of a panel's title."""
    if not counts:
        return ""
    few, many = min(counts), max(counts)
    return f" (n = {few} a point)" if few == many else f" (n = {few} to {many} a point)"


def _angles(axes: Axes, piece: pd.DataFrame, names: list[str]) -> list[int]:
    """Draw the rates of each method, and return the number of trials of every point."""
    counts: list[int] = []
    ticks: list[float] = list(range(0, 181, 30))
    flipped = (piece["rotation"] == FLIP).any()
    for number, (name, look) in enumerate(method_styles(names).items()):
        group = piece[piece["method"] == name]
        # Side by side within a bin, so that intervals do not hide each other.
        aside = (number - (len(names) - 1) / 2) / max(len(names), 2)
        bins = by_bin(group)
        counts += bins["trials"].tolist()
        if len(bins):
            width_deg = (bins["angle_to_deg"] - bins["angle_from_deg"]).to_numpy()
            middles_deg = (bins["angle_from_deg"] + bins["angle_to_deg"]).to_numpy() / 2
            draw_rates(
                axes,
                middles_deg + 0.7 * aside * width_deg,
                bins["successes"],
                bins["trials"],
                label=method_label(name),
                **look,
            )
        flips = group.loc[group["rotation"] == FLIP, "success_tre"]
        if len(flips):
            counts.append(len(flips))
            known: dict[str, Any] = {} if len(bins) else {"label": method_label(name)}
            draw_rates(
                axes,
                [FLIP_AT_DEG + 14 * aside],
                [int(flips.sum())],
                [len(flips)],
                linestyle="",
                **known,
                **look,
            )
    if flipped:
        axes.axvline((180 + FLIP_AT_DEG) / 2 - 1, color="grey", linewidth=0.6)
    axes.set_xticks([*ticks, FLIP_AT_DEG] if flipped else ticks)
    axes.set_xticklabels([f"{tick:g}" for tick in ticks] + ["flip"] * bool(flipped))
    axes.set_xlim(-4, FLIP_AT_DEG + 12 if flipped else 184)
    rate_axis(axes)
    return counts


def _success_curve(turned: pd.DataFrame) -> Figure:
    """The share of trials within any distance of the truth, a panel for each overlap, a row for each condition."""
    from matplotlib.figure import Figure

    names = methods(turned)
    overlaps = list(turned["overlap"].drop_duplicates())
    rows = [condition for condition, _ in by_condition(turned)]
    size = (3.2 * len(overlaps) + 0.6, 3.0 * len(rows) + 0.4)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), len(overlaps), squeeze=False, sharey=True)
    for row, (condition, turned_alike) in zip(grid, by_condition(turned), strict=True):
        for axes in row:
            axes.set_visible(False)
        for (overlap,), part in groups(turned_alike, ("overlap",)):
            axes = row[overlaps.index(overlap)]
            axes.set_visible(True)
            _curves(axes, part, names)
            axes.set(
                title=panel_title(f"Overlap {overlap:g}", condition),
                xlabel=f"{axis_label('tre_mm')} at most",
                xlim=(0, MAX_THRESHOLD_MM),
            )
        row[0].set_ylabel("Share of trials")
    legend_above(figure, grid[0][0])
    return figure


def _curves(axes: Axes, part: pd.DataFrame, names: Sequence[str]) -> None:
    for name, look in method_styles(names).items():
        errors_mm = np.sort(part.loc[part["method"] == name, "tre_mm"].to_numpy())
        if len(errors_mm):
            shares = np.arange(len(errors_mm) + 1) / len(errors_mm)
            at_mm = [0.0, *errors_mm.clip(max=2 * MAX_THRESHOLD_MM), 2 * MAX_THRESHOLD_MM]
            axes.step(
                at_mm, [*shares, shares[-1]], where="post", color=look["color"], label=method_label(name)
            )
    axes.axvline(SUCCESS_TRE_MM, color="grey", linestyle=":")
    rate_axis(axes)


def _factors(varied: pd.DataFrame) -> Figure:
    """A column for each condition and factor: success above, the median error below."""
    from matplotlib.figure import Figure

    names = methods(varied)
    parts = list(groups(varied, with_condition(varied, ("factor",))))
    figure = Figure(figsize=(max(3.1 * len(parts), 6.4) + 0.6, 5.2), layout="constrained")
    grid = figure.subplots(2, len(parts), squeeze=False, sharey="row", sharex="col")
    for (above, below), ((*condition, factor), part) in zip(grid.T, parts, strict=True):
        above.set_title(panel_title("", " ".join(condition)), fontsize="medium")
        for name, look in method_styles(names).items():
            levels = part[part["method"] == name].groupby("level")
            if not len(levels):
                continue
            won = levels["success_tre"].agg(["sum", "size"])
            # Side by side, so that intervals of equal rates do not hide each other.
            aside = (
                0.02
                * (part["level"].max() - part["level"].min())
                * (names.index(name) - (len(names) - 1) / 2)
            )
            draw_rates(
                above, won.index.to_numpy() + aside, won["sum"], won["size"], label=method_label(name), **look
            )
            errors_mm = levels["tre_mm"].median().clip(upper=MAX_SHOWN_MM)
            below.plot(errors_mm.index, errors_mm, linewidth=1.2, markersize=3.5, **look)
        rate_axis(above)
        below.set(xlabel=axis_label(factor), xticks=sorted(part["level"].unique()))
        log_axis(below, "y")
        below.grid(alpha=0.25)
    grid[0][0].set_ylabel(RATE_LABEL, fontsize="small")
    grid[1][0].set_ylabel(f"{axis_label('tre_mm')}, median")
    legend_above(figure, grid[0][0])
    return figure


def _risk_coverage(cases: pd.DataFrame) -> Figure:
    """Success among the results that a method is surest of, against their share; the dot is where it accepts.

    Results are ranked as the verdict does: accepted ones first, then by the upper end of the predicted error. A panel
    for each condition.
    """
    from matplotlib.figure import Figure

    parts = by_condition(cases)
    figure = Figure(figsize=(5.6, 3.4 * len(parts) + 0.4), layout="constrained")
    column = figure.subplots(len(parts), 1, squeeze=False)[:, 0]
    names = methods(cases)
    for axes, (condition, part) in zip(column, parts, strict=True):
        _ranked(axes, part, names)
        axes.set(
            title=panel_title("", condition),
            xlabel=f"{axis_label('acceptance_rate')} (dot: by verdict)",
            ylabel=f"{RATE_LABEL}, of accepted",
        )
        axes.set_xlim(0, 1.02)
        axes.grid(alpha=0.25)
    legend_above(figure, column[0])
    return figure


def _ranked(axes: Axes, part: pd.DataFrame, names: Sequence[str]) -> None:
    for name, look in method_styles(names).items():
        group = part[part["method"] == name]
        if not group["tre_high_mm"].notna().any():
            continue
        ranked = group.sort_values(["accepted", "tre_high_mm"], ascending=[False, True])[
            "success_tre"
        ].to_numpy()
        counts = np.arange(1, len(ranked) + 1)
        rates = np.cumsum(ranked) / counts
        axes.plot(counts / len(ranked), rates, color=look["color"], label=method_label(name))
        if taken := int(group["accepted"].sum()):
            axes.plot(taken / len(ranked), rates[taken - 1], **look)
