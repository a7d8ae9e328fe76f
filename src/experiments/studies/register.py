"""Rigid registration of two files of a user's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import files
from experiments.outcome import Outcome, Progress
from experiments.studies.registration_inputs import (
    one_method,
    read_mm,
    read_pose,
    refuse_metres,
    require_path,
)
from registration import frames
from registration.geometry import Mesh
from registration.geometry_io import write_surface
from registration.metrics import Surface, SurfaceResiduals, surface_residuals

if TYPE_CHECKING:
    from registration.results import RigidResult

LENGTHS = ("rmse_mm", "rmse_trimmed_mm", "rmse_bidirectional_mm", "msd_mm", "hd95_mm")
SHARES = ("inlier_share", "coverage")


def run(
    *,
    moving: str | None,
    fixed: str | None,
    rigid: Mapping[str, Any],
    initial: str | None,
    moving_unit: str | None,
    fixed_unit: str | None,
    moving_points: int,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Bring ``moving`` onto ``fixed`` and leave registration.json and moved.ply (in mm) in ``workspace``.

    Meshes are sampled uniformly by area for the method; residuals are measured on the surfaces themselves. Raises
    InputError for files that cannot be registered, or for one that looks like metres beside millimetres.
    """
    name, method = one_method(rigid)
    moving_path = require_path(moving, "moving", "the file of the cloud or mesh to move")
    fixed_path = require_path(fixed, "fixed", "the file of the cloud or mesh to register to")
    start = None if initial is None else read_pose(Path(initial), "initial")
    moving_surface = read_mm(moving_path, "moving", moving_unit)
    fixed_surface = read_mm(fixed_path, "fixed", fixed_unit)
    hint = "say moving_unit=m or fixed_unit=m to convert it, or =mm to take it as it is"
    refuse_metres(moving_surface, fixed_surface, "moving", moving_unit, hint)
    refuse_metres(fixed_surface, moving_surface, "fixed", fixed_unit, hint)
    draws = np.random.default_rng(seed).spawn(2)
    progress.note(f"registering {moving_path.name} to {fixed_path.name} by {name}")
    result: RigidResult = method(
        _cloud(moving_surface, moving_points, draws[0]), _cloud(fixed_surface, fixed_points, draws[1]), start
    )
    residuals = surface_residuals(
        moving_surface, fixed_surface, result.fixed_T_moving, inlier_mm=inlier_mm, keep=keep, seed=seed
    )
    record = _record(result, residuals, name, moving_path, fixed_path, fixed_surface)
    files.write_text(workspace / "registration.json", json.dumps(record, indent=2, allow_nan=False) + "\n")
    write_surface(workspace / "moved.ply", _moved(moving_surface, result.fixed_T_moving))
    return _outcome(result, residuals, name)


def _cloud(surface: Surface, count: int, rng: np.random.Generator) -> np.ndarray:
    return surface.sample(count, rng) if isinstance(surface, Mesh) else surface


def _moved(surface: Surface, fixed_T_moving: np.ndarray) -> Surface:
    if isinstance(surface, Mesh):
        return Mesh(frames.apply(fixed_T_moving, surface.vertices_mm), surface.triangles)
    return frames.apply(fixed_T_moving, surface)


def _record(
    result: RigidResult,
    residuals: SurfaceResiduals,
    name: str,
    moving_path: Path,
    fixed_path: Path,
    fixed_surface: Surface,
) -> dict[str, Any]:
    measured = {key: getattr(residuals, key) for key in (*LENGTHS, *SHARES)}
    return {
        "moving": str(moving_path),
        "fixed": str(fixed_path),
        "rigid": name,
        "units": {"length": "mm", "time": "s"},
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        **measured,
        "distances_to": "triangles" if isinstance(fixed_surface, Mesh) else "points",
        "iterations": result.iterations,
        "converged": result.converged,
        "candidates": [
            {
                "fixed_T_moving": candidate.fixed_T_moving.tolist(),
                "rmse_mm": candidate.rmse_mm,
                "basin": candidate.basin,
                "starts": candidate.starts,
                "stage": candidate.stage,
            }
            for candidate in result.candidates
        ],
        "runtime_s": result.runtime_s,
    }


def _outcome(result: RigidResult, residuals: SurfaceResiduals, name: str) -> Outcome:
    import pandas as pd

    metrics = {key: float(getattr(residuals, key)) for key in (*LENGTHS, *SHARES)}
    metrics |= {"iterations": float(result.iterations), "runtime_s": result.runtime_s}
    table = pd.DataFrame([{"rigid": name, "converged": result.converged, **metrics}])
    findings = [
        f"{name} left {residuals.rmse_mm:.3f} mm RMSE ({residuals.rmse_trimmed_mm:.3f} mm trimmed) after "
        f"{result.runtime_s:.2f} s; a low residual alone does not prove the pose of a straight or symmetric vessel.",
        "registration.json holds the pose and all candidates, moved.ply the moved surface in mm.",
    ]
    if not result.converged:
        findings.insert(1, "The method stopped at its limit of iterations before it converged.")
    return Outcome(
        metrics={
            **metrics,
            "converged": float(result.converged),
            "candidates": float(len(result.candidates)),
        },
        tables={"registration": table},
        findings=tuple(findings),
        tags={"rigid": name},
    )
