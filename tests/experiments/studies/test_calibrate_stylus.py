"""The study finds a known tip and writes it down."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sweeps import CALIBRATION

from experiments.outcome import Silent
from experiments.studies import calibrate_stylus
from registration import transforms
from registration.calibration.stylus import PivotCalibration
from registration.sweep import TrackedSweep

TIP_MM, PIVOT_MM = np.array([210.0, -2.0, 5.0]), np.array([30.0, 400.0, -60.0])


def test_known_tip(tmp_path: Path) -> None:
    turns = Rotation.from_rotvec(np.deg2rad(np.random.default_rng(0).uniform(-30, 30, (80, 3))))
    poses = transforms.from_rotation(turns, PIVOT_MM - turns.apply(TIP_MM))
    poses[7, :3, 3] += 40.0
    sweep = TrackedSweep(np.zeros((0, 0, 0), np.uint8), np.zeros(0), poses, np.arange(80) / 20, CALIBRATION)
    (tmp_path / "recording").mkdir()
    outcome = calibrate_stylus.run(
        sweep=str(tmp_path / "recording"),
        acquisition=lambda path: sweep,
        pivot=PivotCalibration(),
        workspace=tmp_path,
        progress=Silent(),
    )
    written = json.loads((tmp_path / "stylus_calibration.json").read_text())
    np.testing.assert_allclose(written["tip_mm"], TIP_MM, atol=1e-6)
    np.testing.assert_allclose(written["pivot_mm"], PIVOT_MM, atol=1e-6)
    assert outcome.metrics["outliers"] == 1.0
    assert outcome.metrics["tip_length_mm"] == pytest.approx(float(np.linalg.norm(TIP_MM)))
