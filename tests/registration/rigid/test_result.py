"""How a pose is measured on both clouds."""

from __future__ import annotations

import numpy as np
import pytest

from registration import transforms
from registration.errors import InputError
from registration.rigid.fit import fit
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.result import RigidResult

GRID = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)


def test_residuals_and_inliers_by_hand() -> None:
    """Ten points of a unit grid, lifted by 1 mm, two of them by 5 mm instead, brought down by 1 mm too little."""
    moving = GRID[:10] + np.array([0, 0, 2.0])
    moving[:2, 2] = 6.0
    found = fit(moving, TreeTarget(GRID), transforms.translation((0, 0, -1.0)), keep=0.8, inlier_spacings=3.0)
    assert found.rmse_mm == pytest.approx(np.sqrt((8 * 1 + 2 * 25) / 10))
    assert found.rmse_trimmed_mm == pytest.approx(1)
    assert found.inlier_share == pytest.approx(0.8)


def result(samples: np.ndarray | None, **change: object) -> RigidResult:
    return RigidResult(np.eye(4), 0.1, 0.1, 1.0, 5, True, (), 0.1, pose_samples=samples, **change)


def test_the_predicted_error_is_a_quantile_of_what_the_samples_do() -> None:
    samples = np.stack([transforms.translation((0.0, shift, 0.0)) for shift in np.linspace(0, 1, 101)])
    low, high = result(samples).tre_interval_mm(GRID, level=0.8)
    assert (low, high) == (pytest.approx(0.1), pytest.approx(0.9))
    turned = np.array([[-1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])[None]
    # Half a turn about z takes a point 3 and 4 mm away from it to 10 mm from where it was.
    assert result(turned).tre_interval_mm(np.array([[3.0, 4, 9]])) == (pytest.approx(10), pytest.approx(10))


def test_a_method_that_predicts_nothing_says_nothing() -> None:
    assert np.isnan(result(None).tre_interval_mm(GRID)).all()
    assert result(None).verdict == "not judged"


def test_targets_levels_and_verdicts_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="targets_mm: expected at least 1 points, received 0"):
        result(None).tre_interval_mm(np.empty((0, 3)))
    with pytest.raises(InputError, match="level: expected"):
        result(None).tre_interval_mm(GRID, level=1.5)
    with pytest.raises(
        InputError, match="verdict: expected one of accepted, ambiguous, failed, not judged, received 'good'"
    ):
        result(None, verdict="good")
