"""The surfaces, the truth and the targets of a robustness study, from files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.inputs.surfaces import read_mm, read_pose, refuse_metres, require_path
from experiments.outcome import InputData
from registration import errors as registration_errors
from registration.geometry.shapes import Mesh, Surface, transformed
from registration.geometry.vessel_axis import AlongVessel
from registration.io.surfaces import read_centerline
from registration.metrics.targets import MAX_TARGETS, target_points
from registration.perturbation.perturbation import Piece, draw

# At most this many points carry the target registration error.
# Drawn once for every study, so that all runs on a surface share their targets.
TARGET_SEED = 20250
COVERING_POINTS = 2000


@dataclass(frozen=True)
class Problem:
    """What is registered to what, and the points at which the error is measured.

    Parameters
    ----------
    fixed : Surface
        Fixed surface in mm.
    moving : Surface
        Moving surface in mm.
    fixed_T_moving : ndarray, shape (4, 4)
        True pose of ``moving`` before any perturbation.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed frame in mm.
    target_kind : str
        Where the targets lie: on the ``centerline`` or the ``surface``.
    inputs : tuple of InputData
        Files that were read.
    """

    fixed: Surface
    moving: Surface
    fixed_T_moving: np.ndarray
    targets_mm: np.ndarray
    target_kind: str
    inputs: tuple[InputData, ...]

    @property
    def digests(self) -> tuple[str, ...]:
        """What tells these files' contents from any others."""
        return tuple(data.digest for data in self.inputs)


def read_problem(
    target: str | None, moving: str | None, moving_truth: str | None, target_centerline: str | None
) -> Problem:
    """Read the fixed surface, and what the user has of a moving one, its true pose and a centerline.

    Parameters
    ----------
    target : str or None
        File of the fixed surface.
    moving : str or None
        File of the moving surface; None to register the fixed surface to itself.
    moving_truth : str or None
        File of the true pose of ``moving``; None without ``moving``.
    target_centerline : str or None
        File of the centerline that has the targets; None for targets on the surface.

    Returns
    -------
    Problem
        The problem.

    Raises
    ------
    InputError
        If a file or setting is not acceptable; the message names both.
    """
    if target is not None and not isinstance(target, str):
        raise InputError(f"target: expected one file a job, received {target!r}")
    target_path = require_path(
        target, "target", "the file of the fixed surface (PLY, PCD, STL, OBJ, VTP or XYZ)"
    )
    fixed = read_mm(target_path, "target", None)
    surface, truth = _moving(moving, moving_truth, fixed)
    targets_mm, kind = _targets(target_centerline, fixed)
    paths = [Path(path) for path in (target, moving, moving_truth, target_centerline) if path is not None]
    return Problem(
        fixed=fixed,
        moving=surface,
        fixed_T_moving=truth,
        targets_mm=targets_mm,
        target_kind=kind,
        inputs=tuple(InputData(path.name, files.digest(path), str(path)) for path in paths),
    )


def covered_targets(problem: Problem, piece: Piece) -> np.ndarray:
    """Find the targets next to the moving piece in its true place, along the fixed surface's principal axis.

    Parameters
    ----------
    problem : Problem
        The problem.
    piece : Piece
        Piece of the moving surface.

    Returns
    -------
    ndarray of bool, shape (t,)
        True for the targets that the piece covers.
    """
    along = AlongVessel.of(problem.fixed)
    moving = transformed(problem.moving, problem.fixed_T_moving)
    whole_mm = moving.vertices_mm if isinstance(moving, Mesh) else moving
    # Vertices reach to the very ends, samples are there where a coarse mesh has no vertex.
    inside_mm = whole_mm[piece.contains(whole_mm, moving)]
    drawn_mm = draw(moving, COVERING_POINTS, piece, np.random.default_rng(TARGET_SEED))
    covered_mm = along.position_mm(np.concatenate([inside_mm, drawn_mm]))
    at_mm = along.position_mm(problem.targets_mm)
    return (at_mm >= covered_mm.min()) & (at_mm <= covered_mm.max())


def _moving(moving: str | None, moving_truth: str | None, fixed: Surface) -> tuple[Surface, np.ndarray]:
    if moving is None:
        if moving_truth is not None:
            raise InputError("moving_truth: expected a moving file with it, received none")
        return fixed, np.eye(4)
    truth_path = require_path(moving_truth, "moving_truth", "a JSON file with the fixed_T_moving of moving")
    surface = read_mm(Path(moving), "moving", None)
    hint = "convert the file to millimetres first"
    refuse_metres(surface, fixed, "moving", None, hint)
    refuse_metres(fixed, surface, "target", None, hint)
    return surface, read_pose(truth_path, "moving_truth")


def _targets(centerline: str | None, fixed: Surface) -> tuple[np.ndarray, str]:
    if centerline is not None:
        try:
            return read_centerline(Path(centerline)).even_points(MAX_TARGETS), "centerline"
        except registration_errors.InputError as refusal:
            raise InputError(f"target_centerline: {refusal}") from refusal
    return target_points(fixed, seed=TARGET_SEED), "surface"
