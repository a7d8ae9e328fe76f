"""How a moving cloud is turned and shifted when a registration problem is disturbed.

Rotations of any axis, rolls about the vessel's principal axis and flips across it; angles by bin, so that every bin
has as many trials as any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError

ANY, ROLL, FLIP = "any", "roll", "flip"
ROTATIONS = (ANY, ROLL, FLIP)


@dataclass(frozen=True)
class PerturbedPose:
    """A rotation, about the cloud's centroid, and a translation in mm."""

    turn: Rotation
    shift_mm: Float64[np.ndarray, "3"]

    @property
    def angle_deg(self) -> float:
        """The angle of the rotation."""
        return float(np.rad2deg(self.turn.magnitude()))

    @property
    def translation_mm(self) -> float:
        """The length of the translation."""
        return float(np.linalg.norm(self.shift_mm))


@dataclass(frozen=True)
class PoseRange:
    """Which poses are drawn.

    ``rotation`` is ``any`` (axis uniform on the sphere), ``roll`` (about the principal axis) or ``flip`` (180 degrees
    about an axis across it, uniform around the vessel). The angle is uniform from 0 to ``angle_max_deg``; with
    ``angle_bin_deg`` the trials go through bins of that width in turn, and it is uniform within the bin. The direction
    of the translation is uniform, and so is its length from ``translation_min_mm`` to ``translation_max_mm``.
    """

    angle_max_deg: float
    translation_max_mm: float
    translation_min_mm: float = 0.0
    rotation: str = ANY
    angle_bin_deg: float | None = None

    def __post_init__(self) -> None:
        require_at_least("angle_max_deg", self.angle_max_deg, 0.0)
        if self.angle_max_deg > 180:
            raise InputError(f"angle_max_deg: expected at most 180, received {self.angle_max_deg:g}")
        require_at_least("translation_max_mm", self.translation_max_mm, 0.0)
        require_at_least("translation_min_mm", self.translation_min_mm, 0.0)
        if self.translation_min_mm > self.translation_max_mm:
            raise InputError(
                f"translation_min_mm: expected at most the longest, {self.translation_max_mm:g}, "
                f"received {self.translation_min_mm:g}"
            )
        if self.rotation not in ROTATIONS:
            raise InputError(f"rotation: expected one of {', '.join(ROTATIONS)}, received {self.rotation!r}")
        if self.angle_bin_deg is not None:
            require_positive("angle_bin_deg", self.angle_bin_deg, 180.0)
            count = self.angle_max_deg / self.angle_bin_deg
            if round(count) < 1 or abs(count - round(count)) > 1e-9:
                raise InputError(
                    f"angle_bin_deg: expected a whole part of {self.angle_max_deg:g}, received {self.angle_bin_deg:g}"
                )

    @property
    def bins(self) -> int:
        """Into how many bins of angles the trials fall; a flip has one angle."""
        if self.angle_bin_deg is None or self.rotation == FLIP:
            return 1
        return round(self.angle_max_deg / self.angle_bin_deg)

    def draw(
        self, principal_axis: Float64[np.ndarray, "3"], trial: int, rng: np.random.Generator
    ) -> PerturbedPose:
        """Draw the pose of a trial of a vessel with that axis (unit length), from its number and random stream."""
        require_count("trial", trial, 0)
        axis = _direction(rng)
        width_deg = self.angle_max_deg / self.bins
        angle_deg = width_deg * (trial % self.bins + rng.random())
        shift_mm = _direction(rng) * rng.uniform(self.translation_min_mm, self.translation_max_mm)
        if self.rotation == ROLL:
            axis = principal_axis
        elif self.rotation == FLIP:
            across = axis - (axis @ principal_axis) * principal_axis
            axis, angle_deg = across / np.linalg.norm(across), 180.0
        return PerturbedPose(Rotation.from_rotvec(np.deg2rad(angle_deg) * axis), shift_mm)


def _direction(rng: np.random.Generator) -> Float64[np.ndarray, "3"]:
    """Uniform on the sphere: a normal vector has no preferred direction."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)
