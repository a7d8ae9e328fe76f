"""Figures of the consolidation study: lines between the folds' networks, and reliability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.consolidation.calibrations import N_BINS, NONE
from experiments.analysis.consolidation.rows import BARRIER, RELIABILITY, of_kind
from experiments.analysis.consolidation.tables import JOB, places
from experiments.reporting.labels import COLOURS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REGIONS = ("everywhere", "boundary")


def barrier_figure(cases: pd.DataFrame) -> Figure:
    """Draw loss and DSC along the straight lines between the folds' networks.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Returns
    -------
    Figure
        One row of axes for each network and data set: loss and DSC, one line for each pair and job.
    """
    from matplotlib.figure import Figure

    parts = list(places(of_kind(cases, BARRIER)))
    figure = Figure(figsize=(8.0, 3.2 * len(parts)), layout="constrained")
    grid = figure.subplots(len(parts), 2, squeeze=False)
    for (place, part), row in zip(parts, grid, strict=True):
        pairs = part[["first", "second"]].drop_duplicates().itertuples(index=False)
        for number, (first, second) in enumerate(pairs):
            lines = part[(part["first"] == first) & (part["second"] == second)]
            for job, (_, line) in enumerate(lines.groupby(list(JOB), dropna=False)):
                line = line.sort_values("alpha")
                for axes, name in zip(row, ("loss", "dsc"), strict=True):
                    label = f"{first} to {second}" if job == 0 else None
                    colour = COLOURS[number % len(COLOURS)]
                    axes.plot(line["alpha"], line[name], color=colour, label=label, marker=".", alpha=0.8)
        for axes, name in zip(row, ("Loss", "DSC"), strict=True):
            axes.set(xlabel="Position between two folds' networks", ylabel=f"{name}, selection groups")
            axes.grid(alpha=0.3)
        row[0].set_title(f"{place['network']}, {place['dataset']}", fontsize="small")
        row[1].legend(fontsize="x-small")
    return figure


def reliability_figure(cases: pd.DataFrame, names: Sequence[str], calibration: str) -> Figure:
    """Draw observed frequency against predicted probability on test groups, before and after calibration.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.
    names : sequence of str
        Candidates to draw.
    calibration : str
        The calibration that is compared with none.

    Returns
    -------
    Figure
        One row of axes for each network, data set and candidate: all pixels and the band around the boundary.
    """
    from matplotlib.figure import Figure

    found = of_kind(cases, RELIABILITY)
    found = found[found["group"] != ""]
    parts = [
        (place, name, part[part["model"] == name])
        for place, part in places(found)
        for name in dict.fromkeys(names)
        if (part["model"] == name).any()
    ]
    figure = Figure(figsize=(8.0, 3.6 * len(parts)), layout="constrained")
    grid = figure.subplots(len(parts), len(REGIONS), squeeze=False)
    for (place, name, part), row in zip(parts, grid, strict=True):
        for axes, region in zip(row, REGIONS, strict=True):
            for colour, each in zip(COLOURS, dict.fromkeys((NONE, calibration)), strict=False):
                one = part[(part["region"] == region) & (part["calibration"] == each)]
                _curve(axes, one, colour, "uncalibrated" if each == NONE else each.replace("_", " + "))
            axes.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
            where = "all pixels" if region == "everywhere" else "near the boundary"
            axes.set(xlabel=f"Probability, {where}", ylabel="Share of vessel", xlim=(0, 1), ylim=(0, 1))
        row[0].set_title(f"{name}: {place['network']}, {place['dataset']}", fontsize="small")
        row[1].legend(fontsize="small")
    return figure


def _curve(axes: Axes, rows: pd.DataFrame, colour: str, label: str) -> None:
    bins = rows.groupby("bin")[["pixels", "probability_sum", "vessel_pixels"]].sum().reindex(range(N_BINS))
    pixels = bins["pixels"].to_numpy()
    with np.errstate(invalid="ignore", divide="ignore"):
        axes.plot(
            bins["probability_sum"] / pixels,
            bins["vessel_pixels"] / pixels,
            color=colour,
            marker="o",
            label=label,
        )
