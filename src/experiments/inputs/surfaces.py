"""Files that the registration studies take from the user: surfaces in their unit and axes, and poses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import InputError
from registration import errors as registration_errors
from registration.geometry.open3d_bridge import quiet_open3d
from registration.geometry.shapes import LINE_SHARE, Mesh, Surface, diagonal_mm, principal_frame
from registration.io.patient_space import lps_from, stated_space
from registration.io.surfaces import read_surface
from registration.io.transforms import read_transform

# A vessel model is tens to hundreds of millimetres long: a diagonal under 1 is metres, and so is one that is a hundred
# times smaller than the other, for no two views of one vessel differ so.
METRES_BELOW = 1.0
HUNDREDFOLD = 100.0
MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}
SPACES = ("lps", "ras")


def require_path(value: str | Path | None, name: str, what: str) -> Path:
    """Return the path, or raise InputError that says what ``name`` must name."""
    if value is None or not str(value):
        raise InputError(f"{name}: expected {what}, received none")
    return Path(value)


def read_mm(path: Path, name: str, unit: str | None, space: str | None = "lps") -> Surface:
    """Read a surface and convert it from ``unit`` (mm, m, or none for mm) and ``space`` to millimetres in LPS.

    ``space`` is lps, ras, or none for what the file's header says (lps if it says nothing).
    """
    if unit is not None and unit not in MM_PER_UNIT:
        raise InputError(f"{name}_unit: expected mm, m or null, received {unit!r}")
    with naming(name):
        surface = read_surface(path)
    points_mm = MM_PER_UNIT[unit or "mm"] * lps_from(points_of(surface), read_space(path, name, space))
    return Mesh(points_mm, surface.triangles) if isinstance(surface, Mesh) else points_mm


def read_space(path: Path, name: str, space: str | None) -> str:
    """The axes of a file, lps or ras: as the user says, else as its header does, else lps."""
    if space is None:
        return stated_space(path) or "lps"
    if space not in SPACES:
        raise InputError(f"{name}_space: expected lps, ras or null, received {space!r}")
    return space


def require_solid(surface: Surface, name: str) -> None:
    """Raise InputError if all points lie in one plane: a vessel does not, and its mirror image would fit as well."""
    points_mm = points_of(surface)
    if isinstance(surface, Mesh):
        points_mm = points_mm[np.unique(surface.triangles)]
    spread_mm = principal_frame(points_mm).spread_mm
    if spread_mm[2] <= LINE_SHARE * spread_mm[0]:
        raise InputError(f"{name}: expected points around a vessel, received points in one plane")


def refuse_metres(surface: Surface, other: Surface, name: str, unit: str | None, hint: str) -> None:
    """Raise InputError if ``surface``, whose unit was not stated, looks like metres beside ``other``."""
    own, others = diagonal_mm(points_of(surface)), diagonal_mm(points_of(other))
    if unit is None and (own < METRES_BELOW or HUNDREDFOLD * own <= others):
        raise InputError(
            f"{name}: expected millimetres, received a bounding box with a diagonal of {own:.3g} beside one of "
            f"{others:.3g}, which looks like metres; {hint}"
        )


def read_pose(path: Path, name: str) -> np.ndarray:
    """Read ``fixed_T_moving`` (4, 4), in mm, from any file that ``read_transform`` reads."""
    with naming(name):
        return read_transform(path)


def read_frames(path: Path, surface: Surface) -> np.ndarray | None:
    """The number of the frame that each point of a sweep's cloud was seen in, (n,), where a PLY file has it."""
    if isinstance(surface, Mesh) or path.suffix.lower() != ".ply":
        return None
    with quiet_open3d() as open3d:
        cloud = open3d.t.io.read_point_cloud(path)
    if "frame" not in cloud.point or len(cloud.point["frame"]) != len(surface):
        return None
    return cloud.point["frame"].numpy().ravel().astype(np.int64)


def one_method(rigid: object) -> tuple[str, Any]:
    """The name and the object of the only method in ``rigid``."""
    if not isinstance(rigid, dict) or len(rigid) != 1:
        received = ", ".join(rigid) if isinstance(rigid, dict) else repr(rigid)
        raise InputError(f"rigid: expected exactly one method, received {received or 'none'}")
    return next(iter(rigid.items()))


def points_of(surface: Surface) -> np.ndarray:
    """The vertices of a mesh, or the points of a cloud."""
    return surface.vertices_mm if isinstance(surface, Mesh) else surface


@contextmanager
def naming(setting: str) -> Iterator[None]:
    """Put the name of the setting before what the reading of its file refuses."""
    try:
        yield
    except registration_errors.InputError as refusal:
        raise InputError(f"{setting}: {refusal}") from refusal
