"""The predicted spread held against what repeated draws of the same problem do."""

from __future__ import annotations

import numpy as np
import pytest
from symmetric_shapes import frustum

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.robust_kernels import Tukey
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.residual_model.compact_blocks import blocks_of
from registration.rigid.smoothed_target import SmoothedTarget, outward_targets
from registration.rigid.uncertainty import SPREAD_DOUBT, STIFFENING, bootstrap_motions, local_fit

GRID = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3)
SMOOTH = SmoothedTarget(TreeTarget(GRID, neighbours=9), 25)
NOISE_MM = 0.05


def plane(seed: int) -> np.ndarray:
    inner = GRID[(GRID[:, :2] > 3).all(axis=1) & (GRID[:, :2] < 26).all(axis=1)]
    return inner + NOISE_MM * np.random.default_rng(seed).standard_normal(inner.shape) * [0, 0, 1]


def spread(moving: np.ndarray) -> tuple[np.ndarray, float]:
    fit = local_fit(moving, SMOOTH, np.eye(4), blocks_of(moving, 64), Tukey())
    return bootstrap_motions(fit, 4000, 1.0, np.random.default_rng(0)), fit.roughness


def test_the_spread_of_a_noisy_plane_is_that_of_a_mean() -> None:
    """Lifting a plane of n points is known to noise / sqrt(n); the doubt about the spread adds its own variance."""
    moving = plane(0)
    motions, roughness = spread(moving)
    widened = (1 + STIFFENING * roughness**2) * np.exp(SPREAD_DOUBT**2)
    assert motions[:, 5].std() == pytest.approx(widened * NOISE_MM / np.sqrt(len(moving)), rel=0.25)
    assert roughness < 0.05


def test_motions_are_about_the_clouds_centre() -> None:
    moving = plane(0)
    fit = local_fit(moving, SMOOTH, np.eye(4), blocks_of(moving, 16), Tukey())
    np.testing.assert_allclose(fit.centre_mm, moving.mean(axis=0))
    motion = fit.motions(np.array([[0.0, 0, 0.5 * fit.radius_mm, 1, 2, 3]]))
    assert np.deg2rad(transforms.rotation_angle_deg(motion))[0] == pytest.approx(0.5)
    np.testing.assert_allclose(
        transforms.apply(motion[0], fit.centre_mm), fit.centre_mm + np.array([1.0, 2, 3])
    )


def test_a_plane_leaves_three_motions_open() -> None:
    fit = local_fit(plane(0), SMOOTH, np.eye(4), blocks_of(plane(0), 16), Tukey())
    stiffness = np.linalg.eigvalsh(fit.stiffness.sum(axis=0))
    assert stiffness[2] < 1e-3 * stiffness[3]


def test_frames_that_err_together_spread_more_than_points_that_err_alone() -> None:
    """The same size of error, shared by a row of the grid: there are fewer independent rows than points."""
    moving = plane(0)
    row = moving[:, 0].astype(np.int64)
    shared = GRID[(GRID[:, :2] > 3).all(axis=1) & (GRID[:, :2] < 26).all(axis=1)].copy()
    shared[:, 2] = NOISE_MM * np.random.default_rng(3).standard_normal(40)[row]
    _, block = np.unique(row, return_inverse=True)
    sizes = [
        bootstrap_motions(
            local_fit(cloud, SMOOTH, np.eye(4), block.astype(np.int64), Tukey()),
            2000,
            1.0,
            np.random.default_rng(0),
        )[:, 5].std()
        for cloud in (moving, shared)
    ]
    assert sizes[1] > 2.5 * sizes[0]


def test_an_offset_that_is_unknown_leaves_the_slide_along_a_taper_less_sure() -> None:
    """A cone 0.1 mm wider is the same cone 1 mm further: sin of its half angle is 0.1."""
    rng = np.random.default_rng(5)
    _, smooth = outward_targets(frustum(5000, rng), 20, 40)
    moving = frustum(1500, rng) + rng.normal(scale=0.2, size=(1500, 3))
    block = blocks_of(moving, 32)
    sure, unsure = (
        bootstrap_motions(
            local_fit(moving, smooth, np.eye(4), block, Tukey(), offset), 1000, 1.0, np.random.default_rng(0)
        )
        for offset in (False, True)
    )
    assert unsure.shape == (1000, 6)
    assert unsure[:, 5].std() > 3 * sure[:, 5].std()


@pytest.mark.parametrize("count", [4, 5])
def test_a_handful_of_points_has_a_result(count: int) -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        moving_mm, fixed_mm = rng.normal(size=(count, 3)) * 10, rng.normal(size=(60, 3)) * [20, 6, 5]
        assert MultiStartICP()(moving_mm, fixed_mm).verdict != "accepted"
