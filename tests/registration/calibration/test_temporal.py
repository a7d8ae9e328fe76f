"""Lags put into known motions, and the water tank of PLUS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.calibration.line_detection import LineDetector
from registration.calibration.temporal import TemporalCalibration, principal_motion_mm
from registration.errors import InputError
from registration.readers.plus.fields import frame_times_s, read_sequence
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.results import read_line_rows_px

POSE_TIMES_S = np.arange(100.0, 120.0, 0.0171)
IMAGE_TIMES_S = np.arange(100.5, 119.0, 0.083)


def motion(times_s: np.ndarray) -> np.ndarray:
    """Up and down, never twice the same."""
    return 12 * np.sin(2.1 * times_s) + 5 * np.sin(3.7 * times_s + 1) + 0.4 * (times_s - 110)


@pytest.mark.parametrize("lag_s", [0.0, 0.0648, -0.0648, 0.31])
@pytest.mark.parametrize("scale", [2.5, -0.7])
def test_known_lag_is_found_whatever_unit_and_sign(lag_s: float, scale: float) -> None:
    # A pose stamped t was taken at t - lag.
    result = TemporalCalibration()(
        IMAGE_TIMES_S, 300 + scale * motion(IMAGE_TIMES_S), POSE_TIMES_S, motion(POSE_TIMES_S - lag_s)
    )
    assert result.tracker_lag_s == pytest.approx(lag_s, abs=3e-4)
    assert result.offset_s == -result.tracker_lag_s
    assert result.correlation == pytest.approx(np.sign(scale), abs=2e-3)


def test_lag_is_found_between_the_steps_of_the_search() -> None:
    result = TemporalCalibration(step_s=0.02)(
        IMAGE_TIMES_S, motion(IMAGE_TIMES_S), POSE_TIMES_S, motion(POSE_TIMES_S - 0.057)
    )
    assert result.tracker_lag_s == pytest.approx(0.057, abs=2e-3)


def test_frames_without_a_signal_and_noise_do_not_matter() -> None:
    signal = motion(IMAGE_TIMES_S) + np.random.default_rng(0).normal(0, 1.0, IMAGE_TIMES_S.shape)
    signal[::7] = np.nan
    result = TemporalCalibration()(IMAGE_TIMES_S, signal, POSE_TIMES_S, motion(POSE_TIMES_S - 0.12))
    assert result.tracker_lag_s == pytest.approx(0.12, abs=5e-3)
    assert not result.frames_used[::7].any()


def test_of_equal_peaks_the_smallest_lag_is_taken() -> None:
    # Period 0.4 s: lags of 0.06 and -0.34 s fit equally, and those of half a period with the sign turned.
    signal, poses = np.sin(np.pi * 5 * IMAGE_TIMES_S), np.sin(np.pi * 5 * (POSE_TIMES_S - 0.06))
    result = TemporalCalibration()(IMAGE_TIMES_S, signal, POSE_TIMES_S, poses)
    assert result.tracker_lag_s == pytest.approx(0.06, abs=2e-3)
    assert abs(result.runner_up_correlation) == pytest.approx(abs(result.correlation), abs=0.02)


def test_principal_motion_is_along_the_line_of_motion() -> None:
    along = np.array([2.0, -1.0, 2.0]) / 3
    positions = np.array([500.0, -20.0, 3.0]) + np.linspace(-9, 11, 30)[:, None] * along
    assert np.ptp(principal_motion_mm(positions)) == pytest.approx(20.0)
    with pytest.raises(InputError, match="expected positions that move"):
        principal_motion_mm(np.ones((5, 3)))


@pytest.mark.parametrize(
    ("signal", "poses", "message"),
    [
        (np.full(IMAGE_TIMES_S.shape, np.nan), motion(POSE_TIMES_S), "at least 20 frames with a signal"),
        (
            np.full(IMAGE_TIMES_S.shape, 7.0),
            motion(POSE_TIMES_S),
            "image_signal: expected a signal that moves",
        ),
        (
            motion(IMAGE_TIMES_S),
            np.full(POSE_TIMES_S.shape, 7.0),
            "pose_signal: expected a signal that moves",
        ),
        (np.cos(40 * IMAGE_TIMES_S), motion(POSE_TIMES_S), "expected a correlation of at least 0.8"),
        (IMAGE_TIMES_S, POSE_TIMES_S, "expected a motion that tells one lag from another"),
        (motion(IMAGE_TIMES_S), motion(POSE_TIMES_S - 0.55), "at the end of the search"),
    ],
)
def test_signals_without_a_lag_are_refused(signal: np.ndarray, poses: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        TemporalCalibration()(IMAGE_TIMES_S, signal, POSE_TIMES_S, poses)


@pytest.mark.parametrize(
    "settings",
    [{"max_lag_s": 0.0}, {"step_s": 0.3}, {"tie": 0.0}, {"min_correlation": 1.5}, {"min_frames": 2}],
)
def test_settings_are_checked(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        TemporalCalibration(**settings)  # type: ignore[arg-type]


def test_water_tank_of_plus(real_data: Path) -> None:
    plus = real_data / "plus"
    video = read_sequence(plus / "WaterTankBottomTranslationVideoBuffer.igs.mha")
    image_times_s = frame_times_s(video, "filtered", "video")
    tracker = PlusReader()(plus / "WaterTankBottomTranslationTrackerBuffer.igs.mha")
    near = (tracker.pose_times_s > image_times_s[0] - 1) & (tracker.pose_times_s < image_times_s[-1] + 1)
    poses = principal_motion_mm(tracker.world_T_ee[near, :3, 3])
    rows = LineDetector()(video.pixels)
    baseline = read_line_rows_px(plus / "LineSegmentationResultsBaseline.xml", (820 - 1) / 2)
    assert np.isfinite(rows).mean() > 0.9
    assert np.nanmedian(np.abs(rows - baseline)) < 1.0
    for signal in (rows, baseline):
        result = TemporalCalibration()(image_times_s, signal, tracker.pose_times_s[near], poses)
        assert result.tracker_lag_s == pytest.approx(-0.0648, abs=0.005)
