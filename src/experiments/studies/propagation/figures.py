"""The figure of the study of propagation: DSC of a sweep's masks against the errors that they leave."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.segmentation.case_table import SMOKE
from experiments.analysis.segmentation.levels import plain_name
from experiments.reporting.labels import COLOURS, MARKERS, axis_label, method_label
from experiments.studies.propagation.networks import REFERENCE
from experiments.studies.propagation.tables import ALL, several_models, things

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from experiments.studies.propagation.tables import Thing

PANELS = ("surface_rmse_mm", "tre_mm", "deformed_tre_mm")
# Places among the colours, the same in every figure of this study.
PLACES = {
    REFERENCE: 6,
    "single_session": 0,
    "full": 1,
    "pruned": 2,
    "full_as_single_session": 3,
    "full_as_pruned": 4,
}
RIGID_STAGE = "TRE, rigid stage (mm)"
# From this ratio of the largest to the smallest error on, small ones could not be told apart on a linear axis.
LOG_FROM = 20.0


def figures(cases: pd.DataFrame, correlated: pd.DataFrame) -> dict[str, Figure]:
    """Draw DSC against the error of the surface and of each stage, a marker for each sweep and network.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.
    correlated : pandas.DataFrame
        As ``correlations`` gives it.

    Returns
    -------
    dict
        Figure by file stem; none where no sweep has a DSC and an error. What failed is drawn on a line of its own above
        the others.
    """
    from matplotlib.figure import Figure

    drawn = cases[cases["dsc"].notna()]
    shown = [name for name in PANELS if np.isfinite(drawn[name]).any()]
    if not shown:
        return {}
    figure = Figure(figsize=(4.4 * len(shown) + 0.4, 4.9), layout="constrained")
    sweeps = len(drawn[["seed", "phantom", "sweep"]].drop_duplicates())
    vessels = drawn["vessel"].nunique()
    smoke = f", {SMOKE.strip()} networks" if drawn["model"].str.startswith(SMOKE).any() else ""
    figure.suptitle(
        f"Masks and what they leave: {sweeps} simulated sweep{'' if sweeps == 1 else 's'} of {vessels} "
        f"vessel{'' if vessels == 1 else 's'} (not comparable){smoke}",
        fontsize="medium",
    )
    for axes, name in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown, strict=True):
        _panel(axes, drawn, name)
        axes.set_title(_rank_correlation(correlated, name), fontsize="small")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return {"propagation": figure}


def _panel(axes: Axes, cases: pd.DataFrame, name: str) -> None:
    finite = cases.loc[np.isfinite(cases[name]), name]
    low, high = float(finite.min()), float(finite.max())
    logarithmic = high > LOG_FROM * max(low, 1e-9)
    above = 1.6 * high if logarithmic else 1.12 * high
    several = several_models(cases)
    models = list(dict.fromkeys(str(model) for model in cases["model"] if model))
    for number, (thing, own) in enumerate(things(cases)):
        values = own[name].to_numpy(dtype=np.float64)
        known = ~np.isnan(values)
        y = np.where(np.isinf(values), above, values)[known]
        place = _place(thing, number)
        marker = (
            MARKERS[models.index(thing.model) % len(MARKERS)] if several and thing.model else MARKERS[place]
        )
        axes.plot(
            own["dsc"].to_numpy()[known], y, marker, color=COLOURS[place], alpha=0.75, markersize=6,
            markeredgewidth=0.0, label=f"{_label(thing)} (n = {int(known.sum())})",
        )  # fmt: skip
    if np.isinf(cases[name]).any():
        axes.axhline(above, color="0.5", linestyle=":", linewidth=1)
        count = int(np.isinf(cases[name]).sum())
        axes.annotate(
            f"No result: {count}", (0.02, above), xycoords=("axes fraction", "data"), xytext=(0, 3),
            textcoords="offset points", fontsize="small", color="0.3",
        )  # fmt: skip
    axes.set_xlabel(f"{axis_label('dsc')}, mean over frames with vessel")
    axes.set_ylabel(RIGID_STAGE if name == "tre_mm" else axis_label(name))
    if logarithmic:
        _logarithmic(axes, low, above)
    else:
        axes.set_ylim(0, 1.08 * above)
    axes.grid(alpha=0.3)


def _logarithmic(axes: Axes, low: float, high: float) -> None:
    """Make the axis logarithmic, with ticks at round values that a reader takes in at once."""
    decades = 10.0 ** np.arange(np.floor(np.log10(max(low, 1e-3))), np.ceil(np.log10(high)) + 1)
    ticks = [value for value in np.outer(decades, (1, 2, 5)).ravel() if 0.8 * low <= value <= high]
    axes.set_yscale("log")
    axes.set_yticks(ticks, [f"{value:g}" for value in ticks])
    axes.minorticks_off()


def _place(thing: Thing, number: int) -> int:
    return PLACES.get(thing.configuration, (5, 7, 3, 4, 0, 1, 2)[number % 7])


def _label(thing: Thing) -> str:
    configuration, _, model = thing.name.partition(", ")
    name = method_label(configuration)
    return f"{name}, {method_label(plain_name(model))}" if model else name


def _rank_correlation(correlated: pd.DataFrame, error: str) -> str:
    """Spearman's correlation of the panel, with its interval and the numbers behind it."""
    rows = correlated[
        (correlated["masks"] == "dsc") & (correlated["over"] == ALL) & (correlated["error"] == error)
    ]
    if not len(rows) or not np.isfinite(rows["rho"].iloc[0]):
        return ""
    row = rows.iloc[0]
    bounds = "no interval" if np.isnan(row["low"]) else f"{row['low']:+.2f} to {row['high']:+.2f}"
    return f"Spearman {row['rho']:+.2f} ({bounds}),\nn = {row['n']}, {row['vessels']} vessels"
