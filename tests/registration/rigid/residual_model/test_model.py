"""A sweep whose tissue has moved, one whose has not, and one of another vessel: what the model says of each."""

from __future__ import annotations

import numpy as np
import pytest
from symmetric_shapes import twisted_fork
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.rigid_fit import kabsch
from registration.rigid.residual_model.compact_blocks import blocks_of
from registration.rigid.residual_model.deformation import predicted_tre_mm
from registration.rigid.residual_model.mirror_image import mirrored_misfit_mm
from registration.rigid.residual_model.model import Assessed, ResidualModel
from registration.rigid.residual_model.right_vessel import probability_right_vessel
from registration.rigid.smoothed_target import outward_targets

TUBE = bent_tube()
TARGET = outward_targets(TUBE.sample(4000, np.random.default_rng(1)), 20, 40)[1]
PLACES_MM = TUBE.vertices_mm[::9]
MODEL = ResidualModel()


def pushed(points: np.ndarray, bend_mm: float) -> np.ndarray:
    """Points of the tube, pushed aside most in its middle."""
    middle = TUBE.vertices_mm.mean(axis=0)
    near = np.exp(-0.5 * ((points - middle) ** 2).sum(axis=1) / 15.0**2)
    return points + bend_mm * near[:, None] * [0.6, 0.8, 0.0]


def swept(bend_mm: float, noise_mm: float = 0.1) -> np.ndarray:
    rng = np.random.default_rng(5)
    return pushed(TUBE.sample(3000, rng), bend_mm) + noise_mm * rng.standard_normal((3000, 3))


def assessed(points: np.ndarray, model: ResidualModel = MODEL) -> Assessed:
    found = model(points, TARGET, np.eye(4), PLACES_MM, offset=True)
    assert found is not None
    return found


def test_tissue_that_has_not_moved_is_not_said_to_have() -> None:
    found = assessed(swept(0.0))
    assert not found.deformation.detected
    assert found.deformation.size_mm < 0.1
    np.testing.assert_array_equal(found.fixed_T_moving, np.eye(4))
    assert found.probability_right_vessel > 0.95


def test_tissue_that_has_moved_is_found_and_its_size_in_millimetres() -> None:
    found = assessed(swept(2.0))
    assert found.deformation.detected
    assert found.deformation.gain > 20
    bent = pushed(TUBE.vertices_mm, 2.0)
    left_mm = transforms.apply(kabsch(bent, TUBE.vertices_mm), bent) - TUBE.vertices_mm
    size_mm = np.sqrt((left_mm**2).sum(axis=1).mean())
    assert found.deformation.size_mm == pytest.approx(size_mm, rel=0.4)
    low_mm, high_mm = np.quantile(
        predicted_tre_mm(PLACES_MM, np.eye(4)[None], found.deformation), [0.05, 0.95]
    )
    shown_mm = transforms.apply(found.fixed_T_moving, pushed(PLACES_MM, 2.0)) - PLACES_MM
    assert low_mm < np.sqrt((shown_mm**2).sum(axis=1).mean()) < high_mm


def test_a_pose_that_is_not_allowed_is_not_taken() -> None:
    points = swept(2.0)
    assert not np.array_equal(assessed(points).fixed_T_moving, np.eye(4))
    held = MODEL(points, TARGET, np.eye(4), PLACES_MM, offset=True, allowed=lambda pose: False)
    assert held is not None
    np.testing.assert_array_equal(held.fixed_T_moving, np.eye(4))
    kept = assessed(points, ResidualModel(correct_pose=False))
    np.testing.assert_array_equal(kept.fixed_T_moving, np.eye(4))


def test_an_expected_motion_that_does_not_show_widens_the_prediction() -> None:
    points, still = swept(0.0), np.eye(4)[None]
    plain = assessed(points).deformation
    wary = assessed(points, ResidualModel(expected_deformation_mm=2.0)).deformation
    assert wary.is_predicted and not plain.is_predicted
    assert predicted_tre_mm(PLACES_MM, still, plain).max() == 0
    assert np.median(predicted_tre_mm(PLACES_MM, still, wary)) > 0.1


def test_a_mirror_image_fits_worse_than_a_vessel_that_has_none() -> None:
    rng = np.random.default_rng(3)
    target = outward_targets(twisted_fork(5000, rng), 20, 40)[1]
    points = twisted_fork(2000, rng)
    block = blocks_of(points, 128)
    own = MODEL(points, target, np.eye(4), target.points_mm[:100], offset=True)
    assert own is not None
    assert own.probability_right_vessel > 0.9
    mirrored_mm = mirrored_misfit_mm(points, target, np.eye(4), block=block, offset=True)
    assert mirrored_mm > 0.3
    # The other way round: what was swept is the mirror image, and its own mirror image fits.
    image = points * [-1.0, 1.0, 1.0]
    assert mirrored_misfit_mm(image, target, np.eye(4), block=block, offset=True) < 0.15
    wrong = MODEL(image, target, np.eye(4), target.points_mm[:100], offset=True)
    assert wrong is not None
    assert wrong.probability_right_vessel < 0.5


def test_the_probability_falls_with_the_misfit_and_rises_with_that_of_the_mirror_image() -> None:
    assert probability_right_vessel(0.06, 0.6, 0.0) > 0.99
    assert probability_right_vessel(0.06, 0.04, 0.0) < probability_right_vessel(0.06, 0.08, 0.0)
    assert probability_right_vessel(1.2, 1.2, 0.1) < 0.1
    larger = probability_right_vessel(0.8, 1.6, 0.0, expected_mm=6.0)
    assert larger > probability_right_vessel(0.8, 1.6, 0.0)


def test_clouds_too_small_are_not_judged() -> None:
    assert MODEL(swept(0.0)[:60], TARGET, np.eye(4), PLACES_MM, offset=True) is None


@pytest.mark.parametrize(
    "settings", [{"patches": 4}, {"lengths_mm": []}, {"min_gain": 0.0}, {"expected_deformation_mm": -1.0}]
)
def test_settings_out_of_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        ResidualModel(**settings)
