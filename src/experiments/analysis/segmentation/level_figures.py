"""DSC and HD95 over the levels of a factor, models next to each other, published values beside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.segmentation.case_table import SMOKE, distance, once_each
from experiments.analysis.segmentation.levels import PublishedOf, plain_name
from experiments.reporting.labels import axis_label, method_label, method_styles
from experiments.reporting.published import Published

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND = 0.8
LEGEND = (
    "Box: quartiles over cases; symbols: means of groups; a missed vessel: DSC 0, HD95 the image's diagonal"
)
PUBLISHED_COLOUR = "0.35"


def level_boxes(
    panels: Mapping[str, pd.DataFrame],
    factor: str,
    order: Mapping[str, str],
    published_of: PublishedOf,
    title: str,
) -> Figure:
    """Draw box plots of DSC and HD95 by level, one row of axes for each panel, a colour for each model.

    Parameters
    ----------
    panels : Mapping[str, pandas.DataFrame]
        Per-case table of each row of axes by its title.
    factor : str
        Column of the levels.
    order : Mapping[str, str]
        Label of each level, in the order on the axis.
    published_of : callable
        Gives the published DSC of ``panel``, a level of the factor and a ``model``; drawn on the DSC's axes.
    title : str
        Title of the figure.

    Returns
    -------
    Figure
        The figure. Levels that no panel has are left out.
    """
    from matplotlib.figure import Figure

    shown = [level for level in order if any((cases[factor] == level).any() for cases in panels.values())]
    models = list(dict.fromkeys(str(model) for cases in panels.values() for model in cases["model"]))
    width = max(4.2, 1.0 + 1.25 * len(shown), 0.8 + 0.36 * len(shown) * len(models))
    figure = Figure(figsize=(2 * width + 1.8, 3.1 * len(panels) + 1.0), layout="constrained")
    grid = figure.subplots(len(panels), 2, squeeze=False)
    for row, (name, cases) in zip(grid, panels.items(), strict=True):
        for axes, measure in zip(row, ("dsc", distance(cases)), strict=True):
            _boxes(axes, cases, factor, shown, models, measure)
            axes.set_xticks(range(len(shown)), [order[level] for level in shown], fontsize="small")
            axes.set_title(name, fontsize="medium")
        _published(row[0], factor, shown, models, _of_panel(published_of, name))
    handles, labels = _legend(grid)
    figure.legend(handles, labels, loc="outside right center", fontsize="small")
    figure.suptitle(title, fontsize="medium")
    figure.supxlabel(LEGEND, fontsize="small", wrap=True)
    return figure


def _of_panel(published_of: PublishedOf, panel: str) -> PublishedOf:
    def known(of: Mapping[str, str]) -> Sequence[Published]:
        return published_of({"panel": panel, **of})

    return known


def _boxes(
    axes: Axes,
    cases: pd.DataFrame,
    factor: str,
    shown: Sequence[str],
    models: Sequence[str],
    measure: str,
) -> None:
    styles, step = method_styles([plain_name(model) for model in models]), BAND / len(models)
    for number, model in enumerate(models):
        style = styles[plain_name(model)]
        axes.plot([], [], style["marker"], color=style["color"], label=_label(model))
        for place, level in enumerate(shown):
            rows = cases[(cases["model"] == model) & (cases[factor] == level)]
            rows = once_each(rows).dropna(subset=measure) if len(rows) else rows
            if len(rows):
                _box(axes, rows, measure, place + _offset(number, len(models)), step, style)
    axes.set(ylabel=axis_label(measure), xlim=(-0.6, len(shown) - 0.4))
    axes.grid(axis="y", alpha=0.3)
    if measure == "dsc":
        axes.set_ylim(-0.03, 1.03)
    else:
        axes.set_ylim(bottom=0)


def _box(
    axes: Axes, rows: pd.DataFrame, measure: str, middle: float, step: float, style: Mapping[str, str]
) -> None:
    colour = style["color"]
    axes.boxplot(
        [rows[measure]],
        positions=[middle],
        widths=0.85 * step,
        manage_ticks=False,
        patch_artist=True,
        showfliers=False,
        boxprops={"facecolor": (colour, 0.25), "edgecolor": colour},
        whiskerprops={"color": colour},
        capprops={"color": colour},
        medianprops={"color": "black"},
    )
    means = rows.groupby("group")[measure].mean()
    # Spread evenly over the box in the order of their names: the same figure every time.
    aside = np.linspace(-0.3, 0.3, len(means)) * step if len(means) > 1 else np.zeros(1)
    axes.plot(middle + aside, means, style["marker"], color=colour, markersize=3, markeredgewidth=0)


def _published(
    axes: Axes, factor: str, shown: Sequence[str], models: Sequence[str], published_of: PublishedOf
) -> None:
    """A range as a hatched box over the level, a bound or a value as a line with its sense as an arrow."""
    label = "Published"
    for place, level in enumerate(shown):
        for number, model in enumerate(models):
            for value in published_of({factor: level, "model": plain_name(model)}):
                low, high = value.bounds
                # What is published of all models alike is drawn once, over the whole level.
                alone = "model" in value.condition and len(value.condition["model"]) == 1
                left = place + _offset(number, len(models)) - BAND / len(models) / 2 if alone else place - 0.4
                width = BAND / len(models) if alone else BAND
                if not alone and number:
                    continue
                if np.isfinite([low, high]).all() and high > low:
                    axes.bar(
                        left + width / 2, high - low, width, low, color="none",
                        edgecolor=PUBLISHED_COLOUR, hatch="////", label=label,
                    )  # fmt: skip
                    continue
                at = low if np.isfinite(low) else high
                axes.plot([left, left + width], [at, at], color=PUBLISHED_COLOUR, linewidth=2, label=label)
                if low < high:
                    sense = "^" if np.isfinite(low) else "v"
                    axes.plot([left + width / 2], [at], sense, color=PUBLISHED_COLOUR, markersize=6)


def _legend(grid: np.ndarray) -> tuple[list[Artist], list[str]]:
    found: dict[str, Artist] = {}
    for axes in grid[:, 0]:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def _offset(number: int, count: int) -> float:
    return (number - (count - 1) / 2) * BAND / count


def _label(model: str) -> str:
    """A network in plain words, with the mark of a smoke training and its choices."""
    plain = plain_name(model)
    mark = SMOKE if model.startswith(SMOKE) else ""
    choices = model.removeprefix(SMOKE).removeprefix(plain)
    return f"{mark}{method_label(plain)}{choices.replace('_', ' ')}"
