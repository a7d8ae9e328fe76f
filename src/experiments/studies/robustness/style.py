"""The axes that the figures of the robustness study share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.statistics import wilson_interval
from experiments.studies.robustness.design import WHOLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Errors of failed and of perfect trials are drawn at the edges of logarithmic axes.
MIN_SHOWN_MM, MAX_SHOWN_MM = 1e-2, 1e3


def piece_title(overlap: float, place: str, condition: str = "") -> str:
    """Name the panel of a piece.

    Parameters
    ----------
    overlap : float
        Share of the vessel's extent that the moving cloud covers.
    place : str
        Place of the piece along the vessel.
    condition : str, optional
        Condition of the trials; empty where all have the same.

    Returns
    -------
    str
        The title.
    """
    return panel_title("Overlap 1" if place == WHOLE else f"Overlap {overlap:g}, {place}", condition)


def panel_title(text: str, condition: str) -> str:
    """Add the condition of the trials to the title of a panel.

    Parameters
    ----------
    text : str
        Title within a condition; it may be empty.
    condition : str
        Condition of the trials; empty where all have the same.

    Returns
    -------
    str
        The title.
    """
    return ", ".join(filter(None, (text, condition)))


def draw_rates(
    axes: Axes, at: Iterable[float], successes: Iterable[int], trials: Iterable[int], **look: Any
) -> None:
    """Draw rates joined by a line, each with its Wilson 95 % interval.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    at : iterable of float
        Positions on the horizontal axis.
    successes : iterable of int
        Number of successes at each position.
    trials : iterable of int
        Number of trials at each position.
    **look : Any
        Further keyword arguments of ``Axes.errorbar``.
    """
    shares = [wilson_interval(int(won), int(count)) for won, count in zip(successes, trials, strict=True)]
    rates = [each.rate for each in shares]
    reach = [
        [max(each.rate - each.low, 0) for each in shares],
        [max(each.high - each.rate, 0) for each in shares],
    ]
    bars = axes.errorbar(
        np.fromiter(at, float), rates, reach, capsize=0, linewidth=1.2, markersize=3.5, elinewidth=0.8, **look
    )
    for part in (*bars[1], *bars[2]):
        part.set_alpha(0.45)


def rate_axis(axes: Axes) -> None:
    """Set the vertical axis from no to all trials, with the grid that every panel has.

    Parameters
    ----------
    axes : Axes
        Axes to set.
    """
    axes.set_ylim(-0.04, 1.04)
    axes.grid(alpha=0.25)


def log_axis(axes: Axes, which: str) -> None:
    """Set a logarithmic axis with plain numbers at 1, 2 and 5 of each decade, or at 1 of many decades.

    Parameters
    ----------
    axes : Axes
        Axes to set.
    which : str
        ``x`` or ``y``.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set(**{f"{which}scale": "log"})
    first, last = sorted(axes.get_xlim() if which == "x" else axes.get_ylim())
    axis = axes.xaxis if which == "x" else axes.yaxis
    few = last / first < 150
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_above(figure: Figure, axes: Axes) -> None:
    """Draw one legend for all panels, outside of them.

    Parameters
    ----------
    figure : Figure
        Figure of the panels.
    axes : Axes
        Axes whose entries the legend has.
    """
    handles, names = axes.get_legend_handles_labels()
    known = dict(zip(names, handles, strict=True))
    columns = max(min(len(known), int(figure.get_figwidth() / 1.4)), 1)
    figure.legend(known.values(), known.keys(), loc="outside upper center", ncols=columns, frameon=False)
