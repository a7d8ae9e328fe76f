"""What poses of any recording must be: unit quaternions within a tolerance, positions in a unit that fits a sweep."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from registration.errors import InputError

MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}
# Quaternions written with two or three digits are off length 1 by up to half a percent; one that is off by more than
# a percent was not written as a rotation.
QUATERNION_TOLERANCE = 0.01
# A probe is moved over a vessel by centimetres: in metres a sweep spans less than 1, in millimetres more. No robot or
# patient is longer than 3 m. Where the origin lies has no part in it.
SPAN_MM = (1.0, 3000.0)
# No end effector keeps within 3 mm of its robot's base.
_MIN_REACH_MM = 3.0
# A single mislaid pose decides nothing: the span is that of the middle 90 % along each axis.
_MIDDLE = (5, 95)


def unit_quaternions(quaternions: Float64[np.ndarray, "n 4"]) -> Bool[np.ndarray, " n"]:
    """Tell which quaternions are of length 1 within ``QUATERNION_TOLERANCE``; scaled to 1 they are rotations.

    Parameters
    ----------
    quaternions : ndarray, shape (n, 4)
        Quaternions.

    Returns
    -------
    ndarray of bool, shape (n,)
        Which are rotations.
    """
    return np.abs(np.linalg.norm(quaternions, axis=1) - 1) <= QUATERNION_TOLERANCE


def span_mm(positions_mm: Float64[np.ndarray, "n 3"]) -> float:
    """Compute the diagonal of the box that the middle 90 % of the positions fill along each axis.

    Parameters
    ----------
    positions_mm : ndarray, shape (n, 3)
        Positions in mm.

    Returns
    -------
    float
        Diagonal in mm.
    """
    low, high = np.percentile(positions_mm, _MIDDLE, axis=0)
    return float(np.linalg.norm(high - low))


def require_unit(positions_mm: Float64[np.ndarray, "n 3"], unit: str, name: str, setting: str) -> None:
    """Raise InputError where positions span what no sweep does in their unit.

    Positions that all agree (one pose, a probe at rest) leave their unit open, unless all lie within 3 mm of
    the origin.

    Parameters
    ----------
    positions_mm : ndarray, shape (n, 3)
        Positions in mm, if ``unit`` is right.
    unit : {'mm', 'm'}
        Unit that they were taken to be in.
    name : str
        Name of the file, for messages.
    setting : str
        How to state the unit, for the message.

    Raises
    ------
    InputError
        If they span too little or too much.
    """
    if not len(positions_mm):
        return
    found_mm, scale = span_mm(positions_mm), MM_PER_UNIT[unit]
    reach_mm = float(np.abs(positions_mm).max())
    small = 0 < found_mm < SPAN_MM[0] or 0 < reach_mm < _MIN_REACH_MM
    if unit == "mm" and small:
        raise InputError(
            f"{name}: expected positions in mm, found a span of {found_mm:.3g} mm within {reach_mm:.3g} mm of the "
            f"origin (were they metres? {setting})"
        )
    if found_mm > SPAN_MM[1]:
        other = "millimetres" if unit == "m" else "micrometres"
        raise InputError(
            f"{name}: expected positions in {unit} that span at most {SPAN_MM[1] / scale:g} {unit}, found "
            f"{found_mm / scale:.3g} {unit} (were they {other}? {setting})"
        )
