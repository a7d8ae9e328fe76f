"""The page of the pipeline: the model from CT, the contours of the sweep on it by their distance, and what deformed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.registered_scene import (
    color_range_mm,
    deformed_layers,
    shape_layer,
)
from experiments.analysis.registration.slicer_result import SlicerResult
from experiments.reporting.scene import LineLayer, Scene
from experiments.reporting.scene_layers import BLUE, GREEN, GREY, ORANGE
from registration import transforms
from registration.geometry.shapes import points_of, transformed, with_points
from registration.metrics.surface_distance import SurfaceDistance

if TYPE_CHECKING:
    import numpy as np

    from experiments.analysis.registration.registered_sweep import RegisteredSweep
    from registration.phantom.scan import SimulatedSweep
    from registration.pipeline import Reconstructed


def pipeline_scene(
    truth: SimulatedSweep,
    cloud_mm: np.ndarray,
    built: Reconstructed | None,
    registered: RegisteredSweep,
    findings: Sequence[str],
    name: str,
) -> Scene:
    """Make the scene of one registered sweep, in the frame of the CT in mm.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep and its truth.
    cloud_mm : ndarray, shape (p, 3)
        Contours of the sweep in the world frame in mm.
    built : Reconstructed or None
        Surface and centerline; None where no surface can be made.
    registered : RegisteredSweep
        Results of the registration's stages.
    findings : sequence of str
        Sentences next to the scene, the verdict first.
    name : str
        Name of the sweep and of the network in the title.

    Returns
    -------
    Scene
        The scene: contours have the colour of their distance to the model. The reconstructed surface, the contours at
        the true pose and what the deformable stage made are at first hidden.
    """
    pose = registered.result.fixed_T_moving
    after_mm = transforms.apply(pose, cloud_mm)
    distance_mm = SurfaceDistance(truth.model)(after_mm)
    layers: list[Any] = [
        shape_layer("model from CT", truth.model, GREY, 0.35),
        shape_layer("contours, registered", after_mm, BLUE, 0.9, values_mm=distance_mm),
    ]
    if built is not None:
        moved = with_points(built.surface, transforms.apply(pose, points_of(built.surface)))
        layers.append(shape_layer("reconstructed surface, registered", moved, ORANGE, 0.6, shown=False))
        if built.centerline is not None:
            layers.append(LineLayer.of("centerline, registered", built.centerline.transformed(pose)))
    true_mm = transforms.apply(truth.ct_T_world, cloud_mm)
    layers.append(shape_layer("contours at the true pose", true_mm, GREEN, 0.9, shown=False))
    if registered.deformed is not None:
        layers += deformed_layers(registered.deformed)
    methods = [registered.rigid, *([registered.deformed.name] if registered.deformed else [])]
    return Scene(
        layers=layers,
        title=f"{name}, on its model from CT by {', '.join(methods)}",
        notes=findings,
        values_name="Distance to the model (mm)",
        values_range_mm=color_range_mm(distance_mm),
        verdict=registered.result.verdict,
    )


def pipeline_slicer_result(
    truth: SimulatedSweep,
    cloud_mm: np.ndarray,
    built: Reconstructed | None,
    registered: RegisteredSweep,
) -> SlicerResult:
    """Collect what 3D Slicer shows of one registered sweep, in the frame of the CT.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep and its truth.
    cloud_mm : ndarray, shape (p, 3)
        Contours of the sweep in the world frame in mm.
    built : Reconstructed or None
        Surface and centerline; None where no surface can be made.
    registered : RegisteredSweep
        Results of the registration's stages.

    Returns
    -------
    SlicerResult
        Model, contours, reconstructed surface, centerline, and what deformed.
    """
    pose = registered.result.fixed_T_moving
    lines, further = {}, {}
    if built is not None:
        further["reconstructed surface, moved"] = transformed(built.surface, pose)
        if built.centerline is not None:
            lines["centerline, moved"] = built.centerline.transformed(pose)
    return SlicerResult(truth.model, cloud_mm, pose, lines, further=further, deformed=registered.deformed)
