"""The differences of two runs unit by unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.runs.paired_cases import TESTED, PairedCases
from experiments.analysis.runs.paired_tests import strata_of, unit_values
from experiments.reporting.labels import axis_label, method_label, method_styles

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS = 4
# More units than these have no names on the axis.
MOST_NAMED = 24
# Failures of one run alone are drawn so far beyond the largest finite difference.
_BEYOND = 1.15


def paired_differences(paired: PairedCases, tested: pd.DataFrame, names: tuple[str, str]) -> Figure:
    """Draw the difference of each unit, first less second, one panel a metric.

    Parameters
    ----------
    paired : PairedCases
        The cases of both runs.
    tested : pandas.DataFrame
        As ``compare_runs`` gives it.
    names : tuple of str, str
        Names of the runs.

    Returns
    -------
    matplotlib.figure.Figure
        Points in the order of the mean difference over the methods, with the mean and its 95 % interval above them.
    """
    from matplotlib.figure import Figure

    metrics = [name for name in paired.metrics if name in set(tested["metric"])][:MOST_PANELS]
    units = paired.pairs[paired.unit].nunique()
    height = 2.2 + 0.16 * min(units, 30)
    figure = Figure(figsize=(0.8 + 3.2 * len(metrics), height), layout="constrained")
    plain = [name.replace("_", " ") for name in names]
    panels = figure.subplots(1, len(metrics), squeeze=False)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        _panel(axes, paired, tested, metric, plain)
    panels[0].set_ylabel(f"{axis_label(paired.unit)}, by difference")
    handles, labels = panels[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4), frameon=False)
    figure.supxlabel(
        f"Difference: {plain[0]} less {plain[1]}\nAt the top the mean with its 95 % interval",
        fontsize="medium",
    )
    return figure


def _panel(axes: Axes, paired: PairedCases, tested: pd.DataFrame, metric: str, names: Sequence[str]) -> None:
    parts = {name: unit_values(paired, metric, cases) for name, cases in strata_of(paired)}
    parts = {name: values for name, values in parts.items() if len(values)}
    differences = {name: _difference(values) for name, values in parts.items()}
    order = _order(differences)
    place = {unit: number for number, unit in enumerate(order)}
    finite = np.concatenate([each[np.isfinite(each)] for each in differences.values()])
    edge = _BEYOND * max(np.abs(finite).max(initial=0.0), 1e-12)
    styles = method_styles(list(differences))
    for number, (name, each) in enumerate(differences.items()):
        at = [place[unit] for unit in each.index]
        look = styles[name]
        axes.scatter(np.clip(each, -edge, edge), at, s=14, label=method_label(name) or None, **look)
        row = tested[(tested["metric"] == metric) & (tested["method"] == name)].iloc[0]
        _mean(axes, row, len(order) + 0.8 + number, edge, str(look["color"]))
    axes.axvline(0.0, color="0.4", linewidth=0.8, zorder=0)
    named = paired.pairs[paired.unit].nunique() <= MOST_NAMED
    axes.set_yticks(range(len(order)) if named else [], [str(unit) for unit in order] if named else [])
    axes.tick_params(axis="y", labelsize="small")
    lost = int(sum((~np.isfinite(each)).sum() for each in differences.values()))
    failures = f"\n{lost} at the edge: one run failed" if lost else ""
    better = names[0] if TESTED[metric] else names[1]
    axes.set_title(
        f"{axis_label(metric)}, n = {len(order)}{failures}\nright of 0: {better} better", fontsize="small"
    )
    axes.grid(axis="x", alpha=0.25)


def _mean(axes: Axes, row: pd.Series, height: float, edge: float, colour: str) -> None:
    """The mean difference with its interval, above the units."""
    bounds = np.array([row["mean_difference_ci_low"], row["mean_difference_ci_high"]], dtype=float)
    if np.isfinite(row["mean_difference"]):
        axes.plot(row["mean_difference"], height, marker="|", markersize=9, color=colour)
    if np.isfinite(bounds).any():
        axes.plot(
            np.clip(np.nan_to_num(bounds, posinf=edge, neginf=-edge), -edge, edge), [height] * 2, color=colour
        )


def _difference(values: pd.DataFrame) -> pd.Series:
    first, second = values["first"], values["second"]
    with np.errstate(invalid="ignore"):
        found: pd.Series = (first - second).where(first != second, 0.0)
    return found


def _order(differences: dict[str, pd.Series]) -> list[object]:
    import pandas as pd

    table = pd.DataFrame(differences).replace([np.inf, -np.inf], [1e300, -1e300])
    return list(table.mean(axis=1).sort_values(kind="stable").index)
