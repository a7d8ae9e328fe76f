"""Starts and points are drawn as the benchmark says: angles, lengths, stray points, each known from the draw itself."""

from __future__ import annotations

import numpy as np
import pytest

from registration import transforms
from registration.benchmark.initial_offset import draw_points, draw_start

CLOUD = np.random.default_rng(0).normal(size=(800, 3)) * [20.0, 5.0, 5.0] + [100.0, 50.0, -30.0]


def test_a_start_turns_about_the_centroid_and_then_shifts() -> None:
    for seed in range(20):
        start = draw_start(CLOUD, np.random.default_rng(seed))
        transforms.require_rigid(start.moved_T_true, "moved_T_true")
        centre = CLOUD.mean(axis=0)
        moved = transforms.apply(start.moved_T_true, centre)
        assert np.linalg.norm(moved - centre) == pytest.approx(start.translation_mm)
        assert transforms.rotation_angle_deg(start.moved_T_true) == pytest.approx(start.angle_deg)


def test_angles_and_lengths_fill_their_ranges_evenly() -> None:
    rng = np.random.default_rng(1)
    starts = [draw_start(CLOUD, rng) for _ in range(2000)]
    angles = np.array([start.angle_deg for start in starts])
    lengths = np.array([start.translation_mm for start in starts])
    for values, most in ((angles, 180.0), (lengths, 50.0)):
        counts, _ = np.histogram(values, 10, (0.0, most))
        assert counts.sum() == 2000
        assert counts.min() > 150
        assert counts.max() < 250
    axes = np.array([start.moved_T_true[:3, :3] @ [1.0, 0, 0] for start in starts])
    assert np.abs(axes.mean(axis=0)[1:]).max() < 0.06


def test_points_are_those_of_the_cloud_without_repetition() -> None:
    drawn = draw_points(CLOUD, 300, 0.0, np.random.default_rng(0))
    assert drawn.points_mm.shape == (300, 3)
    assert len(np.unique(drawn.index)) == 300
    np.testing.assert_array_equal(drawn.points_mm, CLOUD[drawn.index])
    assert not drawn.outlier.any()
    assert len(draw_points(CLOUD, 5000, 0.0, np.random.default_rng(0)).points_mm) == 800


def test_stray_points_lie_in_the_grown_box_and_name_their_nearest_neighbour() -> None:
    drawn = draw_points(CLOUD, 400, 0.1, np.random.default_rng(2))
    assert drawn.outlier.sum() == 40
    np.testing.assert_array_equal(drawn.points_mm[~drawn.outlier], CLOUD[drawn.index[~drawn.outlier]])
    # In random order: neither the first nor the last points alone.
    assert 5 < np.flatnonzero(drawn.outlier)[:20].max() < 395
    stray = drawn.points_mm[drawn.outlier]
    genuine = CLOUD
    size = np.ptp(genuine, axis=0)
    assert (stray >= genuine.min(axis=0) - 0.5 * size).all()
    assert (stray <= genuine.max(axis=0) + 0.5 * size).all()
    assert (np.ptp(stray, axis=0) > 1.2 * size).all()
    nearest = np.linalg.norm(stray[:, None] - CLOUD[None], axis=2).argmin(axis=1)
    np.testing.assert_array_equal(drawn.index[drawn.outlier], nearest)
