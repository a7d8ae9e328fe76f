"""What the segmentation study shows: one table, plain sentences, training curves, outlines, the spread of scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from models.labelled_frames import LabelledFrames
from models.scoring import CaseScore, summarise

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DISTANCES = ("hd95_mm", "hd95_px")
REFERENCE_COLOUR, PREDICTION_COLOUR = "tab:green", "tab:red"


def pooled_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """The summary of every score over all cases; of several models or data sets, each under its own name."""
    groups = list(_groups(cases))
    metrics: dict[str, float] = {}
    for model, label, group in groups:
        place = f"{model}/{label.split()[0]}/" if len(groups) > 1 else ""
        metrics |= {f"{place}{key}": value for key, value in _summary(group).items()}
    return metrics


def table(cases: pd.DataFrame) -> pd.DataFrame:
    """DSC and HD95 by model, data set and fold, and over all folds."""
    import pandas as pd

    rows = []
    for model, label, group in _groups(cases):
        parts = [(str(fold), part) for fold, part in group.groupby("fold")]
        for fold, part in [*parts, ("all", group)] if len(parts) > 1 else parts:
            numbers = _summary(part)
            row: dict[str, object] = {"model": model, "dataset": label, "fold": fold, "cases": len(part)}
            for score in ("dsc", *(name for name in DISTANCES if name in cases)):
                row |= {key: numbers.get(key, np.nan) for key in (f"{score}_mean", f"{score}_std")}
                row[f"{score}_median"] = numbers.get(f"{score}_median", np.nan)
            row |= {key: numbers.get(key, np.nan) for key in ("missed_rate", "false_alarm_rate")}
            rows.append(row)
    return pd.DataFrame(rows)


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """One sentence for each model and data set."""
    sentences = []
    for model, label, group in _groups(cases):
        shown, empty = group["missed"].notna(), group["false_alarm"].notna()
        folds = ", ".join(str(fold) for fold in sorted(group["fold"].unique()))
        distance = _distance(group)
        sentences.append(
            f"{model} on {label}, fold {folds}: mean DSC {group['dsc'].mean():.3f} and mean "
            f"{distance} {group[distance].mean():.2f} over {shown.sum()} unseen cases with a vessel, "
            f"{int(group['missed'].sum())} of them missed; "
            f"{int(group['false_alarm'].sum())} false alarms in {empty.sum()} without one."
        )
    return tuple(sentences)


def training_curves(history: Sequence[Mapping[str, float]], best_epoch: int, title: str) -> Figure:
    """Losses and validation DSC by epoch, with the epoch whose weights were kept."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    losses, dsc = figure.subplots(1, 2)
    for axes, names in ((losses, ("train_loss", "validation_loss")), (dsc, ("validation_dsc",))):
        for name in names:
            axes.plot([epoch.get(name, np.nan) for epoch in history], marker=".", label=name)
        axes.axvline(best_epoch, color="grey", linestyle=":", label="best epoch")
        axes.set(xlabel="epoch")
        axes.grid(alpha=0.3)
        axes.legend()
    dsc.set(ylim=(-0.02, 1.02))
    figure.suptitle(title, fontsize="small", wrap=True)
    return figure


def overlays(
    frames: LabelledFrames, predictions: Mapping[str, np.ndarray], cases: pd.DataFrame
) -> dict[str, Figure]:
    """Outlines of prediction and reference on the cases with the best, the median and the worst DSC."""
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
        distance = _distance(cases)
        axes.set_title(f"{rank}: {row['case_id']}\ndsc {row['dsc']:.3f}, {distance} {row[distance]:.2f}")
        axes.axis("off")
    simulated = " (simulated)" if frames.simulated else ""
    figure.supxlabel(f"reference green, prediction red dashed{simulated}", fontsize="small")
    return {"overlays": figure}


def spread(cases: pd.DataFrame) -> Figure:
    """Box plots of DSC and HD95 by model and data set: quartiles, whiskers to 1.5 of their range, all else dots."""
    from matplotlib.figure import Figure

    scores = ["dsc", *(name for name in DISTANCES if name in cases and cases[name].notna().any())]
    groups = list(_groups(cases))
    figure = Figure(figsize=(3.2 * len(scores) + 0.8 * len(groups), 4.0), layout="constrained")
    for axes, score in zip(np.atleast_1d(figure.subplots(1, len(scores))), scores, strict=True):
        labels = [f"{model}\n{label}" for model, label, _ in groups]
        axes.boxplot([group[score].dropna() for *_, group in groups], tick_labels=labels, showmeans=True)
        axes.set(ylabel=score)
        axes.grid(axis="y", alpha=0.3)
    return figure


def _outline(axes: Axes, mask: np.ndarray, colour: str, style: str) -> None:
    # A frame of background closes the outline of a vessel at the image's edge; none is drawn for an empty mask.
    if mask.any():
        rows, columns = (np.arange(-1, side + 1) for side in mask.shape)
        axes.contour(
            columns, rows, np.pad(mask, 1), levels=[0.5], colors=colour, linestyles=style, linewidths=1.0
        )


def _summary(cases: pd.DataFrame) -> dict[str, float]:
    return summarise({name: cases[name] for name in CaseScore.__dataclass_fields__ if name in cases})


def _distance(cases: pd.DataFrame) -> str:
    """The distance in mm where the cases have one."""
    return next((name for name in DISTANCES if name in cases and cases[name].notna().any()), DISTANCES[-1])


def _groups(cases: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Model, data set (marked where simulated) and cases of each pair of the two."""
    for key, group in cases.groupby(["model", "dataset", "simulated"], sort=False):
        model, dataset, simulated = key
        yield str(model), f"{dataset} (simulated)" if simulated else str(dataset), group
