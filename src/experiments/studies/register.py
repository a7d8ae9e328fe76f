"""Rigid registration of two files of a user's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import files
from experiments.outcome import InputData, Outcome, Progress
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


def check(
    *,
    moving: str,
    fixed: str,
    rigid: Mapping[str, Any],
    initial: str | None,
    moving_unit: str | None,
    fixed_unit: str | None,
) -> None:
    """Raise InputError for files and settings that cannot be registered."""
    one_method(rigid)
    _read(moving, fixed, initial, moving_unit, fixed_unit)


def run(
    *,
    moving: str,
    fixed: str,
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
    pair = _read(moving, fixed, initial, moving_unit, fixed_unit)
    draws = np.random.default_rng(seed).spawn(2)
    progress.note(f"registering {pair.moving_path.name} to {pair.fixed_path.name} by {name}")
    result: RigidResult = method(
        _cloud(pair.moving, moving_points, draws[0]), _cloud(pair.fixed, fixed_points, draws[1]), pair.initial
    )
    residuals = surface_residuals(
        pair.moving, pair.fixed, result.fixed_T_moving, inlier_mm=inlier_mm, keep=keep, seed=seed
    )
    record = json.dumps(_record(result, residuals, name, pair), indent=2, allow_nan=False)
    files.write_text(workspace / "registration.json", record + "\n")
    write_surface(workspace / "moved.ply", _moved(pair.moving, result.fixed_T_moving))
    return _outcome(result, residuals, name, pair)


@dataclass(frozen=True)
class _Pair:
    """Both surfaces in mm, where they came from, and the pose to search around, if there is one."""

    moving_path: Path
    fixed_path: Path
    moving: Surface
    fixed: Surface
    initial: np.ndarray | None


def _read(
    moving: str, fixed: str, initial: str | None, moving_unit: str | None, fixed_unit: str | None
) -> _Pair:
    pair = _Pair(
        moving_path=require_path(moving, "moving", "the file of the cloud or mesh to move"),
        fixed_path=require_path(fixed, "fixed", "the file of the cloud or mesh to register to"),
        moving=read_mm(Path(moving), "moving", moving_unit),
        fixed=read_mm(Path(fixed), "fixed", fixed_unit),
        initial=None if initial is None else read_pose(Path(initial), "initial"),
    )
    for name, surface, other, unit in (
        ("moving", pair.moving, pair.fixed, moving_unit),
        ("fixed", pair.fixed, pair.moving, fixed_unit),
    ):
        hint = f"pass {name}_unit=m to convert it or {name}_unit=mm to take it as it is"
        refuse_metres(surface, other, name, unit, hint)
    return pair


def _cloud(surface: Surface, count: int, rng: np.random.Generator) -> np.ndarray:
    return surface.sample(count, rng) if isinstance(surface, Mesh) else surface


def _moved(surface: Surface, fixed_T_moving: np.ndarray) -> Surface:
    if isinstance(surface, Mesh):
        return Mesh(frames.apply(fixed_T_moving, surface.vertices_mm), surface.triangles)
    return frames.apply(fixed_T_moving, surface)


def _record(result: RigidResult, residuals: SurfaceResiduals, name: str, pair: _Pair) -> dict[str, Any]:
    measured = {key: getattr(residuals, key) for key in (*LENGTHS, *SHARES)}
    return {
        "moving": str(pair.moving_path),
        "fixed": str(pair.fixed_path),
        "rigid": name,
        "units": {"length": "mm", "time": "s"},
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        **measured,
        "distances_to": "triangles" if isinstance(pair.fixed, Mesh) else "points",
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


def _outcome(result: RigidResult, residuals: SurfaceResiduals, name: str, pair: _Pair) -> Outcome:
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
        inputs=tuple(
            InputData(path.name, files.digest(path), str(path))
            for path in (pair.moving_path, pair.fixed_path)
        ),
    )
