"""Starting poses for a rigid search: principal axes laid on each other, rolled, inverted and slid along the vessel."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import frames
from registration.geometry import PrincipalFrame, principal_frame

# Below this share of the moving cloud's length there is no room to slide: the whole is one window.
NO_ROOM_SHARE = 0.05
# A window with fewer points than this has no principal axes worth laying anything on.
WINDOW_POINTS = 10
# A sliver of a long vessel would otherwise ask for more starts than anyone waits for.
MOST_WINDOWS = 40


def symmetry_starts(
    moving_mm: Float64[np.ndarray, "m 3"],
    fixed_mm: Float64[np.ndarray, "n 3"],
    rolls: int,
    slide_share: float,
    axis_share: float,
) -> Float64[np.ndarray, "s 4 4"]:
    """Every start worth trying without prior knowledge, as fixed_T_moving.

    The principal axis of the moving cloud is laid on that of a window of the fixed one, both ways round, and rolled
    about it in ``rolls`` equal steps. The windows are as long as the moving cloud and slide along the fixed one in
    steps of at most ``slide_share`` of that length (in 40 places at most): the axes of a piece are those of the same
    piece of the whole, not those of the whole. A moving cloud as long as the fixed one has one window.

    A short piece with a bifurcation is as wide as it is long, and noise decides which axis comes first: every axis
    with a spread of at least ``axis_share`` of the first is therefore taken for the principal one in turn.
    """
    moving = principal_frame(moving_mm)
    turns = Rotation.from_rotvec(np.arange(rolls)[:, None] * [2 * np.pi / rolls, 0.0, 0.0])
    inverted = turns * Rotation.from_rotvec([0.0, np.pi, 0.0])
    local = np.concatenate([turns.as_matrix(), inverted.as_matrix()])
    starts = []
    for first in np.flatnonzero(moving.spread_mm >= axis_share * moving.spread_mm[0]):
        axes = np.roll(moving.axes, -int(first), axis=1)
        length_mm = float(np.ptp((moving_mm - moving.centre_mm) @ axes[:, 0]))
        for window in _windows(fixed_mm, length_mm, slide_share):
            rotation = Rotation.from_matrix(window.axes @ local @ axes.T)
            starts.append(frames.from_rotation(rotation, window.centre_mm - rotation.apply(moving.centre_mm)))
    return np.concatenate(starts)


def cone_starts(
    moving_mm: Float64[np.ndarray, "m 3"], initial: Float64[np.ndarray, "4 4"], cone_deg: float
) -> Float64[np.ndarray, "s 4 4"]:
    """A known pose, and the same pose turned about each principal axis of the moving cloud, within a cone.

    Thirteen starts, the known pose first; the others are turned by half and by all of ``cone_deg``, both ways.
    """
    moving = principal_frame(moving_mm)
    angles = np.deg2rad(cone_deg) * np.array([-1.0, -0.5, 0.5, 1.0])
    rotations = Rotation.from_rotvec((angles[:, None, None] * moving.axes.T[None]).reshape(-1, 3))
    turned = frames.from_rotation(rotations, moving.centre_mm - rotations.apply(moving.centre_mm))
    return np.concatenate([initial[None], initial @ turned])


def _windows(
    fixed_mm: Float64[np.ndarray, "n 3"], length_mm: float, slide_share: float
) -> list[PrincipalFrame]:
    whole = principal_frame(fixed_mm)
    along_mm = (fixed_mm - whole.centre_mm) @ whole.axes[:, 0]
    first_mm, last_mm = float(along_mm.min()), float(along_mm.max())
    room_mm = last_mm - first_mm - length_mm
    if room_mm <= NO_ROOM_SHARE * length_mm:
        return [whole]
    count = min(1 + int(np.ceil(room_mm / (slide_share * length_mm))), MOST_WINDOWS)
    windows = []
    for middle_mm in np.linspace(first_mm + length_mm / 2, last_mm - length_mm / 2, count):
        inside = np.abs(along_mm - middle_mm) <= length_mm / 2
        if inside.sum() >= WINDOW_POINTS:
            windows.append(principal_frame(fixed_mm[inside]))
    return windows or [whole]
