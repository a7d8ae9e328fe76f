"""What the deformable stage carries along with the model: centerline, landmarks, other surfaces of the user's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.analysis.registration.deformed_model import Deformed
from experiments.errors import InputError
from experiments.inputs.surfaces import read_mm, require_path
from experiments.studies.register.pair import Pair, SideFiles
from registration import transforms
from registration.geometry.shapes import Centerline, Polyline, Surface, points_of, with_points
from registration.io.centerlines import write_centerline
from registration.io.landmarks import Landmarks, write_landmarks
from registration.io.surfaces import write_surface
from registration.metrics.surface_distance import rms

CENTERLINES = ("centerline_deformed.vtp", "centerline_deformed.csv")
LANDMARKS, SURFACE = "landmarks_deformed.mrk.json", "_carried.ply"


@dataclass(frozen=True)
class Carried:
    """Surfaces that lie with the model, and how the landmarks were used.

    Parameters
    ----------
    surfaces : tuple of (str, Surface), optional
        Name of the file without suffix, and surface in mm in LPS in the coordinate frame of the model's side.
    landmark_deviation_mm : float or None, optional
        Standard deviation in mm of the landmarks as constraints; None where they only measure the error.
    """

    surfaces: tuple[tuple[str, Surface], ...] = ()
    landmark_deviation_mm: float | None = None


def read_carried(carry: Sequence[str], model: SideFiles) -> tuple[tuple[str, Surface], ...]:
    """Read the surfaces that are to be carried along.

    Parameters
    ----------
    carry : sequence of str
        Files of surfaces in the coordinate frame of the model's side, with its unit and axes.
    model : SideFiles
        Files of the model's side.

    Returns
    -------
    tuple of (str, Surface)
        Name without suffix, and surface in mm in LPS.

    Raises
    ------
    InputError
        If it is no list, a file cannot be read, or two have one name.
    """
    if isinstance(carry, str) or not isinstance(carry, Sequence):
        raise InputError(f"carry: expected a list of files, received {carry!r}")
    paths = [require_path(each, "carry", "files of surfaces") for each in carry]
    names = [path.stem for path in paths]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"carry: expected files of different names, received {', '.join(twice)} twice")
    return tuple(
        (name, read_mm(path, "carry", model.unit, model.space))
        for name, path in zip(names, paths, strict=True)
    )


def write_carried(
    carried: Carried, deformed: Deformed, pair: Pair, fixed_T_moving: np.ndarray, workspace: Path
) -> None:
    """Write what lies with the model where the sweep has seen it, in the fixed coordinate frame in mm (LPS).

    Parameters
    ----------
    carried : Carried
        Further surfaces.
    deformed : Deformed
        Result of the deformable stage.
    pair : Pair
        Both sides.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose of the rigid stage.
    workspace : Path
        Folder of the run.
    """
    carry = _Carrier(deformed, fixed_T_moving)
    side = pair.moving if deformed.model_side == "moving" else pair.fixed
    if side.centerline is not None:
        lines = tuple(Polyline(carry(line.points_mm), line.radius_mm) for line in side.centerline.lines)
        for name in CENTERLINES:
            write_centerline(workspace / name, Centerline(lines))
    if pair.landmarks is not None:
        own_mm = pair.landmarks.moving_mm if deformed.model_side == "moving" else pair.landmarks.fixed_mm
        write_landmarks(workspace / LANDMARKS, Landmarks(pair.landmarks.names, carry(own_mm)))
    for name, surface in carried.surfaces:
        write_surface(workspace / f"{name}{SURFACE}", with_points(surface, carry(points_of(surface))))


def carried_record(
    carried: Carried, deformed: Deformed, pair: Pair, fixed_T_moving: np.ndarray
) -> dict[str, Any]:
    """Record what was carried, and how far landmarks are apart after the deformable stage.

    Parameters
    ----------
    carried : Carried
        Further surfaces, and how landmarks were used.
    deformed : Deformed
        Result of the deformable stage.
    pair : Pair
        Both sides.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose of the rigid stage.

    Returns
    -------
    dict
        Content of the block ``deformable``, ready for JSON.
    """
    errors_mm = landmark_errors_mm(deformed, pair, fixed_T_moving)
    landmarks = None
    if errors_mm is not None:
        landmarks = {
            "error_mm": rms(errors_mm),
            "error_max_mm": float(errors_mm.max()),
            # Where they pulled, how far they are apart is a residual.
            "constraints": carried.landmark_deviation_mm is not None,
            "deviation_mm": carried.landmark_deviation_mm,
        }
    side = pair.moving if deformed.model_side == "moving" else pair.fixed
    names = [*(CENTERLINES if side.centerline is not None else ())]
    names += [LANDMARKS] if pair.landmarks is not None else []
    return {
        "landmarks": landmarks,
        "carried": [*names, *(f"{name}{SURFACE}" for name, _ in carried.surfaces)],
    }


def landmark_errors_mm(deformed: Deformed, pair: Pair, fixed_T_moving: np.ndarray) -> np.ndarray | None:
    """Measure how far each pair of landmarks is apart after the deformable stage.

    Parameters
    ----------
    deformed : Deformed
        Result of the deformable stage.
    pair : Pair
        Both sides.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose of the rigid stage.

    Returns
    -------
    ndarray, shape (n,), or None
        Distances in mm; None without landmarks.
    """
    if pair.landmarks is None:
        return None
    carry = _Carrier(deformed, fixed_T_moving)
    moving_mm, fixed_mm = pair.landmarks.moving_mm, pair.landmarks.fixed_mm
    if deformed.model_side == "moving":
        apart_mm = carry(moving_mm) - fixed_mm
    else:
        apart_mm = carry(fixed_mm) - transforms.apply(fixed_T_moving, moving_mm)
    return np.asarray(np.linalg.norm(apart_mm, axis=1))


@dataclass(frozen=True)
class _Carrier:
    """Brings points of the model's side to where the sweep has seen their material, in the fixed frame."""

    deformed: Deformed
    fixed_T_moving: np.ndarray

    def __call__(self, points_mm: np.ndarray) -> np.ndarray:
        if self.deformed.model_side == "moving":
            points_mm = transforms.apply(self.fixed_T_moving, points_mm)
        return np.asarray(points_mm + self.deformed.result.displacement(points_mm))
