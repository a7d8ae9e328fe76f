"""The page of a registration: the fixed surface, the moving one before and after, and how far it still is from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.analysis.registration.deformed_model import Deformed
from experiments.analysis.registration.registered_scene import color_range_mm, deformed_layers, shape_layer
from experiments.reporting.scene import CloudLayer, LineLayer, Scene
from experiments.reporting.scene_layers import BLUE, GREY, ORANGE, RED
from experiments.studies.register.pair import Pair
from registration import transforms
from registration.geometry.shapes import diagonal_mm, points_of, with_points
from registration.metrics.surface_distance import SurfaceDistance

# What lies farther away before registration than this many times the fixed surface's size would shrink all else to a
# speck.
FAR_SIZES = 5.0


def register_scene(
    pair: Pair,
    fixed_T_moving: np.ndarray,
    method: str,
    findings: Sequence[str],
    rival_fixed_T_moving: np.ndarray | None = None,
    deformed: Deformed | None = None,
    verdict: str = "",
) -> Scene:
    """Make the scene in the frame of the fixed file, in mm.

    What moves is shown before (at first hidden) and after registration. After registration every vertex or
    point has the colour of its distance to the fixed surface.

    Parameters
    ----------
    pair : Pair
        Both sides.
    fixed_T_moving : ndarray, shape (4, 4)
        Rigid transform from the moving to the fixed frame.
    method : str
        Name of the method in the title.
    findings : sequence of str
        Sentences next to the scene, the verdict first.
    rival_fixed_T_moving : ndarray, shape (4, 4), or None, optional
        Another pose that explains the clouds as well, shown beside the result; None shows none.
    deformed : Deformed or None, optional
        Result of the deformable stage, at first hidden; None for none.
    verdict : str, optional
        Verdict of the rigid stage, shown as a badge.

    Returns
    -------
    Scene
        The scene.
    """
    fixed, moving = pair.fixed.surface, pair.moving.surface
    after_mm = transforms.apply(fixed_T_moving, points_of(moving))
    distance_mm = SurfaceDistance(fixed)(after_mm)
    layers: list[Any] = [shape_layer("fixed", fixed, GREY, 0.35)]
    notes = list(findings)
    away_mm = float(np.linalg.norm(points_of(moving).mean(axis=0) - points_of(fixed).mean(axis=0)))
    if away_mm <= FAR_SIZES * diagonal_mm(points_of(fixed)):
        layers.append(shape_layer("moving, before", moving, ORANGE, 0.35, shown=False))
    else:
        notes.append(
            f"Before registration the moving file lies {away_mm:.0f} mm away; it is not shown there."
        )
    # Opaque, or the colours of the far side would mix with those of the near one.
    layers.append(
        shape_layer("moving, after", with_points(moving, after_mm), BLUE, 1.0, values_mm=distance_mm)
    )
    if rival_fixed_T_moving is not None:
        rival_mm = transforms.apply(rival_fixed_T_moving, points_of(moving))
        layers.append(shape_layer("moving, rival pose", with_points(moving, rival_mm), ORANGE, 0.35))
    if deformed is not None:
        layers += deformed_layers(deformed)
    layers += _lines(pair, fixed_T_moving)
    if pair.landmarks is not None:
        brought_mm = transforms.apply(fixed_T_moving, pair.landmarks.moving_mm)
        layers.append(CloudLayer("landmarks, fixed", pair.landmarks.fixed_mm, RED, 6.0))
        layers.append(CloudLayer("landmarks, moving after", brought_mm, BLUE, 6.0))
    return Scene(
        layers=layers,
        title=f"{pair.moving.path.name} on {pair.fixed.path.name} by {method}",
        notes=notes,
        space="fixed (LPS)",
        values_name="Distance to fixed (mm)",
        values_range_mm=color_range_mm(distance_mm),
        verdict=verdict,
    )


def _lines(pair: Pair, fixed_T_moving: np.ndarray) -> list[LineLayer]:
    """The centerlines of both sides, where there are any."""
    lines = []
    if pair.fixed.centerline is not None:
        lines.append(LineLayer.of("centerline, fixed", pair.fixed.centerline))
    if (moving := pair.moving.centerline) is not None:
        lines.append(
            LineLayer.of("centerline, moving after", moving.transformed(fixed_T_moving), dash="dash")
        )
    return lines
