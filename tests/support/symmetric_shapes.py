"""Vessels with a symmetry, as clouds drawn by formula: more than one pose of them is right."""

from __future__ import annotations

import numpy as np


def around(middle_mm: np.ndarray, radius_mm: np.ndarray | float, rng: np.random.Generator) -> np.ndarray:
    """One point of the wall around each point of a line along z, at a random angle."""
    angle = rng.uniform(0, 2 * np.pi, len(middle_mm))
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    return middle_mm + np.broadcast_to(radius_mm, len(middle_mm))[:, None] * rim


def straight_tube(first_mm: float, last_mm: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """The wall of an open straight tube of 4 mm radius along z."""
    along = rng.uniform(first_mm, last_mm, count)
    return around(np.outer(along, [0.0, 0.0, 1.0]), 4.0, rng)


def frustum(count: int, rng: np.random.Generator) -> np.ndarray:
    """The wall of a cone cut off, 60 mm long, 3 to 9 mm in radius."""
    along = rng.uniform(0, 60, count)
    return around(np.outer(along, [0.0, 0.0, 1.0]), 3 + along / 10, rng)


def torus_piece(first_deg: float, last_deg: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """The wall of a piece of a ring of 40 mm radius, 4 mm thick in radius."""
    turn = np.deg2rad(rng.uniform(first_deg, last_deg, count))
    angle = rng.uniform(0, 2 * np.pi, count)
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    return (40 + 4 * np.cos(angle))[:, None] * out + np.outer(4 * np.sin(angle), [0.0, 0.0, 1.0])


def twisted_fork(count: int, rng: np.random.Generator) -> np.ndarray:
    """A trunk that forks into two branches bent to opposite sides: turned by 180 degrees about z it is itself again.

    It has no mirror plane, and no other rotation brings it back.
    """
    share = rng.uniform(0, 1, count)
    side = np.where(rng.uniform(size=count) < 0.5, 1.0, -1.0)
    branch = np.stack([side * 16 * share, side * 9 * share**2, 30 * share], axis=1)
    trunk = np.outer(-30 * share, [0.0, 0.0, 1.0])
    on_trunk = rng.uniform(size=count) < 0.4
    return around(np.where(on_trunk[:, None], trunk, branch), np.where(on_trunk, 4.0, 2.8), rng)
