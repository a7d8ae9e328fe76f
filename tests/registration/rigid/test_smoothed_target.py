"""The smooth surface through a noisy cloud: no bias, and normals that point out of the vessel."""

from __future__ import annotations

import numpy as np
import pytest
from symmetric_shapes import twisted_fork
from vessels import bent_tube

from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.smoothed_target import SmoothedTarget, outward_targets, smoothed_at


def test_a_noisy_sphere_is_smoothed_without_being_flattened() -> None:
    """The mean of the nearest points lies well inside the sphere; the quadric does not."""
    rng = np.random.default_rng(6)
    way = rng.normal(size=(8000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    target = TreeTarget(way * (10 + rng.normal(scale=0.1, size=(8000, 1))))
    asked = 10.5 * way[:300]
    smoothed = smoothed_at(target, asked, 60)
    radius = np.linalg.norm(smoothed.points_mm, axis=1)
    assert np.linalg.norm(target.patches(asked, 60)[0].mean(axis=1), axis=1).mean() < 9.94
    assert abs(radius.mean() - 10) < 0.02
    assert radius.std() < 0.1
    assert np.abs((smoothed.normals * way[:300]).sum(axis=1)).min() > 0.97
    # Both curvatures are a tenth, seen from a normal that may point either way.
    assert np.abs(smoothed.bend_per_mm).mean() == pytest.approx(0.09, abs=0.02)
    # Sixty points of eight thousand cover this much of a sphere of 10 mm, seen from half a millimetre above.
    assert smoothed.reach_mm == pytest.approx(np.hypot(20 * np.sqrt(60 / 8000), 0.5), rel=0.1)


def test_a_smoothed_cloud_answers_with_its_smoothed_points() -> None:
    rng = np.random.default_rng(7)
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    noisy = grid + rng.normal(scale=0.3, size=grid.shape) * [0, 0, 1]
    smooth = SmoothedTarget(TreeTarget(noisy), 40)
    assert smooth.points_mm[:, 2].std() < 0.6 * noisy[:, 2].std()
    found = smooth.points_mm[smooth.closest(np.array([[5.1, 6.2, 3.0]]))]
    np.testing.assert_allclose(found[0, :2], [5, 6], atol=0.2)
    assert np.abs(smooth.normals[:, 2]).min() > 0.9


def test_points_on_a_line_are_smoothed_to_finite_places() -> None:
    line = np.outer(np.arange(50.0), [1.0, 2.0, 3.0])
    smoothed = smoothed_at(TreeTarget(line), line[10:20], 12)
    np.testing.assert_allclose(smoothed.points_mm, line[10:20], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(smoothed.normals, axis=1), 1)


@pytest.mark.parametrize("noise_mm", [0.0, 0.4])
def test_normals_point_out_of_a_vessel(noise_mm: float) -> None:
    """A tube drawn by formula, whose middle is known."""
    tube = bent_tube()
    middle = tube.vertices_mm[:-2].reshape(-1, 32, 3).mean(axis=1)
    rng = np.random.default_rng(3)
    cloud = tube.sample(4000, rng) + rng.normal(scale=noise_mm, size=(4000, 3))
    for target in outward_targets(cloud, 20, 40):
        away = target.points_mm - middle[TreeTarget(middle).closest(target.points_mm)]
        # The closed ends face along the vessel, and an oval wall not quite away from its middle.
        wall = np.abs((away / np.linalg.norm(away, axis=1, keepdims=True) * target.normals).sum(axis=1)) > 0.5
        assert wall.mean() > 0.6
        assert ((away * target.normals).sum(axis=1)[wall] > 0).mean() > 0.98


def test_normals_point_outwards_in_the_crotch_of_a_fork_too() -> None:
    """Grown along its normals a fork gets farther from its own lines, but for walls inside the other branch."""
    rng = np.random.default_rng(4)
    cloud = twisted_fork(6000, rng)
    _, smoothed = outward_targets(cloud, 20, 40)
    share = np.linspace(0, 1, 200)
    lines = np.concatenate(
        [
            np.outer(-30 * share, [0.0, 0, 1]),
            *(np.stack([side * 16 * share, side * 9 * share**2, 30 * share], axis=1) for side in (-1, 1)),
        ]
    )
    inside = TreeTarget(lines)
    grown = inside.distances_mm(smoothed.points_mm + 0.2 * smoothed.normals)
    assert (grown > inside.distances_mm(smoothed.points_mm)).mean() > 0.95
