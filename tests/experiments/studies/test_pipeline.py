"""The pipeline study with a network that makes no mistakes: what is left is the geometry's own error."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies import pipeline
from models.predictor import Predictor
from registration import frames
from registration.contours import ContourExtractor
from registration.geometry_io import read_surface
from registration.metrics import SurfaceDistance
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.rigid import MultiStartICP

RIGID_PHANTOM = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=30, noise_mm=0.0, noise_deg=0.0),
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A predictor that answers with the exact masks of the sweep that was simulated last."""
    last: dict[str, Any] = {}
    simulate = pipeline.simulate_sweep

    def remembered(settings: PhantomSettings, sweep: int) -> Any:
        last["truth"] = simulate(settings, sweep)
        return last["truth"]

    def probability(images: np.ndarray) -> np.ndarray:
        assert images.shape == last["truth"].masks.shape
        return last["truth"].masks.astype(np.float32) * last.get("confidence", 1.0)

    monkeypatch.setattr(pipeline, "simulate_sweep", remembered)
    monkeypatch.setattr(
        Predictor, "load", lambda path: SimpleNamespace(probability=probability, threshold=0.5)
    )
    return last


def run(workspace: Path, **changes: Any) -> Any:
    workspace.mkdir(exist_ok=True)
    settings: dict[str, Any] = {
        "phantom": RIGID_PHANTOM, "contours": ContourExtractor(), "rigid": {"multistart": MultiStartICP()},
        "model_path": "model.pt", "sweep_index": 3, "max_gap_s": 0.1, "voxel_mm": 0.5, "fixed_points": 5000,
        "inlier_mm": 1.0, "keep": 0.9, "seed": 0, "workspace": workspace, "progress": Silent(),
    }  # fmt: skip
    return pipeline.run(**{**settings, **changes})


def test_exact_masks_and_poses_bring_the_cloud_home(oracle: dict[str, Any], tmp_path: Path) -> None:
    outcome = run(tmp_path)

    assert outcome.metrics["dsc_mean"] == 1.0
    assert outcome.metrics["tre_mm"] < 0.5
    assert outcome.metrics["rmse_mm"] < 0.5
    assert outcome.metrics["frames_dropped"] == 0
    assert outcome.cases is not None
    assert outcome.cases["simulated"].all()
    # The files hold the same answer: the cloud, moved by the truth, lies on the model; moved.ply is the cloud moved.
    truth = np.array(json.loads((tmp_path / "truth.json").read_text())["fixed_T_moving"])
    found = np.array(json.loads((tmp_path / "registration.json").read_text())["fixed_T_moving"])
    cloud_mm = np.asarray(read_surface(tmp_path / "cloud.ply"))
    distances_mm = SurfaceDistance(read_surface(tmp_path / "model.ply"))(frames.apply(truth, cloud_mm))
    assert np.sqrt((distances_mm**2).mean()) < 0.5
    moved_mm = np.asarray(read_surface(tmp_path / "moved.ply"))
    np.testing.assert_allclose(moved_mm, frames.apply(found, cloud_mm), atol=1e-3)


def test_a_lag_of_the_images_is_felt(oracle: dict[str, Any], tmp_path: Path) -> None:
    late = PhantomSettings(
        subset="artery",
        scanner=RIGID_PHANTOM.scanner,
        motion=Motion(frames=30, noise_mm=0.0, noise_deg=0.0, latency_s=0.1),
        deformation=RIGID_PHANTOM.deformation,
    )
    still, lagging = run(tmp_path / "a"), run(tmp_path / "b", phantom=late)
    # 60 mm in 10 s: 0.1 s too late puts the whole cloud 0.6 mm along the vessel, more or less where the path bends.
    assert still.metrics["tre_mm"] < 0.1
    assert lagging.metrics["tre_mm"] == pytest.approx(0.6, abs=0.25)


def test_a_network_that_finds_nothing_is_refused(oracle: dict[str, Any], tmp_path: Path) -> None:
    oracle["confidence"] = 0.0
    with pytest.raises(InputError, match="expected a network that finds the vessel"):
        run(tmp_path)


def test_the_cloud_is_thinned_to_one_point_a_voxel(oracle: dict[str, Any], tmp_path: Path) -> None:
    fine, coarse = run(tmp_path / "a", voxel_mm=0.4), run(tmp_path / "b", voxel_mm=2.0)
    assert coarse.metrics["points"] < 0.4 * fine.metrics["points"]
    with pytest.raises(InputError, match="voxel_mm: expected a positive number"):
        run(tmp_path / "c", voxel_mm=0.0)
