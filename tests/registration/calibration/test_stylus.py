"""Pivoting about a known tip."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.calibration.stylus import PivotCalibration
from registration.errors import InputError

TIP_MM, PIVOT_MM = np.array([210.019, -0.17, 0.046]), np.array([40.0, -300.0, 25.0])


def pivoting(count: int, spread_deg: float = 30.0, noise_mm: float = 0.0, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("y", 90, degrees=True) * Rotation.from_rotvec(
        np.deg2rad(rng.uniform(-spread_deg, spread_deg, (count, 3)))
    )
    return transforms.from_rotation(turn, PIVOT_MM - turn.apply(TIP_MM) + rng.normal(0, noise_mm, (count, 3)))


def test_exact_poses_give_the_exact_tip() -> None:
    result = PivotCalibration()(pivoting(40))
    np.testing.assert_allclose(result.tip_mm, TIP_MM, atol=1e-9)
    np.testing.assert_allclose(result.pivot_mm, PIVOT_MM, atol=1e-9)
    assert np.linalg.norm(result.tip_mm) == pytest.approx(210.019, abs=1e-3)


def test_noise_and_slips_of_the_tip() -> None:
    poses = pivoting(400, noise_mm=0.5)
    poses[[3, 77, 200], :3, 3] += [25.0, 0.0, -10.0]
    result = PivotCalibration()(poses)
    assert np.flatnonzero(result.outliers)[[0]].tolist() == [3]
    assert result.outliers[[3, 77, 200]].all()
    assert np.linalg.norm(result.tip_mm - TIP_MM) < 4 * result.weakest_mm < 1.0
    assert result.rmse_mm == pytest.approx(0.5 * np.sqrt(3), rel=0.1)


def test_standard_error_says_how_far_off_the_tip_is() -> None:
    misses = [
        np.linalg.norm(PivotCalibration()(pivoting(60, noise_mm=0.5, seed=s)).tip_mm - TIP_MM)
        for s in range(40)
    ]
    said = PivotCalibration()(pivoting(60, noise_mm=0.5)).weakest_mm
    assert 0.7 * said < np.sqrt(np.mean(np.square(misses))) < np.sqrt(3) * 1.3 * said


def test_too_little_turning_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"turning over at least 15 degrees about two axes, received .* and "
    ):
        PivotCalibration()(pivoting(50, spread_deg=4.0))
    about_one = transforms.from_rotation(
        Rotation.from_euler("z", np.linspace(-60, 60, 30)[:, None], degrees=True), np.zeros((30, 3))
    )
    with pytest.raises(InputError, match=r"received 120\.0 and 0\.0"):
        PivotCalibration()(about_one)


def test_too_few_poses_and_left_handed_ones_are_refused() -> None:
    with pytest.raises(InputError, match="at least 10 poses, received 9"):
        PivotCalibration()(pivoting(9))
    mirrored = pivoting(20)
    mirrored[4, :3, 0] *= -1
    with pytest.raises(InputError, match="reference_T_stylus: expected a right-handed rotation"):
        PivotCalibration()(mirrored)


@pytest.mark.parametrize("settings", [{"outlier_sigma": 0.0}, {"min_rotation_deg": 0.0}, {"min_poses": 2}])
def test_settings_are_checked(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        PivotCalibration(**settings)  # type: ignore[arg-type]
