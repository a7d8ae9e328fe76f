"""Rotation and translation of a moving cloud when a registration problem is perturbed.

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
    """Perturbation of a pose.

    Parameters
    ----------
    rotation : scipy.spatial.transform.Rotation
        Rotation about the cloud's centroid.
    shift_mm : ndarray, shape (3,)
        Translation in mm.
    """

    rotation: Rotation
    shift_mm: Float64[np.ndarray, "3"]

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation in degrees."""
        return float(np.rad2deg(self.rotation.magnitude()))

    @property
    def translation_mm(self) -> float:
        """Length of the translation in mm."""
        return float(np.linalg.norm(self.shift_mm))


@dataclass(frozen=True)
class PoseRange:
    """Range of poses that are drawn.

    Parameters
    ----------
    angle_max_deg : float
        Largest angle in degrees, at most 180; the angle is uniform from 0.
    translation_max_mm : float
        Largest translation in mm; its direction is uniform.
    translation_min_mm : float, optional
        Smallest translation in mm; its length is uniform in between.
    rotation : {"any", "roll", "flip"}, optional
        Axis uniform on the sphere, rotation about the principal axis, or 180 degrees about an axis across it,
        uniform around the vessel.
    angle_bin_deg : float or None, optional
        Width in degrees of bins that the trials go through in turn, the angle uniform within the bin; a whole
        part of ``angle_max_deg``. None for a single bin.

    Raises
    ------
    InputError
        If a value is out of range, the kind is unknown, or the bins do not divide the range.
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
        """Number of bins of angles that the trials fall into; a flip has one angle."""
        if self.angle_bin_deg is None or self.rotation == FLIP:
            return 1
        return round(self.angle_max_deg / self.angle_bin_deg)

    def draw(
        self, principal_axis: Float64[np.ndarray, "3"], trial: int, rng: np.random.Generator
    ) -> PerturbedPose:
        """Draw the pose of a trial.

        Parameters
        ----------
        principal_axis : ndarray, shape (3,)
            Principal axis of the vessel, of unit length.
        trial : int
            Number of the trial, from 0; it decides the bin.
        rng : numpy.random.Generator
            Random stream of the trial.

        Returns
        -------
        PerturbedPose
            Rotation and translation.

        Raises
        ------
        InputError
            If the number is negative.
        """
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
