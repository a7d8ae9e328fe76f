"""The figure of the error budget: shares by source, and true error against DSC."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments.reporting.labels import COLOURS, MARKERS, axis_label
from experiments.studies.error_budget.trial import MASKS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figures(cases: pd.DataFrame, shares: pd.DataFrame) -> dict[str, Figure]:
    """Draw the shares of every source by stage, and the true error of masks of every quality.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of registrations.
    shares : pandas.DataFrame
        Share of each source by phantom, sweep and stage.

    Returns
    -------
    dict
        Figure by file stem.
    """
    from matplotlib.figure import Figure

    drawn = shares[np.isfinite(shares["share_mm"])]
    masks = cases[(cases["kind"] == MASKS) & np.isfinite(cases["tre_mm"])]
    panels = [panel for panel, rows in ((_shares, drawn), (_masks, masks)) if len(rows)]
    if not panels:
        return {}
    figure = Figure(figsize=(6.4 * len(panels), 4.6), layout="constrained")
    count = len(cases[["phantom", "sweep"]].drop_duplicates())
    figure.suptitle(f"Sources of error and masks, {count} simulated sweep{'' if count == 1 else 's'}")
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        panel(axes, drawn if panel is _shares else masks)
        axes.grid(alpha=0.3)
    return {"error_budget": figure}


def _shares(axes: Axes, shares: pd.DataFrame) -> None:
    sources = list(dict.fromkeys(shares["source"]))
    series = list(shares.groupby(["phantom", "stage"], sort=False))
    height = 0.8 / len(series)
    for place, ((phantom, stage), own) in enumerate(series):
        values = own.groupby("source")["share_mm"]
        mean, low, high = (
            getattr(values, name)().reindex(sources).to_numpy() for name in ("mean", "min", "max")
        )
        at = np.arange(len(sources)) + height * (place - 0.5 * (len(series) - 1))
        axes.barh(
            at, mean, 0.9 * height, color=COLOURS[place % len(COLOURS)], alpha=0.7,
            xerr=np.stack([mean - low, high - mean]), label=f"{phantom}, after the {stage} stage",
        )  # fmt: skip
    axes.set_yticks(range(len(sources)), [source.replace("_", " ").capitalize() for source in sources])
    axes.invert_yaxis()
    axes.axvline(0.0, color="0.3", linewidth=0.8)
    axes.set_xlabel("Share of the TRE (mm), mean and range over sweeps")
    axes.legend(fontsize="small")


def _masks(axes: Axes, masks: pd.DataFrame) -> None:
    kinds = (
        ("Borders too far out", masks[masks["bias_mm"] > 0]),
        ("Borders too far in", masks[masks["bias_mm"] < 0]),
        ("Borders that vary", masks[masks["deviation_mm"] > 0]),
        ("Exact", masks[(masks["bias_mm"] == 0) & (masks["deviation_mm"] == 0)]),
    )
    for place, (label, own) in enumerate(kinds):
        if len(own):
            axes.plot(
                own["dsc"], own["tre_mm"], MARKERS[place], color=COLOURS[place], label=f"{label}, rigid"
            )
        later = own[np.isfinite(own["deformed_tre_mm"])]
        if len(later):
            axes.plot(
                later["dsc"], later["deformed_tre_mm"], MARKERS[place], color=COLOURS[place],
                markerfacecolor="none", label=f"{label}, deformable",
            )  # fmt: skip
    axes.set_xlabel(axis_label("dsc"))
    axes.set_ylabel(axis_label("tre_mm"))
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small")
