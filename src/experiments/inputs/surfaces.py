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
from registration.geometry.shapes import LINE_SHARE, Mesh, Surface, diagonal_mm, points_of, principal_frame
from registration.io.patient_space import lps_from, stated_space
from registration.io.surfaces import read_surface
from registration.io.transforms import read_transform

# A vessel model is tens to hundreds of millimetres long: a diagonal under 1 is metres, and so is one that is a hundred
# times smaller than the other, for no two views of one vessel differ so.
METRES_BELOW = 1.0
HUNDREDFOLD = 100.0
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
SPACES = ("lps", "ras")


def require_path(value: str | Path | None, name: str, what: str) -> Path:
    """Check that a setting names a path.

    Parameters
    ----------
    value : str, Path or None
        Value of the setting.
    name : str
        Name of the setting, for the message.
    what : str
        What it must name, for the message.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    InputError
        If the value is None or empty.
    """
    if value is None or not str(value):
        raise InputError(f"{name}: expected {what}, received none")
    return Path(value)


def read_mm(path: Path, name: str, unit: str | None, space: str | None = "lps") -> Surface:
    """Read a surface in millimetres and LPS.

    Parameters
    ----------
    path : Path
        A mesh or point cloud.
    name : str
        Name of the setting, for messages.
    unit : {'mm', 'cm', 'm'} or None
        Unit of the file; None: mm.
    space : {'lps', 'ras'} or None
        Axes of the file; None: what its header says, else lps.

    Returns
    -------
    Mesh or ndarray, shape (n, 3)
        The surface.

    Raises
    ------
    InputError
        If the file can't be read, or unit or space are not among these.
    """
    if unit is not None and unit not in MM_PER_UNIT:
        raise InputError(f"{name}_unit: expected mm, cm, m or null, received {unit!r}")
    with naming(name):
        surface = read_surface(path)
    points_mm = MM_PER_UNIT[unit or "mm"] * lps_from(points_of(surface), read_space(path, name, space))
    return Mesh(points_mm, surface.triangles) if isinstance(surface, Mesh) else points_mm


def read_space(path: Path, name: str, space: str | None) -> str:
    """Return the axes of a file: those given, else those in its header, else lps.

    Parameters
    ----------
    path : Path
        A mesh or point cloud.
    name : str
        Name of the setting, for messages.
    space : {'lps', 'ras'} or None
        What the user gives.

    Returns
    -------
    {'lps', 'ras'}
        The axes.

    Raises
    ------
    InputError
        If ``space`` is not among these.
    """
    if space is None:
        return stated_space(path) or "lps"
    if space not in SPACES:
        raise InputError(f"{name}_space: expected lps, ras or null, received {space!r}")
    return space


def require_solid(surface: Surface, name: str) -> None:
    """Check that points do not all lie in one plane.

    Parameters
    ----------
    surface : Mesh or ndarray, shape (n, 3)
        In mm.
    name : str
        Name of the setting, for the message.

    Raises
    ------
    InputError
        If they do.

    Notes
    -----
    A vessel does not, and the mirror image of points in a plane would fit as well.
    """
    points_mm = points_of(surface)
    if isinstance(surface, Mesh):
        points_mm = points_mm[np.unique(surface.triangles)]
    spread_mm = principal_frame(points_mm).spread_mm
    if spread_mm[2] <= LINE_SHARE * spread_mm[0]:
        raise InputError(f"{name}: expected points around a vessel, received points in one plane")


def refuse_metres(surface: Surface, other: Surface, name: str, unit: str | None, hint: str) -> None:
    """Check that a surface whose unit was not given does not look like metres.

    Parameters
    ----------
    surface : Mesh or ndarray, shape (n, 3)
        The surface.
    other : Mesh or ndarray, shape (n, 3)
        The surface that it is to be registered with.
    name : str
        Name of the setting, for the message.
    unit : str or None
        The unit given; with one, nothing is checked.
    hint : str
        What to do, for the message.

    Raises
    ------
    InputError
        If its bounding box has a diagonal below 1, or a hundred times smaller than the other's.
    """
    own, others = diagonal_mm(points_of(surface)), diagonal_mm(points_of(other))
    if unit is None and (own < METRES_BELOW or HUNDREDFOLD * own <= others):
        raise InputError(
            f"{name}: expected millimetres, received a bounding box with a diagonal of {own:.3g} compared with one of "
            f"{others:.3g}, which looks like metres; {hint}"
        )


def read_pose(path: Path, name: str) -> np.ndarray:
    """Read a pose from any file that ``read_transform`` reads.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Name of the setting, for messages.

    Returns
    -------
    ndarray, shape (4, 4)
        ``fixed_T_moving`` in mm.

    Raises
    ------
    InputError
        If the file can't be read.
    """
    with naming(name):
        return read_transform(path)


def read_frames(path: Path, surface: Surface) -> np.ndarray | None:
    """Read which frame of a sweep each point of its cloud was seen in.

    Parameters
    ----------
    path : Path
        File of the cloud.
    surface : Mesh or ndarray, shape (n, 3)
        What was read from it.

    Returns
    -------
    ndarray of int, shape (n,), or None
        Frame numbers; None where the file is no PLY file that has them.
    """
    if isinstance(surface, Mesh) or path.suffix.lower() != ".ply":
        return None
    with quiet_open3d() as open3d:
        cloud = open3d.t.io.read_point_cloud(path)
    if "frame" not in cloud.point or len(cloud.point["frame"]) != len(surface):
        return None
    return cloud.point["frame"].numpy().ravel().astype(np.int64)


def one_method(methods: object, setting: str = "rigid") -> tuple[str, Any]:
    """Return the only method of a setting.

    Parameters
    ----------
    methods : object
        Value of the setting: a mapping of name to method.
    setting : str, optional
        Name of the setting, for the message.

    Returns
    -------
    (str, object)
        Name and method.

    Raises
    ------
    InputError
        If there are none or several.
    """
    if not isinstance(methods, dict) or len(methods) != 1:
        received = ", ".join(methods) if isinstance(methods, dict) else repr(methods)
        raise InputError(f"{setting}: expected exactly one method, received {received or 'none'}")
    return next(iter(methods.items()))


@contextmanager
def naming(setting: str) -> Iterator[None]:
    """Put the name of a setting before what the reading of its file refuses.

    Parameters
    ----------
    setting : str
        Name of the setting.

    Raises
    ------
    InputError
        In place of the InputError of ``registration`` that is raised within the context.
    """
    try:
        yield
    except registration_errors.InputError as refusal:
        raise InputError(f"{setting}: {refusal}") from refusal
