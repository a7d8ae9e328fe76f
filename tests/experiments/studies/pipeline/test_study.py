"""The pipeline study with a network that makes no mistakes: what is left is the geometry's own error."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from slicer_scenes import read_scene

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies.pipeline import study as pipeline
from models.predictor import Predictor
from registration import transforms
from registration.centerline.extractor import CenterlineExtractor
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Mesh
from registration.io.surfaces import read_centerline, read_surface
from registration.metrics.surface_distance import SurfaceDistance
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces
from registration.rigid.multi_start import MultiStartICP

RIGID_PHANTOM = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=30, noise_mm=0.0, noise_deg=0.0),
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)


def no_surface(cloud: object) -> Mesh:
    """In the place of a reconstruction: also what tests pass that look at neither surface nor centerline."""
    raise RegistrationInputError("cloud: expected points that a surface fits, received 12")


def replaced(patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Put a predictor in place that returns the exact masks of the sweep that was simulated last."""
    last: dict[str, Any] = {}
    simulate = pipeline.simulate_sweep

    def remembered(settings: PhantomSettings, sweep: int) -> Any:
        # The oracle looks at no picture, and pictures take far longer than all else.
        last["truth"] = simulate(settings, sweep, pictures=False)
        return last["truth"]

    def soft_masks(images: np.ndarray, spacing_mm: tuple[float, float]) -> np.ndarray:
        assert spacing_mm == last["truth"].sweep.calibration.spacing_mm
        assert images.shape == last["truth"].masks.shape
        return last["truth"].masks.astype(np.float32) * last.get("confidence", 1.0)

    patch.setattr(pipeline, "simulate_sweep", remembered)
    patch.setattr(Predictor, "load", lambda path, engine: SimpleNamespace(soft_masks=soft_masks))
    return last


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the predictor knows of the sweep that was simulated last."""
    return replaced(monkeypatch)


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """One run with exact masks and poses, which several tests look at: its outcome, files and truth."""
    folder = tmp_path_factory.mktemp("exact")
    with pytest.MonkeyPatch.context() as patch:
        last = replaced(patch)
        return SimpleNamespace(outcome=run(folder), folder=folder, truth=last["truth"])


def run(workspace: Path, **changes: Any) -> Any:
    workspace.mkdir(exist_ok=True)
    settings: dict[str, Any] = {
        "phantom": RIGID_PHANTOM, "mask_outliers": MaskOutliers(), "pieces": VesselPieces(),
        "contours": ContourExtractor(), "filters": {"voxel": VoxelDownsampling(0.5)},
        "surface": PoissonSurface(cell_mm=0.9, bridge_mm=3.0), "smoothing": TaubinSmoothing(),
        "centerline": CenterlineExtractor(), "rigid": {"multistart": MultiStartICP()}, "deformable": {"none": None},
        "model_path": "model.pt", "sweep_index": 3, "max_gap_s": 0.1, "fixed_points": 5000, "slicer": "scene",
        "inlier_mm": 1.0, "keep": 0.9, "seed": 0, "workspace": workspace, "progress": Silent(),
    }  # fmt: skip
    return pipeline.run(**{**settings, **changes})


def test_exact_masks_and_poses_bring_the_cloud_home(exact: SimpleNamespace) -> None:
    outcome, folder = exact.outcome, exact.folder

    assert outcome.metrics["dsc_mean"] == 1.0
    assert outcome.metrics["tre_mm"] < 0.5
    assert outcome.metrics["rmse_mm"] < 0.5
    assert outcome.metrics["frames_dropped"] == 0
    assert outcome.cases is not None
    assert outcome.cases["simulated"].all()
    # The files hold the same result: the cloud, moved by the truth, lies on the model; moved.ply is the cloud moved.
    truth = np.array(json.loads((folder / "truth.json").read_text())["fixed_T_moving"])
    record = json.loads((folder / "registration.json").read_text())
    found = np.array(record["fixed_T_moving"])
    cloud_mm = np.asarray(read_surface(folder / "cloud.ply"))
    distances_mm = SurfaceDistance(read_surface(folder / "model.ply"))(transforms.apply(truth, cloud_mm))
    assert np.sqrt((distances_mm**2).mean()) < 0.5
    moved_mm = np.asarray(read_surface(folder / "moved.ply"))
    np.testing.assert_allclose(moved_mm, transforms.apply(found, cloud_mm), atol=1e-3)
    # 3D Slicer gets the model, the contours and the reconstruction, each where it was found to lie.
    shown, moves = read_scene(folder / "scene.mrml")
    assert {"fixed", "moving, as given", "moved", "reconstructed surface, moved"} <= set(shown)
    assert list(moves) == ["fixed_T_moving"]
    np.testing.assert_allclose(shown["moving, as given"].placed_mm, moved_mm, atol=1e-3)
    assert shown["moved"].vertices == len(moved_mm)
    surface_mm = shown["reconstructed surface, moved"].points_mm.astype(np.float64)
    assert SurfaceDistance(read_surface(folder / "model.ply"))(surface_mm).mean() < 0.5
    # The measured error stands beside the predicted one, in the file and in the terminal.
    assert record["measured_tre_mm"] == pytest.approx(outcome.metrics["tre_mm"])
    assert 0 < record["predicted_tre_mm"]["low"] < record["predicted_tre_mm"]["high"] < 2
    assert any(each.startswith("Predicted TRE") and "Measured: " in each for each in outcome.findings)


def test_a_lag_of_the_images_is_felt(oracle: dict[str, Any], exact: SimpleNamespace, tmp_path: Path) -> None:
    late = PhantomSettings(
        subset="artery",
        scanner=RIGID_PHANTOM.scanner,
        motion=Motion(frames=30, noise_mm=0.0, noise_deg=0.0, latency_s=0.1),
        deformation=RIGID_PHANTOM.deformation,
    )
    lagging = run(tmp_path, phantom=late, surface=no_surface)
    # 60 mm in 10 s: 0.1 s too late puts the whole cloud 0.6 mm along the vessel, more or less where the path bends.
    assert exact.outcome.metrics["tre_mm"] < 0.1
    assert lagging.metrics["tre_mm"] == pytest.approx(0.6, abs=0.25)


def test_a_network_that_finds_nothing_is_refused(oracle: dict[str, Any], tmp_path: Path) -> None:
    oracle["confidence"] = 0.0
    with pytest.raises(InputError, match="expected a network that finds the vessel"):
        run(tmp_path)


def test_surface_and_centerline_come_with_the_registration(exact: SimpleNamespace, tmp_path: Path) -> None:
    outcome, folder, truth = exact.outcome, exact.folder, exact.truth
    surface = read_surface(folder / "surface.ply")
    assert isinstance(surface, Mesh)
    placed_mm = transforms.apply(truth.ct_T_world, surface.vertices_mm)
    assert SurfaceDistance(truth.anatomy)(placed_mm).mean() < 0.15
    lines = read_centerline(folder / "centerline.vtp").lines
    known_mm = truth.centerline.even_points(500)
    found_mm = transforms.apply(truth.ct_T_world, np.concatenate([line.points_mm for line in lines]))
    apart_mm = np.linalg.norm(found_mm[:, None] - known_mm[None], axis=2).min(axis=1)
    assert np.median(apart_mm) < 0.4
    stages = [f"{stage}_s" for stage in ("contours", "filters", "surface", "smoothing", "centerline")]
    assert sum(outcome.metrics[stage] for stage in stages) <= outcome.metrics["reconstruction_s"]
    assert not any("There is no" in finding for finding in outcome.findings)
    # The page shows both in the frame of the CT, the verdict first.
    outcome.files["scene.html"](tmp_path / "scene.html")
    page = (tmp_path / "scene.html").read_text(encoding="utf-8")
    for name in (
        "model from CT",
        "contours, registered",
        "reconstructed surface, registered",
        "at the true pose",
    ):
        assert name in page
    assert page.index("ccepted") < page.index("RMSE to the model")


def test_points_without_a_surface_are_registered_all_the_same(oracle: dict[str, Any], tmp_path: Path) -> None:
    outcome = run(tmp_path, surface=no_surface)
    assert outcome.metrics["tre_mm"] < 0.5
    assert np.isnan(outcome.metrics["surface_s"])
    assert np.isnan(outcome.metrics["centerline_s"])
    assert "There is no surface: cloud: expected points that a surface fits, received 12." in outcome.findings
    assert not (tmp_path / "surface.ply").exists()
    outcome.files["scene.html"](tmp_path / "scene.html")
    assert "reconstructed surface" not in (tmp_path / "scene.html").read_text(encoding="utf-8")


def test_the_filters_thin_the_cloud(oracle: dict[str, Any], exact: SimpleNamespace, tmp_path: Path) -> None:
    coarse = run(tmp_path, filters={"voxel": VoxelDownsampling(1.5)}, surface=no_surface)
    assert coarse.metrics["points"] < 0.4 * exact.outcome.metrics["points"]


def test_the_deformed_model_lies_nearer_to_where_tissue_was_swept(
    oracle: dict[str, Any], tmp_path: Path
) -> None:
    bent = replace(RIGID_PHANTOM, deformation=Deformation(bend_mm=3.0, pressure_mm=0.0))
    outcome = run(tmp_path, phantom=bent, deformable={"cpd": CoherentPointDrift()}, surface=no_surface)

    assert outcome.metrics["deformed_tre_covered_mm"] < 0.8 * outcome.metrics["tre_covered_mm"]
    assert outcome.metrics["deformed_rmse_mm"] < outcome.metrics["rmse_mm"]
    assert outcome.metrics["jacobian_min"] > 0.5
    record = json.loads((tmp_path / "registration.json").read_text())
    assert record["deformable"]["verdict"] == "deformed"
    assert record["deformable"]["measured_tre_mm"] == pytest.approx(outcome.metrics["deformed_tre_mm"])
    # The displaced model's file is what the error speaks of: its vertices, where tissue was swept by the found pose.
    model, deformed = (read_surface(tmp_path / name) for name in ("model.ply", "model_deformed.ply"))
    assert isinstance(model, Mesh)
    assert isinstance(deformed, Mesh)
    truth = oracle["truth"]
    swept_mm = transforms.apply(
        np.array(record["fixed_T_moving"]) @ transforms.invert_rigid(truth.ct_T_world),
        truth.deformation.as_swept(model.vertices_mm),
    )
    before_mm, after_mm = (
        np.linalg.norm(surface.vertices_mm - swept_mm, axis=1).mean() for surface in (model, deformed)
    )
    assert after_mm < 0.8 * before_mm
    assert [row["stage"] for _, row in outcome.tables["One unseen sweep, simulated"].iterrows()] == [
        "multistart",
        "cpd",
    ]


def test_a_refused_deformable_stage_leaves_the_rigid_result(oracle: dict[str, Any], tmp_path: Path) -> None:
    def refused(*_: object, **__: object) -> None:
        raise RegistrationInputError("moving_mm: expected points near the fixed ones, received none")

    outcome = run(tmp_path, deformable={"cpd": refused}, surface=no_surface)
    assert outcome.metrics["tre_mm"] < 0.5
    assert "deformed_tre_mm" not in outcome.metrics
    said = "No deformable registration: fixed: expected points near the fixed ones, received none."
    assert said in outcome.findings
    record = json.loads((tmp_path / "registration.json").read_text())
    assert record["deformable"] is None
    assert record["deformable_refused"].startswith("fixed: expected points")
