"""A bent tube and a copy of it drawn anew and brought elsewhere by a known pose, for the tests of rigid methods."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.geometry.shapes import principal_frame

TUBE = bent_tube()
FIXED = TUBE.sample(2500, np.random.default_rng(0))
DRAWN = TUBE.sample(1500, np.random.default_rng(1))


def moved_by(angle_deg: float, shift_mm: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The cloud turned about its centroid and moved, and the fixed_T_moving that brings it back."""
    axis, direction = np.random.default_rng(seed).normal(size=(2, 3))
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * axis / np.linalg.norm(axis))
    shift = transforms.translation(shift_mm * direction / np.linalg.norm(direction))
    moving_T_fixed = transforms.compose(shift, transforms.rotate_about(turn, DRAWN.mean(axis=0)))
    return transforms.apply(moving_T_fixed, DRAWN), transforms.invert_rigid(moving_T_fixed)


def upside_down() -> tuple[np.ndarray, np.ndarray]:
    """The cloud turned over end for end: as far from the truth as a vessel can lie with its axis where it was."""
    frame = principal_frame(DRAWN)
    over = transforms.rotate_about(Rotation.from_rotvec(np.pi * frame.axes[:, 1]), frame.centre_mm)
    return transforms.apply(over, DRAWN), transforms.invert_rigid(over)


def farthest_mm(found: np.ndarray, truth: np.ndarray, moving_mm: np.ndarray) -> float:
    """How far apart two poses put any point."""
    return float(
        np.linalg.norm(transforms.apply(found, moving_mm) - transforms.apply(truth, moving_mm), axis=1).max()
    )
