"""How far a search may go from a pose that is known beforehand."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from registration import frames
from registration.checks import require_positive
from registration.errors import InputError

# How far any method goes from a known pose where neither the caller nor its own settings say otherwise.
USUAL_DEG, USUAL_MM = 45.0, 20.0
# A result beyond this share of what the bound allows lies at the bound.
EDGE_SHARE = 0.95
# A pose that is put on the bound stays within it by this share, whatever rounding does.
INSIDE_SHARE = 1e-9


@dataclass(frozen=True)
class SearchCone:
    """A bound on the answer around an initial pose: turned by at most ``angle_deg``, moved by at most ``radius_mm``.

    The angle is that of the rotation between both poses, the distance that of the moving cloud's centroid. None stands
    for the bound that the method has itself.
    """

    angle_deg: float | None = None
    radius_mm: float | None = None

    def __post_init__(self) -> None:
        if self.angle_deg is not None:
            require_positive("angle_deg", self.angle_deg, 180.0)
        if self.radius_mm is not None:
            require_positive("radius_mm", self.radius_mm)


# For a step of a method whose whole answer is bounded afterwards.
UNBOUNDED = SearchCone(180.0, sys.float_info.max)


@dataclass(frozen=True)
class Bound:
    """The poses within a cone of a known one, for a moving cloud around ``centre_mm``.

    What the cone leaves open is bounded by ``usual_deg`` and ``usual_mm``.
    """

    initial: Float64[np.ndarray, "4 4"]
    cone: SearchCone
    centre_mm: Float64[np.ndarray, "3"]
    usual_deg: float = USUAL_DEG
    usual_mm: float = USUAL_MM

    @property
    def angle_deg(self) -> float:
        """The largest angle that is allowed."""
        return self.usual_deg if self.cone.angle_deg is None else self.cone.angle_deg

    @property
    def radius_mm(self) -> float:
        """The largest shift of the centroid that is allowed."""
        return self.usual_mm if self.cone.radius_mm is None else self.cone.radius_mm

    @property
    def kept_to(self) -> SearchCone:
        """Both bounds as they are in force."""
        return SearchCone(self.angle_deg, self.radius_mm)

    def away(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> tuple[float, float]:
        """How far a pose is from the known one: by the angle of its turn, and by the shift of the cloud in mm."""
        turn_deg = frames.rotation_angle_deg(
            frames.compose(fixed_T_moving, frames.invert_rigid(self.initial))
        )
        return float(turn_deg), float(np.linalg.norm(self._shift_mm(fixed_T_moving)))

    def holds(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> bool:
        """Whether a pose lies within the cone."""
        turn_deg, away_mm = self.away(fixed_T_moving)
        return turn_deg <= self.angle_deg and away_mm <= self.radius_mm

    def held(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
        """The pose itself if it is within the cone, else the one on the way to it from the known pose, on the bound."""
        if self.holds(fixed_T_moving):
            return fixed_T_moving
        turn_deg, away_mm = self.away(fixed_T_moving)
        turn = Rotation.from_matrix((fixed_T_moving @ frames.invert_rigid(self.initial))[:3, :3])
        part = _share(self.angle_deg, turn_deg)
        about_mm = frames.apply(self.initial, self.centre_mm)
        turned = frames.rotate_about(Rotation.from_rotvec(part * turn.as_rotvec()), about_mm)
        shift_mm = _share(self.radius_mm, away_mm) * self._shift_mm(fixed_T_moving)
        return frames.compose(frames.translation(shift_mm), turned, self.initial)

    def at_edge(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> str:
        """Say that a pose lies at the bound, so that the right one may lie beyond it; nothing if it does not."""
        turn_deg, away_mm = self.away(fixed_T_moving)
        near = [
            f"{value:.1f} of {most:g} {unit}"
            for value, most, unit in (
                (turn_deg, self.angle_deg, "degrees"),
                (away_mm, self.radius_mm, "mm"),
            )
            if value > EDGE_SHARE * most
        ]
        if not near:
            return ""
        return f"it lies at the bound of the search ({' and '.join(near)} from the initial pose)"

    def describe(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> str:
        """Where a pose outside the cone lies, in words."""
        turn_deg, away_mm = self.away(fixed_T_moving)
        return (
            f"{turn_deg:.1f} degrees and {away_mm:.1f} mm from the initial pose, outside the search cone of "
            f"{self.angle_deg:g} degrees and {self.radius_mm:g} mm"
        )

    def _shift_mm(self, fixed_T_moving: np.ndarray) -> Float64[np.ndarray, "3"]:
        shift: Float64[np.ndarray, "3"] = frames.apply(fixed_T_moving, self.centre_mm) - frames.apply(
            self.initial, self.centre_mm
        )
        return shift


def known_pose(
    initial: ArrayLike | None, search_cone: SearchCone | None
) -> Float64[np.ndarray, "4 4"] | None:
    """The known pose as float64, or InputError for one that is not rigid or a cone around none."""
    if initial is not None:
        try:
            pose = np.asarray(initial, dtype=np.float64)
        except (TypeError, ValueError) as refusal:
            raise InputError("initial: expected a matrix of shape (4, 4), received no numbers") from refusal
        if pose.shape != (4, 4):
            raise InputError(f"initial: expected a matrix of shape (4, 4), received shape {pose.shape}")
        return frames.require_rigid(pose, "initial")
    if search_cone is not None:
        raise InputError("search_cone: expected an initial pose to search around, received none")
    return None


def bound_around(
    initial: Float64[np.ndarray, "4 4"] | None,
    search_cone: SearchCone | None,
    moving_mm: Float64[np.ndarray, "m 3"],
    usual_deg: float = USUAL_DEG,
    usual_mm: float = USUAL_MM,
) -> Bound | None:
    """The bound on the answer around a known pose, with or without a cone of the caller's; None around none."""
    if initial is None:
        return None
    return Bound(initial, search_cone or SearchCone(), moving_mm.mean(axis=0), usual_deg, usual_mm)


def _share(most: float, value: float) -> float:
    return min(1.0, (1 - INSIDE_SHARE) * most / value) if value > 0 else 1.0
