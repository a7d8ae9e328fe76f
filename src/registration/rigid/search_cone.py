"""How far a search may go from a pose that is known beforehand."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.checks import require_positive
from registration.errors import InputError

# A result beyond this share of what the bound allows lies at the bound.
EDGE_SHARE = 0.95
# A pose that is put on the bound stays within it by this share, whatever rounding does.
INSIDE_SHARE = 1e-9


@dataclass(frozen=True)
class SearchBound:
    """How far a result may lie from a known pose where the call gives no search cone.

    Parameters
    ----------
    angle_deg : float, optional
        Largest angle in degrees of the rotation between both poses, above 0 to 180.
    radius_mm : float, optional
        Largest distance in mm that the moving cloud's centroid may lie from where the known pose puts it.

    Raises
    ------
    InputError
        If the angle or the distance is outside its range.
    """

    angle_deg: float = 45.0
    radius_mm: float = 20.0

    def __post_init__(self) -> None:
        require_positive("angle_deg", self.angle_deg, 180.0)
        require_positive("radius_mm", self.radius_mm)


# Of any method without settings of its own.
DEFAULT_BOUND = SearchBound()


@dataclass(frozen=True)
class SearchCone:
    """A bound on the result around a known pose, as far as the caller gives one.

    Parameters
    ----------
    angle_deg : float or None, optional
        Largest angle in degrees of the rotation between both poses; None stands for the method's own bound.
    radius_mm : float or None, optional
        Largest distance in mm of the moving cloud's centroid from where the known pose puts it; None likewise.

    Raises
    ------
    InputError
        If the angle or the distance is outside its range.
    """

    angle_deg: float | None = None
    radius_mm: float | None = None

    def __post_init__(self) -> None:
        if self.angle_deg is not None:
            require_positive("angle_deg", self.angle_deg, 180.0)
        if self.radius_mm is not None:
            require_positive("radius_mm", self.radius_mm)


# For a step of a method whose whole result is bounded afterwards.
UNBOUNDED = SearchCone(180.0, sys.float_info.max)


@dataclass(frozen=True)
class Bound:
    """The poses within a cone of a known one.

    Parameters
    ----------
    initial : ndarray, shape (4, 4)
        Known pose (fixed_T_moving).
    cone : SearchCone
        Largest rotation and shift, as far as given.
    centre_mm : ndarray, shape (3,)
        Centroid of the moving cloud in mm.
    default : SearchBound, optional
        Bound on what the cone leaves open.
    """

    initial: Float64[np.ndarray, "4 4"]
    cone: SearchCone
    centre_mm: Float64[np.ndarray, "3"]
    default: SearchBound = DEFAULT_BOUND

    @property
    def angle_deg(self) -> float:
        """The largest angle that is allowed."""
        return self.default.angle_deg if self.cone.angle_deg is None else self.cone.angle_deg

    @property
    def radius_mm(self) -> float:
        """The largest shift of the centroid that is allowed."""
        return self.default.radius_mm if self.cone.radius_mm is None else self.cone.radius_mm

    @property
    def kept_to(self) -> SearchCone:
        """Both bounds as they are in force."""
        return SearchCone(self.angle_deg, self.radius_mm)

    def away(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> tuple[float, float]:
        """Compute how far a pose is from the known one.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        turn_deg : float
            Angle of the rotation between both in degrees.
        away_mm : float
            Shift of the moving cloud's centroid in mm.
        """
        turn_deg = transforms.rotation_angle_deg(
            transforms.compose(fixed_T_moving, transforms.invert_rigid(self.initial))
        )
        return float(turn_deg), float(np.linalg.norm(self._shift_mm(fixed_T_moving)))

    def holds(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> bool:
        """Tell whether a pose lies within the bound.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        bool
            Whether it does.
        """
        turn_deg, away_mm = self.away(fixed_T_moving)
        return turn_deg <= self.angle_deg and away_mm <= self.radius_mm

    def held(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
        """Bring a pose within the bound.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        ndarray, shape (4, 4)
            The pose itself if it is within, else the one on the bound on the way to it from the known pose.
        """
        if self.holds(fixed_T_moving):
            return fixed_T_moving
        turn_deg, away_mm = self.away(fixed_T_moving)
        turn = Rotation.from_matrix((fixed_T_moving @ transforms.invert_rigid(self.initial))[:3, :3])
        part = _share(self.angle_deg, turn_deg)
        about_mm = transforms.apply(self.initial, self.centre_mm)
        turned = transforms.rotate_about(Rotation.from_rotvec(part * turn.as_rotvec()), about_mm)
        shift_mm = _share(self.radius_mm, away_mm) * self._shift_mm(fixed_T_moving)
        return transforms.compose(transforms.translation(shift_mm), turned, self.initial)

    def at_edge(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> str:
        """Say that a pose lies at the bound, so that the right one may lie beyond it.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        str
            The sentence; empty for a pose that does not.
        """
        turn_deg, away_mm = self.away(fixed_T_moving)
        near = [
            f"{value:.1f} of {limit:g} {unit}"
            for value, limit, unit in (
                (turn_deg, self.angle_deg, "degrees"),
                (away_mm, self.radius_mm, "mm"),
            )
            if value > EDGE_SHARE * limit
        ]
        if not near:
            return ""
        return f"it lies at the bound of the search ({' and '.join(near)} from the initial pose)"

    def describe(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> str:
        """Say where a pose outside the bound lies.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        str
            Part of a sentence.
        """
        turn_deg, away_mm = self.away(fixed_T_moving)
        return (
            f"{turn_deg:.1f} degrees and {away_mm:.1f} mm from the initial pose, outside the search cone of "
            f"{self.angle_deg:g} degrees and {self.radius_mm:g} mm"
        )

    def _shift_mm(self, fixed_T_moving: np.ndarray) -> Float64[np.ndarray, "3"]:
        shift: Float64[np.ndarray, "3"] = transforms.apply(fixed_T_moving, self.centre_mm) - transforms.apply(
            self.initial, self.centre_mm
        )
        return shift


def known_pose(
    initial: ArrayLike | None, search_cone: SearchCone | None
) -> Float64[np.ndarray, "4 4"] | None:
    """Check a known pose and the cone around it.

    Parameters
    ----------
    initial : array_like, shape (4, 4), or None
        Known pose (fixed_T_moving).
    search_cone : SearchCone or None
        Bound around it.

    Returns
    -------
    ndarray, shape (4, 4), or None
        Known pose as float64; None where there is none.

    Raises
    ------
    InputError
        If the pose is not rigid, or there is a cone around none.
    """
    if initial is not None:
        try:
            pose = np.asarray(initial, dtype=np.float64)
        except (TypeError, ValueError) as refusal:
            raise InputError("initial: expected a matrix of shape (4, 4), received no numbers") from refusal
        if pose.shape != (4, 4):
            raise InputError(f"initial: expected a matrix of shape (4, 4), received shape {pose.shape}")
        return transforms.require_rigid(pose, "initial")
    if search_cone is not None:
        raise InputError("search_cone: expected an initial pose to search around, received none")
    return None


def bound_around(
    initial: Float64[np.ndarray, "4 4"] | None,
    search_cone: SearchCone | None,
    moving_mm: Float64[np.ndarray, "m 3"],
    default: SearchBound = DEFAULT_BOUND,
) -> Bound | None:
    """Assemble the bound on the result around a known pose.

    Parameters
    ----------
    initial : ndarray, shape (4, 4), or None
        Known pose (fixed_T_moving).
    search_cone : SearchCone or None
        Bound of the caller's; None where there is none.
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    default : SearchBound, optional
        Bound on what the caller's leaves open.

    Returns
    -------
    Bound or None
        The bound; None where no pose is known.
    """
    if initial is None:
        return None
    return Bound(initial, search_cone or SearchCone(), moving_mm.mean(axis=0), default)


def _share(limit: float, value: float) -> float:
    return min(1.0, (1 - INSIDE_SHARE) * limit / value) if value > 0 else 1.0
