"""The pictures of one registered sweep: frames with both outlines, and the cloud on the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from registration import transforms

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from experiments.analysis.registration.registered_sweep import RegisteredSweep
    from registration.phantom.scan import SimulatedSweep

FRAMES_SHOWN = 6
POINTS_SHOWN = 4000
FOUND, TRUE, DEFORMED = "tab:orange", "tab:cyan", "tab:purple"


def figures(
    truth: SimulatedSweep, masks: np.ndarray, cloud_mm: np.ndarray, registered: RegisteredSweep
) -> dict[str, Figure]:
    """Draw the figures of the study.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep and its truth.
    masks : ndarray of bool, shape (n, h, w)
        Masks that the network found.
    cloud_mm : ndarray, shape (p, 3)
        Point cloud in the world frame in mm.
    registered : RegisteredSweep
        What the registration found.

    Returns
    -------
    dict
        Figures by file stem.
    """
    return {"frames": _frames(truth, masks), "registration": _registration(truth, cloud_mm, registered)}


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
        axes.set_title(f"Frame {index}")
        axes.set_axis_off()
    return figure


def _registration(truth: SimulatedSweep, cloud_mm: np.ndarray, registered: RegisteredSweep) -> Figure:
    from matplotlib.figure import Figure

    rng = np.random.default_rng(0)
    model_mm = truth.model.sample(POINTS_SHOWN, rng)
    ct_T_world, layers = registered.result.fixed_T_moving, [(model_mm, "0.75", 1.5, "Model from CT")]
    if registered.deformed is not None:
        there_mm = model_mm + registered.deformed.result.displacement(model_mm)
        layers.append((there_mm, DEFORMED, 1.5, "Model after deformation"))
    shown = cloud_mm[rng.permutation(len(cloud_mm))[:POINTS_SHOWN]]
    figure = Figure(figsize=(9, 6), layout="constrained")
    figure.suptitle("Cloud of a simulated sweep on the model from CT, in CT coordinates")
    # The longest axis of the model goes to the right, so that the vessel fills the page.
    along = int(np.ptp(model_mm, axis=0).argmax())
    across = [axis for axis in range(3) if axis != along]
    axes_of = figure.subplots(2, 1, sharex=True)
    for axes, other in zip(axes_of, across, strict=True):
        for points, colour, size, label in (
            *layers,
            (transforms.apply(truth.ct_T_world, shown), TRUE, 6.0, "True pose"),
            (transforms.apply(ct_T_world, shown), FOUND, 1.0, "Registered"),
        ):
            axes.scatter(points[:, along], points[:, other], s=size, c=colour, label=label, linewidths=0)
        _label(axes, "xyz"[along], "xyz"[other])
    figure.legend(*axes_of[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, markerscale=4)
    return figure


def _label(axes: Axes, first: str, second: str) -> None:
    axes.set_xlabel(f"{first} (mm)")
    axes.set_ylabel(f"{second} (mm)")
    axes.set_aspect("equal")
