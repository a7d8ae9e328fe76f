"""A symmetric vessel has more than one right pose: motions, and the nearest right pose, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from registration import transforms
from registration.benchmark.symmetry import Screw, Symmetry, half_turn
from registration.errors import InputError
from registration.metrics.surface_distance import pose_error

ALONG = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)
LINE = np.outer(np.linspace(-30, 30, 61), ALONG)
SLIDE = Screw(ORIGIN, ALONG, 0.0, 1.0, -10.0, 10.0)
ROLL = Screw(np.array([5.0, 0.0, 0.0]), ALONG, 360.0, 0.0, 0.0, 1.0)


def test_a_screw_turns_about_its_line_and_shifts_along_it() -> None:
    screw = Screw(np.array([1.0, 0.0, 0.0]), ALONG, 90.0, 3.0, 0.0, 2.0)
    motions = screw(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(motions[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(transforms.apply(motions[1], np.array([2.0, 0.0, 0.0])), [1, 1, 3], atol=1e-12)
    np.testing.assert_allclose(transforms.apply(motions[2], np.array([2.0, 0.0, 0.0])), [0, 0, 6], atol=1e-12)


def test_half_a_turn_is_its_own_inverse() -> None:
    flip = half_turn(np.array([0.0, 0.0, 4.0]), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(transforms.apply(flip, np.array([7.0, 2.0, 5.0])), [7, -2, 3], atol=1e-12)
    np.testing.assert_allclose(flip @ flip, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("slide_mm, left_mm", [(6.0, 0.0), (10.0, 0.0), (14.0, 4.0), (-13.0, 3.0)])
def test_a_slide_is_free_as_far_as_it_may_go(slide_mm: float, left_mm: float) -> None:
    symmetry = Symmetry((SLIDE,))
    estimate = transforms.translation((0.0, 0.0, slide_mm))
    nearest = symmetry.nearest(estimate, np.eye(4), LINE)
    assert pose_error(estimate, nearest, LINE).tre_mm == pytest.approx(left_mm, abs=1e-5)


def test_what_lies_across_the_symmetry_stays_an_error() -> None:
    estimate = transforms.translation((3.0, 0.0, 5.0))
    nearest = Symmetry((SLIDE,)).nearest(estimate, np.eye(4), LINE)
    assert pose_error(estimate, nearest, LINE).tre_mm == pytest.approx(3.0, abs=1e-5)


def test_roll_slide_and_flip_together_and_a_truth_that_is_not_the_identity() -> None:
    targets = LINE + np.array([2.0, 0.0, 0.0])
    truth = transforms.compose(
        transforms.translation((4.0, -7.0, 1.0)), half_turn(ORIGIN, np.array([0.0, 1.0, 0.0]))
    )
    flip = half_turn(np.array([5.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    symmetry = Symmetry((ROLL, SLIDE), (flip,))
    moved = transforms.compose(flip, SLIDE(np.array([-7.3]))[0], ROLL(np.array([0.41]))[0], truth)
    assert pose_error(moved, truth, targets).tre_mm > 10
    nearest = symmetry.nearest(moved, truth, targets)
    assert pose_error(moved, nearest, targets).tre_mm < 1e-4
    # Without the flip the same pose is wrong.
    nearest = Symmetry((ROLL, SLIDE)).nearest(moved, truth, targets)
    assert pose_error(moved, nearest, targets).tre_mm > 10


def test_no_symmetry_leaves_the_truth_alone() -> None:
    assert not Symmetry()
    assert Symmetry((SLIDE,))
    truth = transforms.translation((1.0, 2.0, 3.0))
    np.testing.assert_allclose(Symmetry().nearest(np.eye(4), truth, LINE), truth, atol=1e-12)


def test_bad_screws_are_refused() -> None:
    with pytest.raises(InputError, match="direction: expected a unit vector"):
        Screw(ORIGIN, 2 * ALONG, 0.0, 1.0, 0.0, 1.0)
    with pytest.raises(InputError, match="high: expected a number of at least 1"):
        Screw(ORIGIN, ALONG, 0.0, 1.0, 1.0, 0.0)
