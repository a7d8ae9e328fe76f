"""Files that the registration studies take from the user: surfaces in their unit, and poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import InputError
from registration import errors as registration_errors
from registration import frames
from registration.geometry import Mesh, diagonal_mm
from registration.geometry_io import read_surface
from registration.metrics import Surface

# A vessel model is tens to hundreds of millimetres long. A diagonal under 1 beside one over 10 is metres beside
# millimetres: no two views of one vessel differ ten times in size.
METRES_BELOW = 1.0
MILLIMETRES_ABOVE = 10.0
MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}


def require_path(value: str | Path | None, name: str, what: str) -> Path:
    """Return the path, or raise InputError that says what ``name`` must name."""
    if value is None or not str(value):
        raise InputError(f"{name}: expected {what}, received none")
    return Path(value)


def read_mm(path: Path, name: str, unit: str | None) -> Surface:
    """Read a surface and convert it from ``unit`` (mm, m, or none for mm) to millimetres."""
    if unit is not None and unit not in MM_PER_UNIT:
        raise InputError(f"{name}_unit: expected mm, m or null, received {unit!r}")
    try:
        surface = read_surface(path)
    except registration_errors.InputError as refusal:
        raise InputError(f"{name}: {refusal}") from refusal
    scale = MM_PER_UNIT[unit or "mm"]
    if isinstance(surface, Mesh):
        return Mesh(scale * surface.vertices_mm, surface.triangles)
    return scale * surface


def refuse_metres(surface: Surface, other: Surface, name: str, unit: str | None, hint: str) -> None:
    """Raise InputError if ``surface``, whose unit was not stated, looks like metres beside ``other``."""
    own, others = diagonal_mm(_points(surface)), diagonal_mm(_points(other))
    if unit is None and own < METRES_BELOW and others > MILLIMETRES_ABOVE:
        raise InputError(
            f"{name}: expected millimetres, received a bounding box with a diagonal of {own:.3g} beside one of "
            f"{others:.3g}, which looks like metres; {hint}"
        )


def read_pose(path: Path, name: str) -> np.ndarray:
    """Read ``fixed_T_moving`` (4, 4), in mm, from a JSON file such as registration.json."""
    if not path.is_file():
        raise InputError(f"{name}: expected a JSON file with fixed_T_moving, received no file at {path}")
    try:
        matrix = np.array(json.loads(path.read_text(encoding="utf-8"))["fixed_T_moving"], dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"an array of shape {matrix.shape}")
    except (ValueError, KeyError, TypeError) as refusal:
        raise InputError(
            f"{name}: expected fixed_T_moving as 4 rows of 4 numbers in {path}, received {refusal}"
        ) from refusal
    try:
        return frames.require_rigid(matrix, "fixed_T_moving")
    except registration_errors.InputError as refusal:
        raise InputError(f"{name}: {path}: {refusal}") from refusal


def one_method(rigid: object) -> tuple[str, Any]:
    """The name and the object of the only method in ``rigid``."""
    if not isinstance(rigid, dict) or len(rigid) != 1:
        received = ", ".join(rigid) if isinstance(rigid, dict) else repr(rigid)
        raise InputError(f"rigid: expected exactly one method, received {received or 'none'}")
    return next(iter(rigid.items()))


def _points(surface: Surface) -> np.ndarray:
    return surface.vertices_mm if isinstance(surface, Mesh) else surface
