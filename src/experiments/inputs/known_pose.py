"""Initial poses: what is known of the result before a search, and how far from it to search."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.io.landmarks import LandmarkPairs
from registration.io.transforms import read_transform
from registration.rigid.search_cone import SearchCone

SOURCES = ("file", "landmarks")


@dataclass(frozen=True)
class InitialPose:
    """A pose known before a search, and a bound on the search around it.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        A rigid transform, in mm.
    source : {'file', 'landmarks'}
        Where it comes from.
    search_cone : SearchCone or None
        Bound on the search; None: the method's own.

    Raises
    ------
    InputError
        If the transform is not rigid or the source is another.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    source: str
    search_cone: SearchCone | None = None

    def __post_init__(self) -> None:
        transforms.require_rigid(self.fixed_T_moving, "fixed_T_moving")
        if self.source not in SOURCES:
            raise InputError(f"source: expected one of {', '.join(SOURCES)}, received {self.source!r}")


def initial_pose(
    path: Path | None,
    pairs: LandmarkPairs | None,
    search_cone_deg: float | None = None,
    search_radius_mm: float | None = None,
) -> InitialPose | None:
    """Return the pose in a file, else the one that aligns landmarks.

    Parameters
    ----------
    path : Path or None
        File of a transform.
    pairs : LandmarkPairs or None
        Landmarks of both surfaces.
    search_cone_deg : float or None
        Largest rotation from the pose; None: the method's own.
    search_radius_mm : float or None
        Largest shift from the pose; None: the method's own.

    Returns
    -------
    InitialPose or None
        None where neither file nor landmarks are given.

    Raises
    ------
    InputError
        If the file can't be read, the pose is not rigid, or a bound has no pose to search around.
    """
    cone = _cone(search_cone_deg, search_radius_mm)
    if path is not None:
        return InitialPose(read_transform(path), "file", cone)
    if pairs is not None:
        return InitialPose(pairs.fixed_T_moving, "landmarks", cone)
    if cone is not None:
        name = "search_cone_deg" if search_cone_deg is not None else "search_radius_mm"
        raise InputError(f"{name}: expected an initial pose or landmarks to search around, received neither")
    return None


def _cone(search_cone_deg: float | None, search_radius_mm: float | None) -> SearchCone | None:
    if search_cone_deg is None and search_radius_mm is None:
        return None
    try:
        return SearchCone(search_cone_deg, search_radius_mm)
    except InputError as refusal:
        # The cone's own fields are named after what the user calls them.
        message = (
            str(refusal).replace("angle_deg", "search_cone_deg").replace("radius_mm", "search_radius_mm")
        )
        raise InputError(message) from refusal
