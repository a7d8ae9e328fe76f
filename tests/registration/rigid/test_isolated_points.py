"""Points with nobody around them are told from those of a vessel's wall."""

from __future__ import annotations

import numpy as np
from vessels import bent_tube

from registration.rigid.isolated_points import is_isolated, isolated_points


def test_points_far_from_a_wall_are_isolated_and_those_on_it_are_not() -> None:
    rng = np.random.default_rng(0)
    wall = bent_tube().sample(1500, rng) + rng.normal(scale=0.3, size=(1500, 3))
    away = wall.max(axis=0) + 20 + rng.uniform(0, 200, (60, 3))
    found = isolated_points(np.concatenate([wall, away]))
    assert found[1500:].all()
    assert found[:1500].sum() <= 3


def test_a_frame_that_stands_alone_is_not_isolated() -> None:
    """Rings 4 mm apart, one of them 20 mm from the next: its points have each other."""
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([5 * np.cos(turn), 5 * np.sin(turn), np.zeros(40)], axis=1)
    rings = np.concatenate([ring + np.array([0.0, 0, z]) for z in (0, 4, 8, 12, 32)])
    assert not isolated_points(rings).any()


def test_a_small_cloud_has_none() -> None:
    points = np.concatenate([np.random.default_rng(1).normal(size=(40, 3)), [[500.0, 0, 0]]])
    assert not isolated_points(points).any()


def test_the_rule_is_four_times_the_usual_distance() -> None:
    np.testing.assert_array_equal(is_isolated(np.array([1.0, 1, 1, 4, 4.1])), [False] * 4 + [True])
