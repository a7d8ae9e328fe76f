"""Symmetries of a vessel: the motions after which it lies on itself, so that more than one pose of it is right."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.checks import require_at_least
from registration.errors import InputError

# The nearest of all right poses is looked for on a grid of so many places a motion, and from there to its minimum.
GRID = 73
# So many targets are enough to find it.
SEARCH_TARGETS = 60


@dataclass(frozen=True)
class Screw:
    """Motions by one number s from ``low`` to ``high``: a rotation about a line and a translation along it.

    Without a translation it is a roll, without a rotation a straight slide.

    Parameters
    ----------
    point_mm : ndarray, shape (3,)
        Point on the line, in the fixed frame in mm.
    direction : ndarray, shape (3,)
        Unit vector along the line.
    turn_deg : float
        Rotation at s = 1 in degrees.
    shift_mm : float
        Translation at s = 1 in mm.
    low, high : float
        Range of s.

    Raises
    ------
    InputError
        If the direction has not unit length or the range is inverted.
    """

    point_mm: Float64[np.ndarray, "3"]
    direction: Float64[np.ndarray, "3"]
    turn_deg: float
    shift_mm: float
    low: float
    high: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.direction))
        if not abs(length - 1) < 1e-9:
            raise InputError(f"direction: expected a unit vector, received one of length {length:g}")
        require_at_least("high", self.high, self.low)

    def __call__(self, s: Float64[np.ndarray, " k"]) -> Float64[np.ndarray, "k 4 4"]:
        """Evaluate the motions.

        Parameters
        ----------
        s : ndarray, shape (k,)
            Values of the parameter.

        Returns
        -------
        ndarray, shape (k, 4, 4)
            Rigid motions (fixed_T_fixed), one for each value.
        """
        turns = Rotation.from_rotvec(np.deg2rad(self.turn_deg) * s[:, None] * self.direction)
        moved_mm = self.point_mm - turns.apply(self.point_mm) + self.shift_mm * s[:, None] * self.direction
        return transforms.from_rotation(turns, moved_mm)


@dataclass(frozen=True)
class Symmetry:
    """All motions that leave a vessel as it is: each screw by any amount, then one of the flips or none.

    A piece slides along the vessel first, within its ends, and the vessel is flipped after. An empty symmetry
    is that of most vessels.

    Parameters
    ----------
    screws : tuple of Screw, optional
        Continuous motions.
    flips : tuple of ndarray, shape (4, 4), optional
        Single rigid motions, such as half a turn.
    """

    screws: tuple[Screw, ...] = ()
    flips: tuple[Float64[np.ndarray, "4 4"], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.screws or self.flips)

    def nearest(
        self,
        fixed_T_moving: Float64[np.ndarray, "4 4"],
        true_fixed_T_moving: Float64[np.ndarray, "4 4"],
        targets_mm: Float64[np.ndarray, "t 3"],
    ) -> Float64[np.ndarray, "4 4"]:
        """Find the equally right pose that differs least from an estimate at the targets.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Estimated pose.
        true_fixed_T_moving : ndarray, shape (4, 4)
            True pose.
        targets_mm : ndarray, shape (t, 3)
            Targets in the fixed frame in mm.

        Returns
        -------
        ndarray, shape (4, 4)
            The nearest of all poses that are as right as the true one.
        """
        error = transforms.compose(fixed_T_moving, transforms.invert_rigid(true_fixed_T_moving))
        few_mm = targets_mm[:: max(len(targets_mm) // SEARCH_TARGETS, 1)]
        best = min((self._best(error, few_mm, flip) for flip in (np.eye(4), *self.flips)), key=lambda b: b[0])
        return transforms.compose(best[1], true_fixed_T_moving)

    def _best(self, error: np.ndarray, targets_mm: np.ndarray, flip: np.ndarray) -> tuple[float, np.ndarray]:
        """The smallest squared error over the screws before one flip, and the motion that has it."""

        def motions(places: np.ndarray) -> np.ndarray:
            made = np.broadcast_to(np.eye(4), (len(places), 4, 4))
            for number, screw in enumerate(self.screws):
                made = screw(places[:, number]) @ made
            return np.asarray(flip @ made)

        def cost(places: np.ndarray) -> np.ndarray:
            left = error @ transforms.invert_rigid(motions(places))
            moved_mm = targets_mm @ np.swapaxes(left[:, :3, :3], 1, 2) + left[:, None, :3, 3]
            return np.asarray(((moved_mm - targets_mm) ** 2).sum(axis=2).mean(axis=1))

        if not self.screws:
            return float(cost(np.zeros((1, 0)))[0]), flip
        grid = np.array(
            list(itertools.product(*(np.linspace(screw.low, screw.high, GRID) for screw in self.screws)))
        )
        start = grid[int(cost(grid).argmin())]
        found = minimize(
            lambda place: float(cost(place[None])[0]),
            start,
            method="Nelder-Mead",
            bounds=[(screw.low, screw.high) for screw in self.screws],
            options={"xatol": 1e-7, "fatol": 1e-10},
        )
        return float(found.fun), motions(found.x[None])[0]


def half_turn(
    point_mm: Float64[np.ndarray, "3"], direction: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "4 4"]:
    """Make half a turn about a line.

    Parameters
    ----------
    point_mm : ndarray, shape (3,)
        Point on the line in mm.
    direction : ndarray, shape (3,)
        Unit vector along the line.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform.
    """
    return transforms.rotate_about(Rotation.from_rotvec(np.pi * direction), point_mm)
