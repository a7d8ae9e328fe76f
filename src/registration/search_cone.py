"""How far a search may go from a pose that is known beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.checks import require_positive


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

    def holds(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> bool:
        """Whether a pose lies within the cone."""
        turn_deg = frames.rotation_angle_deg(
            frames.compose(fixed_T_moving, frames.invert_rigid(self.initial))
        )
        shift_mm = frames.apply(fixed_T_moving, self.centre_mm) - frames.apply(self.initial, self.centre_mm)
        return bool(turn_deg <= self.cone.angle_deg and np.linalg.norm(shift_mm) <= self.cone.radius_mm)
