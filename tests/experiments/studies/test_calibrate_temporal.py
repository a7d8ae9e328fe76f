"""The study finds the lag of the water tank, writes it down, and its offset undoes it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sweeps import CALIBRATION, world_T_ee

from experiments.outcome import Silent
from experiments.studies import calibrate_temporal
from registration import transforms
from registration.calibration.line_detection import LineDetector
from registration.calibration.temporal import TemporalCalibration
from registration.readers.plus.reader import PlusReader
from registration.sweep import TrackedSweep


def test_water_tank_of_plus(real_data: Path, tmp_path: Path) -> None:
    plus = real_data / "plus"
    reader = PlusReader(
        tracker=str(plus / "WaterTankBottomTranslationTrackerBuffer.igs.mha"), uncalibrated=True
    )
    outcome = calibrate_temporal.run(
        sweep=str(plus / "WaterTankBottomTranslationVideoBuffer.igs.mha"),
        acquisition=reader,
        line=LineDetector(),
        temporal=TemporalCalibration(),
        workspace=tmp_path,
        progress=Silent(),
    )
    assert outcome.metrics["tracker_lag_s"] == pytest.approx(-0.0648, abs=0.005)
    assert outcome.cases is not None
    before = (outcome.cases["row_px"] - outcome.cases["motion_uncorrected_px"])[outcome.cases["used"]]
    assert outcome.metrics["residual_rms_px"] < 0.8 * float(np.sqrt((before**2).mean()))
    assert set(outcome.figures) == {"signals", "correlation"}


def test_made_up_tank_and_its_offset(tmp_path: Path) -> None:
    pose_times_s, image_times_s = np.arange(0.0, 12.0, 0.02), np.arange(1.0, 11.0, 0.08)

    def height_mm(times_s: np.ndarray) -> np.ndarray:
        return 10 * np.sin(1.7 * times_s) + 4 * np.sin(4.1 * times_s)

    lag_s = 0.15
    up = world_T_ee(np.array([3.0]))[0, :3, 1]
    poses = np.tile(world_T_ee(np.array([3.0])), (len(pose_times_s), 1, 1))
    poses[:, :3, 3] += height_mm(pose_times_s - lag_s)[:, None] * up
    rows = np.arange(120)[None, :, None]
    line_px = 60 + 2 * height_mm(image_times_s)
    images = (250 * np.exp(-0.5 * ((rows - line_px[:, None, None]) / 2) ** 2)).astype(np.uint8)
    sweep = TrackedSweep(np.repeat(images, 50, axis=2), image_times_s, poses, pose_times_s, CALIBRATION)
    (tmp_path / "sweep").mkdir()
    outcome = calibrate_temporal.run(
        sweep=str(tmp_path / "sweep"),
        acquisition=lambda path: sweep,
        line=LineDetector(),
        temporal=TemporalCalibration(),
        workspace=tmp_path,
        progress=Silent(),
    )
    written = json.loads((tmp_path / "temporal_calibration.json").read_text())
    assert written["tracker_lag_s"] == pytest.approx(lag_s, abs=2e-3)
    corrected = transforms.interpolate(image_times_s, pose_times_s + written["offset_s"], poses)
    along_mm = (corrected[:, :3, 3] - corrected[:, :3, 3].mean(axis=0)) @ up
    expected_mm = height_mm(image_times_s) - height_mm(image_times_s).mean()
    np.testing.assert_allclose(along_mm, expected_mm, atol=0.15)
    assert abs(outcome.metrics["correlation"]) > 0.999
