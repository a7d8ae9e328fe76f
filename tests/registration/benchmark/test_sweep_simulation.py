"""The sweep behind a case: rigid, its frames numbered as in the sweep, and shared by no other case."""

from __future__ import annotations

import numpy as np
import pytest

from registration.benchmark.scenarios import kind_named
from registration.benchmark.sweep_simulation import Swept, swept
from registration.metrics.surface_distance import SurfaceDistance


@pytest.fixture(scope="module")
def missing() -> Swept:
    return swept("random0003", 3, 7, kind_named("missing"), np.random.default_rng(0))


def test_tissue_does_not_deform_and_poses_are_noisy(missing: Swept) -> None:
    settings = missing.sweep.settings
    assert settings.deformation.bend_mm == settings.deformation.pressure_mm == 0
    assert settings.motion.noise_mm == 0.1
    assert settings.motion.noise_deg == 0.1
    np.testing.assert_allclose(
        missing.sweep.deformation.as_swept(missing.targets_mm), missing.targets_mm, atol=1e-9
    )


def test_lost_frames_have_no_points_and_leave_targets_uncovered(missing: Swept) -> None:
    assert len(missing.used) == 140
    assert set(np.unique(missing.cloud.frame_index)) <= set(missing.used.tolist())
    assert 0.75 < missing.covered.mean() < 0.98


def test_the_cloud_lies_where_the_anatomy_is(missing: Swept) -> None:
    assert np.median(SurfaceDistance(missing.sweep.anatomy)(missing.cloud_mm)) < 0.25
    assert not missing.symmetry


def test_a_symmetric_shape_keeps_its_own_frame() -> None:
    found = swept("cone", 5004, 0, kind_named("whole"), np.random.default_rng(0))
    assert found.symmetry.screws
    # The wide end of the cone lies at low z, in the sweep as in the shape.
    radius_mm = np.linalg.norm(found.cloud_mm[:, :2], axis=1)
    low, high = found.cloud_mm[:, 2] < -20, found.cloud_mm[:, 2] > 20
    assert np.median(radius_mm[low]) > 5
    assert np.median(radius_mm[high]) < 4
