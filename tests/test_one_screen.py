"""What a notebook shows of a result is one screen: of each class that a user meets, filled with thousands of points."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.outcome import Outcome
from experiments.tracking.archive import read_archive
from models.calibration.temperature import TemperatureScaling
from models.inference.results import FramePrediction, Prediction, StageTimes
from models.labelled_frames import LabelledFrames
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.predictor import HALF, Predictor
from models.preprocessing.preprocessing import Preprocessing
from registration import transforms
from registration.centerline.extractor import CenterlineExtractor
from registration.cpd import CoherentPointDrift
from registration.io.displacement_fields import sample_grid
from registration.io.landmarks import LandmarkPairs, Landmarks
from registration.metrics.surface_distance import surface_residuals
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.rigid import MultiStartICP
from registration.synchronisation import synchronise

LINES, COLUMNS = 25, 100
ROOT = Path(__file__).resolve().parents[1]


def of_registration() -> Iterator[Any]:
    made = simulate_sweep(
        PhantomSettings(
            subset="artery", scanner=Scanner(height_px=96, width_px=96), motion=Motion(frames=30)
        ),
        0,
        pictures=False,
    )
    posed = synchronise(made.sweep, max_gap_s=0.1)
    surface = PoissonSurface(cell_mm=0.9, bridge_mm=3.0)
    chain = Reconstruction(
        ContourExtractor(),
        {"voxel": VoxelDownsampling(0.5)},
        surface,
        TaubinSmoothing(),
        CenterlineExtractor(),
    )
    gathered = chain.gather(made.masks[posed.kept], posed.world_A_pixel)
    built = chain.build(gathered)
    yield from (made, made.sweep, made.model, made.centerline, made.centerline.lines[0], posed)
    yield from (gathered, gathered.checked, gathered.cloud, VoxelDownsampling(0.5)(gathered.contours))
    yield from (built, built.pieces, built.smoothed)
    model_mm, cloud = made.model.sample(2000, np.random.default_rng(0)), gathered.cloud
    rigid = MultiStartICP()(cloud.points_mm, model_mm, moving_frame=cloud.frame_index)
    yield from (rigid, rigid.candidates[0], rigid.deformation, rigid.overlay(cloud.points_mm, model_mm))
    swept_mm = transforms.apply(rigid.fixed_T_moving, cloud.points_mm)
    deformed = CoherentPointDrift()(model_mm, swept_mm, fixed_frame=cloud.frame_index)
    yield from (deformed, deformed.plausibility, deformed.predicted)
    yield surface_residuals(swept_mm, made.model, np.eye(4), inlier_mm=1.0, keep=0.9, seed=0)
    low_mm, high_mm = model_mm.min(axis=0), model_mm.max(axis=0)
    yield sample_grid(deformed.displacement, low_mm, high_mm, 10.0)
    names = tuple(f"landmark {number}" for number in range(500))
    yield from (Landmarks(names, model_mm[:500]), LandmarkPairs(names, model_mm[:500], model_mm[:500]))


def of_models() -> Iterator[Any]:
    images = tuple(np.zeros((96, 96), np.uint8) for _ in range(300))
    names = tuple(map(str, range(300)))
    masks = tuple(each > 0 for each in images)
    yield LabelledFrames(images, masks, names, names, ((0.1, 0.1),) * 300, simulated=True)
    yield Prediction(np.stack(masks), np.zeros((300, 96, 96), np.float32), StageTimes(), np.stack(images))
    yield FramePrediction(masks[0], np.zeros((96, 96), np.float32), 0.5, StageTimes(), HALF)
    recipe = UNet(width=4)
    members = tuple(ModelMember(f"fold {number}", recipe, recipe().state_dict()) for number in range(5))
    model = SegmentationModel(
        members, Preprocessing(image_size_px=64), TemperatureScaling(), certificate={"long": "x" * 5000}
    )
    yield from (members[0], model, Predictor.from_model(model))


def of_experiments() -> Iterator[Any]:
    yield from read_archive(ROOT / "results" / "runs", ["segmentation"])
    sentences = tuple(f"Sentence {number} " * 20 for number in range(50))
    yield Outcome(metrics={f"metric_{number}": 0.1 for number in range(200)}, findings=sentences)


@pytest.mark.parametrize("results", [of_registration, of_models, of_experiments])
def test_a_result_is_one_screen(results: Any) -> None:
    seen = 0
    for result in results():
        lines = repr(result).splitlines()
        name = type(result).__name__
        assert len(lines) <= LINES, f"{name}: {len(lines)} lines"
        assert max(map(len, lines)) <= COLUMNS, f"{name}: {max(lines, key=len)}"
        seen += 1
        if hasattr(result, "_repr_html_"):
            html = result._repr_html_()
            assert len(html) < 600_000 and ("<svg" in html or "data:image/png" in html), name
    assert seen
