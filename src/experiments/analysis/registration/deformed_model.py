"""What the deformable stage of a registration leaves: files, its block of registration.json, and what is to be said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64, Int64

from experiments.analysis.registration.pose_scores import plain, plain_metrics
from registration.errors import InputError
from registration.geometry.shapes import Surface, points_of, with_points
from registration.metrics.surface_distance import SurfaceResiduals, surface_residuals
from registration.metrics.targets import target_points
from registration.rigid.result import length_mm

if TYPE_CHECKING:
    from registration.cpd import CoherentPointDrift
    from registration.deformable.landmark_constraints import LandmarkConstraints
    from registration.deformable.result import DeformableResult

SIDES = ("fixed", "moving")
# The grid in files reaches so far beyond the model, and has at most so many nodes.
MARGIN_MM, GRID_NODES, FINEST_MM = 10.0, 200_000, 2.0


@dataclass(frozen=True)
class Deformed:
    """Result of the deformable stage.

    Parameters
    ----------
    name : str
        Name of the method.
    model_side : str
        The side whose material the field displaces: fixed or moving.
    result : DeformableResult
        Displacement from the model, in the fixed frame after the rigid pose, to where the sweep has seen it.
    model : Surface
        Model in the fixed frame, before the displacement.
    model_deformed : Surface
        Model where the sweep has seen it.
    moved : Surface
        What moves, after both stages, in the fixed frame.
    residuals : SurfaceResiduals
        Residuals between both surfaces after both stages.
    predicted_tre_mm : tuple of float
        The 90 % interval of the error at targets of the model; NaN where none is predicted.
    """

    name: str
    model_side: str
    result: DeformableResult
    model: Surface
    model_deformed: Surface
    moved: Surface
    residuals: SurfaceResiduals
    predicted_tre_mm: tuple[float, float]


def displace(
    name: str,
    method: CoherentPointDrift,
    side: str,
    surfaces: Mapping[str, Surface],
    clouds: Mapping[str, Float64[np.ndarray, "n 3"]],
    frame: Int64[np.ndarray, " n"] | None,
    landmarks: LandmarkConstraints | None = None,
    *,
    inlier_mm: float,
    keep: float,
    seed: int,
) -> tuple[Deformed | None, str]:
    """Displace the model onto what the sweep has seen of it, after the rigid pose.

    Parameters
    ----------
    name : str
        Name of the method.
    method : CoherentPointDrift
        The method.
    side : str
        Side of the model, whose material is displaced: fixed or moving.
    surfaces : Mapping[str, Surface]
        Surface of either side in mm, in the fixed frame after the rigid pose.
    clouds : Mapping[str, ndarray], shape (n, 3)
        Points of either side that the method is given, likewise.
    frame : ndarray of int, shape (n,), or None
        Frame that each point of the other side was seen in; None where it is no sweep.
    landmarks : LandmarkConstraints or None, optional
        Pairs of points that are the same material; None where none are to pull.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.

    Returns
    -------
    found : Deformed or None
        The result; None where the clouds are refused, or the field cannot be inverted where that is needed.
    refusal : str
        Why there is none; empty otherwise.
    """
    other = SIDES[1 - SIDES.index(side)]
    moving = surfaces["moving"]
    try:
        result = method(clouds[side], clouds[other], fixed_frame=frame, landmarks=landmarks, seed=seed)
        shift = result.displacement if side == "moving" else result.inverse
        moved = with_points(moving, points_of(moving) + shift(points_of(moving)))
    except InputError as refused:
        # The method names the clouds by their part in it, which is not that of the sides.
        return None, str(refused).replace("moving_mm", side).replace("fixed_mm", other)
    residuals = surface_residuals(
        moved, surfaces["fixed"], np.eye(4), inlier_mm=inlier_mm, keep=keep, seed=seed
    )
    model = surfaces[side]
    there = with_points(model, points_of(model) + result.displacement(points_of(model)))
    predicted = result.tre_interval_mm(target_points(model))
    return Deformed(name, side, result, model, there, moved, residuals, predicted), ""


def write_deformed(found: Deformed, workspace: Path) -> None:
    """Write moved_deformed.ply, model_deformed.ply and the displacement as displacement.npz, .nrrd and .h5.

    Parameters
    ----------
    found : Deformed
        Result of the deformable stage.
    workspace : Path
        Folder of the run in which result files are left.
    """
    from registration.io.displacement_fields import (
        sample_grid,
        write_displacement_grid,
        write_displacement_transform,
    )
    from registration.io.surfaces import write_surface

    write_surface(workspace / "moved_deformed.ply", found.moved)
    write_surface(workspace / "model_deformed.ply", found.model_deformed)
    points_mm = points_of(found.model)
    np.savez_compressed(
        workspace / "displacement.npz",
        points_mm=points_mm,
        displacement_mm=points_of(found.model_deformed) - points_mm,
    )
    low_mm, high_mm = points_mm.min(axis=0) - MARGIN_MM, points_mm.max(axis=0) + MARGIN_MM
    # A smooth field needs no finer grid than its nodes can afford.
    spacing_mm = max(FINEST_MM, float(np.cbrt(np.prod(high_mm - low_mm + 2 * FINEST_MM) / GRID_NODES)))
    grid = sample_grid(found.result.displacement, low_mm, high_mm, spacing_mm, max_nodes=2 * GRID_NODES)
    write_displacement_grid(workspace / "displacement.nrrd", grid, "lps")
    write_displacement_transform(workspace / "displacement.h5", grid, "lps")


def deformed_record(found: Deformed | None, keys: tuple[str, ...]) -> dict[str, Any] | None:
    """Make the block ``deformable`` of registration.json.

    Parameters
    ----------
    found : Deformed or None
        Result of the deformable stage; None without one.
    keys : tuple of str
        Names of the residuals to give.

    Returns
    -------
    dict or None
        Content, ready for JSON; a number that is not finite is None.
    """
    if found is None:
        return None
    result = found.result
    low_mm, high_mm = found.predicted_tre_mm
    numbers = {
        "size_mm": result.size_mm,
        "gain": result.gain,
        **{key: getattr(found.residuals, key) for key in keys},
        **asdict(result.plausibility),
        "runtime_s": result.runtime_s,
    }
    return {
        "method": found.name,
        "model_side": found.model_side,
        "verdict": result.verdict,
        "reason": result.reason,
        **plain_metrics(numbers),
        "iterations": result.iterations,
        "converged": result.converged,
        "predicted_tre_mm": {
            "low": plain(low_mm),
            "high": plain(high_mm),
            "level": 0.9,
        },
        "files": {
            "displacement": ["displacement.npz", "displacement.nrrd", "displacement.h5"],
            "maps": "model points in the fixed frame after fixed_T_moving to where they were swept, mm, LPS",
        },
    }


def deformed_sentences(found: Deformed, rigid_rmse_mm: float) -> list[str]:
    """Say what the deformable stage found.

    Parameters
    ----------
    found : Deformed
        Result of the deformable stage.
    rigid_rmse_mm : float
        Residual of the rigid stage in mm.

    Returns
    -------
    list of str
        Sentences.
    """
    result = found.result
    sentences = [
        f"Deformable registration ({found.name}) of the {found.model_side} side: {result.verdict}, {result.reason}; "
        f"RMSE {rigid_rmse_mm:.3f} to {found.residuals.rmse_mm:.3f} mm, which is no accuracy; 95th-percentile strain "
        f"{100 * result.plausibility.strain_p95:.1f} %, smallest volume factor {result.plausibility.jacobian_min:.2f}."
    ]
    if not result.converged:
        sentences.append(
            f"The pairs of points had not come to rest after {result.iterations} iterations: the displacement may "
            "still change with more of them (max_iterations, see --help)."
        )
    low_mm, high_mm = found.predicted_tre_mm
    if math.isfinite(high_mm):
        sentences.append(
            f"Predicted error of the displaced model {length_mm(low_mm)} to {length_mm(high_mm)} (90 %), over all "
            "of it, also where nothing was swept."
        )
    return sentences
