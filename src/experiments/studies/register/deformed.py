"""The deformable stage of a registration: which side is displaced, what it leaves, and what is to be said of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.pose_scores import plain, plain_metrics
from experiments.errors import InputError
from experiments.studies.register.pair import Pair
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Surface, diagonal_mm, points_of, sampled, transformed, with_points
from registration.metrics.surface_distance import SurfaceResiduals, surface_residuals
from registration.metrics.targets import target_points
from registration.rigid.result import FAILED, length_mm

if TYPE_CHECKING:
    from registration.cpd import CoherentPointDrift
    from registration.deformable.result import DeformableResult
    from registration.rigid.result import RigidResult

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


def require_side(model_side: str | None) -> None:
    """Check the setting ``model_side``.

    Parameters
    ----------
    model_side : str or None
        Side of the model; None chooses.

    Raises
    ------
    InputError
        If it is no side.
    """
    if model_side is not None and model_side not in SIDES:
        raise InputError(f"model_side: expected fixed, moving or null, received {model_side!r}")


def deform(
    name: str,
    method: CoherentPointDrift,
    pair: Pair,
    rigid: RigidResult,
    model_side: str | None,
    *,
    points: Mapping[str, int],
    inlier_mm: float,
    keep: float,
    seed: int,
) -> tuple[Deformed | None, str]:
    """Displace the model's side onto the other after the rigid pose.

    What the deformable stage refuses is no reason to lose the rigid result.

    Parameters
    ----------
    name : str
        Name of the method.
    method : CoherentPointDrift
        The method.
    pair : Pair
        Both sides.
    rigid : RigidResult
        Result of the rigid stage.
    model_side : str or None
        Side of the model; None takes the side that is no sweep, else the longer one.
    points : Mapping[str, int]
        Number of points sampled from a mesh, by side.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.

    Returns
    -------
    found : Deformed or None
        The result; None after a rigid stage that failed, or where the clouds are refused.
    refusal : str
        Why there is none; empty otherwise.
    """
    if rigid.verdict == FAILED:
        return None, "the rigid registration failed"
    side = model_side or _model_side(pair)
    pose = rigid.fixed_T_moving
    surfaces = {"fixed": pair.fixed.surface, "moving": transformed(pair.moving.surface, pose)}
    draws = dict(zip(SIDES, np.random.default_rng([seed, 2]).spawn(2), strict=True))
    other = SIDES[1 - SIDES.index(side)]
    clouds = {each: sampled(surfaces[each], points[each], draws[each]) for each in SIDES}
    frame = pair.moving.frame if other == "moving" else None
    moving = surfaces["moving"]
    try:
        result = method(clouds[side], clouds[other], fixed_frame=frame, seed=seed)
        shift = result.displacement if side == "moving" else result.inverse
        moved = with_points(moving, points_of(moving) + shift(points_of(moving)))
    except RegistrationInputError as refused:
        # The method names the clouds by their part in it, which is not that of the files.
        return None, str(refused).replace("moving_mm", side).replace("fixed_mm", other)
    residuals = surface_residuals(
        moved, pair.fixed.surface, np.eye(4), inlier_mm=inlier_mm, keep=keep, seed=seed
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
        sentences.append(f"The pairs of points had not come to rest after {result.iterations} iterations.")
    low_mm, high_mm = found.predicted_tre_mm
    if math.isfinite(high_mm):
        sentences.append(
            f"Predicted error of the displaced model {length_mm(low_mm)} to {length_mm(high_mm)} (90 %), over all "
            "of it, also where nothing was swept."
        )
    return sentences


def _model_side(pair: Pair) -> str:
    if pair.moving.frame is not None:
        return "fixed"
    sizes_mm = [diagonal_mm(points_of(side.surface)) for side in (pair.fixed, pair.moving)]
    return SIDES[int(sizes_mm[1] > sizes_mm[0])]
