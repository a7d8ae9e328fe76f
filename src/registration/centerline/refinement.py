"""Refinement of a rough path to the curve of lowest cost, below the spacing of any grid or sample."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.signal import savgol_filter

from registration.centerline.vessel_walls import Walls

# Spacing of the candidates around a path, in radii, in successive rounds, and number of steps to each side.
PITCHES_RADII = (0.05, 0.02, 0.01)
STEPS_OUT = 4


def refine(
    points_mm: Float64[np.ndarray, "n 3"], walls: Walls, step_mm: float, smoothing_mm: float
) -> Float64[np.ndarray, "m 3"]:
    """Move a path to where the integral of length over radius is lowest.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Rough path in mm.
    walls : Walls
        Walls of the vessel.
    step_mm : float
        Approximate distance of the resulting points in mm.
    smoothing_mm : float
        Window of the smoothing in mm.

    Returns
    -------
    ndarray, shape (m, 3)
        Points in mm; both ends are those of the rough path.

    Notes
    -----
    The integral is what a centerline by maximal inscribed spheres minimises. Each round lays candidates in
    the planes across the path, takes their exact distance to the wall as radius, and finds the cheapest
    sequence by dynamic programming. A local cubic fit then smooths the steps of the candidates; unlike a mean
    it does not pull bends inwards.

    References
    ----------
    L. Antiga, B. Ene-Iordache and A. Remuzzi, IEEE TMI 22(5), 2003; A. A. Amini, T. E. Weymouth and R. C.
    Jain, IEEE TPAMI 12(9), 1990 (dynamic programming, for contours).
    """
    line_mm = resample(points_mm, step_mm)
    for pitch_radii in PITCHES_RADII:
        radius_mm = np.maximum(walls.distance_mm(line_mm), 1e-6)
        line_mm = resample(_cheapest(line_mm, pitch_radii * radius_mm, walls), step_mm)
    smooth_mm = _smooth(line_mm, smoothing_mm / step_mm)
    smooth_mm[[0, -1]] = line_mm[[0, -1]]
    return resample(smooth_mm, step_mm)


def resample(points_mm: Float64[np.ndarray, "n 3"], step_mm: float) -> Float64[np.ndarray, "m 3"]:
    """Resample a path in equal steps.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Path in mm.
    step_mm : float
        Approximate step in mm.

    Returns
    -------
    ndarray, shape (m, 3)
        Points in mm, at least five; both ends are kept.
    """
    steps_mm = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    arc_mm = np.concatenate([[0.0], np.cumsum(steps_mm)])
    even_mm = np.linspace(0.0, arc_mm[-1], max(round(arc_mm[-1] / step_mm), 4) + 1)
    return np.stack([np.interp(even_mm, arc_mm, points_mm[:, axis]) for axis in range(3)], axis=1)


def _cheapest(
    line_mm: Float64[np.ndarray, "n 3"], pitch_mm: Float64[np.ndarray, " n"], walls: Walls
) -> Float64[np.ndarray, "n 3"]:
    first, second = _across(line_mm)
    steps = np.arange(-STEPS_OUT, STEPS_OUT + 1)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    disc = a**2 + b**2 <= STEPS_OUT**2
    offsets = a[disc, None] * first + b[disc, None] * second
    candidates_mm = line_mm[:, None] + pitch_mm[:, None, None] * offsets
    radius_mm = walls.distance_mm(candidates_mm.reshape(-1, 3)).reshape(candidates_mm.shape[:2])
    weight = 1 / np.maximum(radius_mm, 1e-6)
    count, width = weight.shape
    # Both ends stay: only the middle of the first and the last plane is allowed.
    fixed = np.where(np.abs(offsets[0]).sum(axis=1) == 0, 0.0, np.inf)
    cost = fixed
    back = np.zeros((count, width), dtype=np.int64)
    for place in range(1, count):
        apart_mm = np.linalg.norm(candidates_mm[place][None] - candidates_mm[place - 1][:, None], axis=2)
        total = cost[:, None] + 0.5 * apart_mm * (weight[place][None] + weight[place - 1][:, None])
        back[place] = total.argmin(axis=0)
        cost = total.min(axis=0)
    chosen = np.zeros(count, dtype=np.int64)
    chosen[-1] = (cost + fixed).argmin()
    for place in range(count - 1, 0, -1):
        chosen[place - 1] = back[place, chosen[place]]
    return candidates_mm[np.arange(count), chosen]


def _across(
    line_mm: Float64[np.ndarray, "n 3"],
) -> tuple[Float64[np.ndarray, "n 1 3"], Float64[np.ndarray, "n 1 3"]]:
    """Two unit vectors at right angles to the line at each point, with an axis in between to lay a grid on."""
    along = np.gradient(_smooth(line_mm, 5.0), axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    smallest_axis = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(along, smallest_axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first[:, None], np.cross(along, first)[:, None]


def _smooth(line_mm: Float64[np.ndarray, "n 3"], window: float) -> Float64[np.ndarray, "n 3"]:
    """Fit a cubic to the points of each odd window (Savitzky and Golay, Anal. Chem. 36(8), 1964)."""
    odd = 2 * int(window / 2) + 1
    odd = min(odd, len(line_mm) - 1 + len(line_mm) % 2)
    if odd < 5:
        return line_mm.copy()
    fitted: np.ndarray = savgol_filter(line_mm, odd, 3, axis=0, mode="interp")
    return fitted
