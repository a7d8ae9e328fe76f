"""The pictures of one registered sweep: frames with both outlines, and the cloud on the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from registration import frames

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from registration.phantom.scan import SimulatedSweep

FRAMES_SHOWN = 6
POINTS_SHOWN = 4000
FOUND, TRUE = "tab:orange", "tab:cyan"


def figures(
    truth: SimulatedSweep, masks: np.ndarray, cloud_mm: np.ndarray, ct_T_world: np.ndarray
) -> dict[str, Figure]:
    """The figures of the study by file stem; ``masks`` (n, h, w) bool, ``cloud_mm`` (p, 3) in the world."""
    return {"frames": _frames(truth, masks), "registration": _registration(truth, cloud_mm, ct_T_world)}


def _frames(truth: SimulatedSweep, masks: np.ndarray) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3 * FRAMES_SHOWN, 3.4), layout="constrained")
    figure.suptitle("Frames of the sweep (simulated): vessel found (orange) and true (cyan)")
    shown = np.linspace(0, len(masks) - 1, FRAMES_SHOWN).round().astype(int)
    for axes, index in zip(figure.subplots(1, FRAMES_SHOWN), shown, strict=True):
        axes.imshow(truth.sweep.images[index], cmap="gray", vmin=0, vmax=255)
        for mask, colour in ((truth.masks[index], TRUE), (masks[index], FOUND)):
            if mask.any() and not mask.all():
                axes.contour(mask, levels=[0.5], colors=[colour], linewidths=1.2)
        axes.set_title(f"frame {index}")
        axes.set_axis_off()
    return figure


def _registration(truth: SimulatedSweep, cloud_mm: np.ndarray, ct_T_world: np.ndarray) -> Figure:
    from matplotlib.figure import Figure

    rng = np.random.default_rng(0)
    model_mm = truth.model.sample(POINTS_SHOWN, rng)
    shown = cloud_mm[rng.permutation(len(cloud_mm))[:POINTS_SHOWN]]
    figure = Figure(figsize=(12, 5), layout="constrained")
    figure.suptitle(
        "Cloud of the sweep (orange) on the model from CT (grey), in the ct frame, mm (simulated)"
    )
    axes_of = figure.subplots(1, 2)
    for axes, (first, second) in zip(axes_of, ((2, 0), (2, 1)), strict=True):
        for points, colour, label in (
            (model_mm, "0.6", "model"),
            (frames.apply(ct_T_world, shown), FOUND, "registered"),
            (frames.apply(truth.ct_T_world, shown), TRUE, "at its true place"),
        ):
            axes.scatter(points[:, first], points[:, second], s=1.5, c=colour, label=label, linewidths=0)
        _label(axes, "xyz"[first], "xyz"[second])
    axes_of[0].legend(markerscale=6)
    return figure


def _label(axes: Axes, first: str, second: str) -> None:
    axes.set_xlabel(f"{first} / mm")
    axes.set_ylabel(f"{second} / mm")
    axes.set_aspect("equal")
