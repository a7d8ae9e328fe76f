"""Poses drawn as they are described: by bins, about the vessel's axis, across it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from registration.errors import InputError
from registration.perturbation.random_pose import PerturbedPose, PoseRange

AXIS = np.array([0.6, 0.0, 0.8])


def poses(drawn_from: PoseRange, count: int) -> list[PerturbedPose]:
    return [drawn_from.draw(AXIS, number, np.random.default_rng((1, number))) for number in range(count)]


def test_bins_are_gone_through_in_turn_and_filled_evenly() -> None:
    drawn = poses(PoseRange(180.0, 10.0, angle_bin_deg=15.0), 12 * 40)
    angles = np.array([pose.angle_deg for pose in drawn])
    assert (np.floor(angles / 15).reshape(-1, 12) == np.arange(12)).all()
    assert kstest(angles % 15, "uniform", (0, 15)).pvalue > 0.01
    assert kstest(angles, "uniform", (0, 180)).pvalue > 0.01


def test_without_bins_there_is_one_and_a_flip_has_one_angle() -> None:
    assert PoseRange(180.0, 10.0).bins == 1
    assert PoseRange(90.0, 10.0, angle_bin_deg=15.0).bins == 6
    assert PoseRange(180.0, 10.0, rotation="flip", angle_bin_deg=15.0).bins == 1


def test_a_roll_is_about_the_axis() -> None:
    for pose in poses(PoseRange(180.0, 0.0, rotation="roll", angle_bin_deg=45.0), 8):
        np.testing.assert_allclose(np.cross(pose.rotation.as_rotvec(), AXIS), 0, atol=1e-9)
        assert pose.rotation.as_rotvec() @ AXIS > 0


def test_a_flip_is_half_a_turn_across_the_axis_in_any_direction() -> None:
    drawn = poses(PoseRange(180.0, 0.0, rotation="flip"), 300)
    np.testing.assert_allclose(
        [pose.rotation.apply(AXIS) for pose in drawn], np.tile(-AXIS, (300, 1)), atol=1e-9
    )
    across = np.array([pose.rotation.as_rotvec() for pose in drawn])
    around = np.arctan2(across @ [0.0, 1, 0], across @ np.cross(AXIS, [0.0, 1, 0]))
    # A turn by 180 degrees has its axis but for the sign.
    assert kstest(around % np.pi, "uniform", (0, np.pi)).pvalue > 0.01


def test_translations_are_as_long_as_asked_for() -> None:
    lengths = [pose.translation_mm for pose in poses(PoseRange(0.0, 50.0, 50.0), 20)]
    np.testing.assert_allclose(lengths, 50)
    some = [pose.translation_mm for pose in poses(PoseRange(0.0, 30.0, 10.0), 300)]
    assert kstest(some, "uniform", (10, 20)).pvalue > 0.01


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"angle_max_deg": 181.0}, "angle_max_deg: expected at most 180"),
        ({"translation_min_mm": 11.0}, "translation_min_mm: expected at most the longest, 10, received 11"),
        ({"rotation": "spin"}, "rotation: expected one of any, roll, flip, received 'spin'"),
        ({"angle_bin_deg": 25.0}, "angle_bin_deg: expected a whole part of 180, received 25"),
        ({"angle_bin_deg": 0.0}, "angle_bin_deg: expected a number above 0"),
        ({"angle_max_deg": 10.0, "angle_bin_deg": 15.0}, "angle_bin_deg: expected a whole part of 10"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PoseRange(**({"angle_max_deg": 180.0, "translation_max_mm": 10.0} | settings))  # type: ignore[arg-type]


def test_a_negative_trial_is_refused() -> None:
    with pytest.raises(InputError, match="trial: expected a whole number of at least 0"):
        PoseRange(180.0, 10.0).draw(AXIS, -1, np.random.default_rng(0))
