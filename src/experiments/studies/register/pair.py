"""Everything a user gives for one registration: both surfaces, what belongs to each, and what is known of the pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from experiments import files
from experiments.errors import InputError
from experiments.inputs.known_pose import InitialPose, initial_pose
from experiments.inputs.surfaces import (
    naming,
    read_frames,
    read_mm,
    read_space,
    refuse_metres,
    require_path,
    require_solid,
)
from experiments.outcome import InputData
from experiments.studies.register.centerlines import CenterlineSource, centerline_of
from registration import errors as registration_errors
from registration.geometry.shapes import Centerline, Surface, diagonal_mm, points_of
from registration.io.landmarks import LandmarkPairs, paired, read_landmarks
from registration.io.patient_space import lps_from, stated_space

# A landmark lies on its vessel or near it; what is farther off than this share of the vessel's size is elsewhere.
NEAR_SHARE = 0.1


@dataclass(frozen=True)
class SideFiles:
    """Files of one side as the user names them.

    Parameters
    ----------
    name : str
        Side of the registration: moving or fixed.
    path : str or None
        File of the surface; None where the setting is missing.
    unit : str or None, optional
        Length unit, mm, cm or m; None for mm, refused if it looks like metres.
    space : str or None, optional
        Axes, lps or ras; None as the header says, else lps.
    centerline : str or None, optional
        File of the centerline; "none" for no centerline; None for one next to the surface.
    landmarks : str or None, optional
        File of the landmarks; None for no landmarks.
    """

    name: str
    path: str | None
    unit: str | None = None
    space: str | None = None
    centerline: str | None = None
    landmarks: str | None = None


@dataclass(frozen=True)
class Side:
    """One side, as read.

    Parameters
    ----------
    path : Path
        File of the surface.
    surface : Surface
        Surface or points in mm in LPS.
    space : str
        Axes that the file was taken to have.
    centerline : Centerline or None
        Centerline in mm in LPS; None where there is none.
    centerline_path : Path or None
        File of the centerline; None where there is none.
    frame : ndarray of int, shape (n,), or None, optional
        Image frame in which each point of a sweep's cloud was seen; None where the file does not say.
    assumed : bool, optional
        Whether neither the file nor the user says which axes it has.
    """

    path: Path
    surface: Surface
    space: str
    centerline: Centerline | None
    centerline_path: Path | None
    frame: np.ndarray | None = None
    assumed: bool = False

    def centerline_mm(self, most: int) -> np.ndarray | None:
        """Sample the centerline at even arc length.

        Parameters
        ----------
        most : int
            Maximum number of points.

        Returns
        -------
        ndarray, shape (n, 3), or None
            Points in mm in LPS; None where there is no centerline.
        """
        return None if self.centerline is None else self.centerline.even_points(most)


@dataclass(frozen=True)
class Pair:
    """Both sides of a registration and what is known about them.

    Parameters
    ----------
    moving, fixed : Side
        Side of the registration.
    landmarks : LandmarkPairs or None
        Landmarks set in both sides; None where there are none.
    initial : InitialPose or None
        Pose to search around; None to search everywhere.
    inputs : tuple of InputData
        Every file that was read.
    """

    moving: Side
    fixed: Side
    landmarks: LandmarkPairs | None
    initial: InitialPose | None
    inputs: tuple[InputData, ...]


def read_pair(
    moving: SideFiles,
    fixed: SideFiles,
    initial: str | None = None,
    search_cone_deg: float | None = None,
    search_radius_mm: float | None = None,
) -> Pair:
    """Read all files of a registration.

    Parameters
    ----------
    moving, fixed : SideFiles
        Files of the side.
    initial : str or None, optional
        File of a known pose; None for the pose of the landmarks, or none.
    search_cone_deg : float or None, optional
        How far in degrees the result may rotate from a known pose; None for the default.
    search_radius_mm : float or None, optional
        How far in mm the result may move from a known pose; None for the default.

    Returns
    -------
    Pair
        Both sides, landmarks and pose.

    Raises
    ------
    InputError
        If a setting or file is not acceptable; the message names the setting, what it expects and what it
        received.
    """
    sides = [_read_side(given) for given in (moving, fixed)]
    for given, side, other in ((moving, sides[0], sides[1]), (fixed, sides[1], sides[0])):
        hint = f"pass {given.name}_unit=m to convert it or {given.name}_unit=mm to take it as it is"
        refuse_metres(side.surface, other.surface, given.name, given.unit, hint)
    pairs = _read_landmarks(moving, fixed)
    if pairs is not None:
        _refuse_turned(moving, sides[0], pairs.moving_mm)
        _refuse_turned(fixed, sides[1], pairs.fixed_mm)
    try:
        pose = initial_pose(
            None if initial is None else Path(initial), pairs, search_cone_deg, search_radius_mm
        )
    except registration_errors.InputError as refusal:
        reason = str(refusal)
        raise InputError(reason if reason.startswith("search_") else f"initial: {reason}") from refusal
    return Pair(sides[0], sides[1], pairs, pose, tuple(_inputs(sides, moving, fixed, initial)))


def _read_side(given: SideFiles) -> Side:
    verb = {"moving": "move", "fixed": "register to"}[given.name]
    path = require_path(given.path, given.name, f"the file of the cloud or mesh to {verb}")
    surface = read_mm(path, given.name, given.unit, given.space)
    require_solid(surface, given.name)
    space = read_space(path, given.name, given.space)
    source = CenterlineSource(given.name, path, surface, given.unit, space)
    return Side(
        path,
        surface,
        space,
        *centerline_of(source, given.centerline),
        frame=read_frames(path, surface),
        assumed=given.space is None and stated_space(path) is None,
    )


def _read_landmarks(moving: SideFiles, fixed: SideFiles) -> LandmarkPairs | None:
    if moving.landmarks is None and fixed.landmarks is None:
        return None
    found = []
    for given, other in ((moving, fixed), (fixed, moving)):
        name = f"{given.name}_landmarks"
        path = require_path(given.landmarks, name, f"a file next to {other.name}_landmarks")
        with naming(name):
            found.append(read_landmarks(path))
    try:
        return paired(*found)
    except registration_errors.InputError as refusal:
        raise InputError(str(refusal)) from refusal


def _refuse_turned(given: SideFiles, side: Side, landmarks_mm: np.ndarray) -> None:
    """Refuse a surface, whose axes nobody stated, that meets its own landmarks only when LPS and RAS change places.

    Both readings of a surface are the same shape, turned by 180 degrees, so that a search from everywhere absorbs the
    mistake and no residual shows it. Landmarks carry the name of their axes and do.
    """
    if given.space is not None or stated_space(side.path) is not None:
        return
    vertices_mm = points_of(side.surface)
    limit_mm = NEAR_SHARE * diagonal_mm(vertices_mm)
    away_mm, turned_mm = (
        float(np.median(cKDTree(points_mm).query(landmarks_mm)[0]))
        for points_mm in (vertices_mm, lps_from(vertices_mm, "ras"))
    )
    if turned_mm <= limit_mm < away_mm:
        raise InputError(
            f"{given.name}_space: expected the axes of {side.path}, received none: its landmarks lie {away_mm:.0f} mm "
            f"off if it is in LPS and {turned_mm:.1f} mm if it is in RAS; pass {given.name}_space=ras or lps"
        )


def _inputs(
    sides: list[Side], moving: SideFiles, fixed: SideFiles, initial: str | None
) -> Iterator[InputData]:
    paths = [sides[0].path, sides[1].path, *(side.centerline_path for side in sides)]
    paths += [Path(given.landmarks) for given in (moving, fixed) if given.landmarks is not None]
    for path in (*paths, None if initial is None else Path(initial)):
        if path is not None:
            yield InputData(path.name, files.digest(path), str(path))
