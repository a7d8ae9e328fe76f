"""The figures of the segmentation study: training curves, outlines on the frames, the spread of scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.segmentation.case_table import CASE, distance, groups, scores
from experiments.reporting.labels import COLOURS, axis_label, method_label
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REFERENCE_COLOUR, PREDICTION_COLOUR = "#56B4E9", "#E69F00"
LEGEND = "Dot: mean of a group; grey: a case beyond the whiskers; a missed vessel: DSC 0, HD95 the image's diagonal"


def training_curves(history: Sequence[Mapping[str, float]], best_epoch: int, title: str) -> Figure:
    """Draw losses and validation DSC by epoch, and the epoch whose weights were kept.

    Parameters
    ----------
    history : sequence of Mapping[str, float]
        Metrics of each epoch, from 0.
    best_epoch : int
        Epoch whose weights were kept.
    title : str
        Title of the figure.

    Returns
    -------
    Figure
        Two axes next to each other.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    losses, dsc = figure.subplots(1, 2)
    for axes, names in ((losses, ("train_loss", "validation_loss")), (dsc, ("validation_dsc",))):
        for name in names:
            axes.plot([epoch.get(name, np.nan) for epoch in history], marker=".", label=axis_label(name))
        axes.axvline(best_epoch, color="grey", linestyle=":", label="Best epoch")
        axes.set(xlabel="Epoch")
        axes.grid(alpha=0.3)
        axes.legend()
    dsc.set(ylim=(-0.02, 1.02))
    figure.suptitle(title, fontsize="small", wrap=True)
    return figure


def overlays(
    frames: LabelledFrames, predictions: Mapping[str, np.ndarray], cases: pd.DataFrame
) -> dict[str, Figure]:
    """Draw the outlines of prediction and reference on the cases with the best, the median and the worst DSC.

    Parameters
    ----------
    frames : LabelledFrames
        Images with their reference masks.
    predictions : Mapping[str, ndarray]
        Predicted mask of each case at native resolution, by case.
    cases : pandas.DataFrame
        Per-case table of these predictions.

    Returns
    -------
    dict
        One figure by its file stem; empty if no case has a DSC.
    """
    from matplotlib.figure import Figure

    ranked = cases[cases["dsc"].notna()].sort_values("dsc", ascending=False, ignore_index=True)
    if not len(ranked):
        return {}
    figure = Figure(figsize=(10.5, 3.9), layout="constrained")
    places = {"best": 0, "median": len(ranked) // 2, "worst": len(ranked) - 1}
    for axes, (rank, place) in zip(figure.subplots(1, 3), places.items(), strict=True):
        row = ranked.iloc[place]
        index = frames.case_ids.index(row["case_id"])
        axes.imshow(frames.images[index], cmap="gray", vmin=0, vmax=255)
        _outline(axes, frames.masks[index], REFERENCE_COLOUR, "solid")
        _outline(axes, predictions[row["case_id"]], PREDICTION_COLOUR, "dashed")
        measure = distance(cases)
        axes.set_title(
            f"{rank}: {row['case_id']}\nDSC {row['dsc']:.3f}, HD95 {row[measure]:.2f} {measure[-2:]}"
        )
        axes.axis("off")
    simulated = " (simulated)" if frames.simulated else ""
    figure.supxlabel(f"Reference: blue, solid; prediction: orange, dashed{simulated}", fontsize="small")
    return {"overlays": figure}


def spread(cases: pd.DataFrame) -> Figure:
    """Draw box plots of DSC and HD95 over cases by model and fold, a row of axes for each data set.

    Boxes are quartiles with the median, whiskers reach to 1.5 times their range. Cases beyond are grey; a dot
    is the mean of a group, the unit of every interval and test. HD95 is in mm if the data set has it, else in
    px, on an axis that is linear up to 1 and logarithmic beyond.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.figure import Figure

    parts = list(groups(cases))
    labels = list(dict.fromkeys(label for _, label, _ in parts))
    models = list(dict.fromkeys(model for model, *_ in parts))
    folds = sorted(cases["fold"].unique())
    width = max(2.9, 0.9 + 0.34 * len(models) * len(folds), 1.0 + 1.1 * len(models))
    figure = Figure(figsize=(2 * width, 3.2 * len(labels) + 0.7), layout="constrained")
    grid = figure.subplots(len(labels), 2, squeeze=False)
    for row, label in zip(grid, labels, strict=True):
        shown = {model: group for model, place, group in parts if place == label}
        measures = ("dsc", distance(cases[cases["dataset"].isin(next(iter(shown.values()))["dataset"])]))
        for axes, measure in zip(row, measures, strict=True):
            _boxes(axes, shown, models, folds, measure)
            axes.set_title(label, fontsize="medium")
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(names), fontsize="small")
    figure.supxlabel(LEGEND, fontsize="small", wrap=True)
    return figure


def _boxes(
    axes: Axes, shown: Mapping[str, pd.DataFrame], models: Sequence[str], folds: Sequence[int], measure: str
) -> None:
    from matplotlib.ticker import FuncFormatter

    colours = [COLOURS[number % len(COLOURS)] for number in range(len(folds))]
    width = 0.8 / len(folds)
    for number, (fold, colour) in enumerate(zip(folds, colours, strict=True)):
        axes.plot([], [], "s", color=colour, alpha=0.6, label=f"Fold {fold}")
        for place, model in enumerate(models):
            rows = _of_fold(shown.get(model), fold, measure)
            if rows is not None:
                _box(axes, rows, measure, place + (number - (len(folds) - 1) / 2) * width, width, colour)
    axes.set(ylabel=axis_label(measure), xticks=range(len(models)), xlim=(-0.6, len(models) - 0.4))
    axes.set_xticklabels([method_label(model) for model in models])
    axes.grid(axis="y", alpha=0.3)
    if measure == "dsc":
        axes.set_ylim(-0.03, 1.03)
    else:
        axes.set_yscale("symlog", linthresh=1.0)
        # Where no case has a vessel there is no distance, and nothing to scale the axis by.
        axes.set_ylim(0, 1.5 * axes.dataLim.y1 if np.isfinite(axes.dataLim.y1) else 1.0)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _box(axes: Axes, rows: pd.DataFrame, measure: str, middle: float, width: float, colour: str) -> None:
    axes.boxplot(
        [rows[measure]],
        positions=[middle],
        widths=0.85 * width,
        manage_ticks=False,
        patch_artist=True,
        boxprops={"facecolor": (colour, 0.3), "edgecolor": colour},
        whiskerprops={"color": colour},
        capprops={"color": colour},
        medianprops={"color": "black"},
        flierprops={"marker": ".", "markersize": 3, "markeredgecolor": "grey"},
    )
    means = rows.groupby("group")[measure].mean()
    # Spread evenly over the box in the order of their names: the same figure every time.
    aside = np.linspace(-0.3, 0.3, len(means)) * width if len(means) > 1 else np.zeros(1)
    axes.plot(middle + aside, means, "o", color=colour, markersize=3, markeredgewidth=0)


def _of_fold(cases: pd.DataFrame | None, fold: int, measure: str) -> pd.DataFrame | None:
    """The cases of a fold that have the measure, each once over its seeds."""
    if cases is None:
        return None
    rows = cases[cases["fold"] == fold].dropna(subset=measure)
    keys = [name for name in CASE if name in rows]
    return rows.groupby(keys, as_index=False, dropna=False)[scores(rows)].mean() if len(rows) else None


def _outline(axes: Axes, mask: np.ndarray, colour: str, style: str) -> None:
    # A frame of background closes the outline of a vessel at the image's edge; none is drawn for an empty mask.
    if mask.any():
        rows, columns = (np.arange(-1, side + 1) for side in mask.shape)
        axes.contour(
            columns, rows, np.pad(mask, 1), levels=[0.5], colors=colour, linestyles=style, linewidths=1.0
        )
