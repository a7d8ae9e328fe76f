"""What is known of the answer before a search: a pose from a file or from landmarks, and how far to look from it."""

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
    """A rigid ``fixed_T_moving`` in mm, its ``source`` (file or landmarks), and a bound on the search around it.

    Without a ``search_cone`` the method's own bound holds.
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
    """The pose in ``path``, else the one that lays ``pairs`` of landmarks on each other, else None.

    A bound that is given without the other leaves that to the method's own. Raises InputError for a file that
    cannot be read, a pose that is not rigid, and a bound with no pose to search around.
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
