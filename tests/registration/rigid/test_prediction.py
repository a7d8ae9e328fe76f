"""The verdict on a sweep whose tissue has moved, and on one of the mirror image, by the whole of the method."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.result import RigidResult, predicted_sentence

TUBE = bent_tube()
FIXED_MM = TUBE.sample(3000, np.random.default_rng(1))
AWAY = transforms.rotate_about(Rotation.from_rotvec([0.9, -0.5, 1.2]), np.zeros(3))


def pushed(points: np.ndarray, push_mm: float) -> np.ndarray:
    """Points pushed aside most in the middle of the tube."""
    near = np.exp(-0.5 * ((points - TUBE.vertices_mm.mean(axis=0)) ** 2).sum(axis=1) / 15.0**2)
    return points + push_mm * near[:, None] * [0.6, 0.8, 0.0]


def registered(push_mm: float, mirror: bool = False, **settings: object) -> RigidResult:
    rng = np.random.default_rng(2)
    points = pushed(TUBE.sample(2000, rng), push_mm) + 0.1 * rng.standard_normal((2000, 3))
    if mirror:
        points = points * [-1.0, 1.0, 1.0]
    return MultiStartICP(**settings)(transforms.apply(AWAY, points), FIXED_MM)


def test_moved_tissue_is_in_the_predicted_error_and_in_the_sentences() -> None:
    found = registered(2.0)
    assert found.deformation is not None
    assert found.deformation.detected
    low_mm, high_mm = found.tre_interval_mm(TUBE.vertices_mm)
    shown = transforms.apply(transforms.compose(found.fixed_T_moving, AWAY), pushed(TUBE.vertices_mm, 2.0))
    assert low_mm < np.sqrt(((shown - TUBE.vertices_mm) ** 2).sum(axis=1).mean()) < high_mm
    assert "with a tissue motion of about" in found.reason
    sentence = predicted_sentence(low_mm, high_mm, found.deformation)
    assert "(90 %), tissue motion of about" in sentence
    assert sentence.endswith("detected.")
    np.testing.assert_array_equal(found.candidates[0].fixed_T_moving, found.fixed_T_moving)


def test_still_tissue_is_registered_as_without_the_model() -> None:
    found, plain = registered(0.0), registered(0.0, residual_model=None)
    assert found.deformation is not None
    assert not found.deformation.detected
    np.testing.assert_array_equal(found.fixed_T_moving, plain.fixed_T_moving)
    assert found.tre_interval_mm(TUBE.vertices_mm) == plain.tre_interval_mm(TUBE.vertices_mm)
    assert found.verdict == "accepted"
    assert found.probability_right_vessel > 0.95
    assert plain.deformation is None
    assert np.isnan(plain.probability_right_vessel)
    assert "no tissue motion detected" in predicted_sentence(0.1, 0.2, found.deformation)
    assert "is not included" in predicted_sentence(0.1, 0.2, None)


def test_the_mirror_image_is_not_accepted() -> None:
    found = registered(0.0, mirror=True)
    assert found.verdict != "accepted"
    assert found.probability_right_vessel < 0.5


def test_a_cloud_that_is_no_surface_keeps_the_pose_that_fits_it_exactly() -> None:
    moving_mm = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [40.0, 12.0, 5.0]
    fixed_mm = moving_mm @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [5.0, -3.0, 2.0]
    found = MultiStartICP()(moving_mm, fixed_mm)
    np.testing.assert_allclose(found.fixed_T_moving[:3, 3], [5.0, -3.0, 2.0], atol=1e-6)
    assert found.rmse_mm < 1e-6 and found.verdict == "ambiguous"
