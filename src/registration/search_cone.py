"""How far a search may go from a pose that is known beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.checks import require_positive
from registration.errors import InputError


@dataclass(frozen=True)
class SearchCone:
    """A bound on the answer around an initial pose: turned by at most ``angle_deg``, moved by at most ``radius_mm``.

    The angle is that of the rotation between both poses, the distance that of the moving cloud's centroid.
    """

    angle_deg: float = 45.0
    radius_mm: float = 20.0

    def __post_init__(self) -> None:
        require_positive("angle_deg", self.angle_deg, 180.0)
        require_positive("radius_mm", self.radius_mm)


@dataclass(frozen=True)
class Bound:
    """The poses within a cone of a known one, for a moving cloud around ``centre_mm``."""

    initial: Float64[np.ndarray, "4 4"]
    cone: SearchCone
    centre_mm: Float64[np.ndarray, "3"]

    def away(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> tuple[float, float]:
        """How far a pose is from the known one: by the angle of its turn, and by the shift of the cloud in mm."""
        turn_deg = frames.rotation_angle_deg(
            frames.compose(fixed_T_moving, frames.invert_rigid(self.initial))
        )
        shift_mm = frames.apply(fixed_T_moving, self.centre_mm) - frames.apply(self.initial, self.centre_mm)
        return float(turn_deg), float(np.linalg.norm(shift_mm))

    def holds(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> bool:
        """Whether a pose lies within the cone."""
        turn_deg, away_mm = self.away(fixed_T_moving)
        return turn_deg <= self.cone.angle_deg and away_mm <= self.cone.radius_mm


def known_pose(
    initial: Float64[np.ndarray, "4 4"] | None, search_cone: SearchCone | None
) -> Float64[np.ndarray, "4 4"] | None:
    """The known pose as it is, or InputError for one that is not rigid or a cone around none."""
    if initial is not None:
        return frames.require_rigid(initial, "initial")
    if search_cone is not None:
        raise InputError("search_cone: expected an initial pose to search around, received none")
    return None
