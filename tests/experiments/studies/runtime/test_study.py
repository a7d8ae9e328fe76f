"""Every stage of the chain is timed once, what is left out says so, and what fails has no time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.studies.runtime import study as runtime
from models.predictor import Predictor
from registration.centerline.extractor import CenterlineExtractor
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Mesh
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces

SMALL = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=64, width_px=64),
    motion=Motion(frames=20, duration_s=4.0, noise_mm=0.0, noise_deg=0.0),
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)
REST = ["reconstruction", "centerline", "rigid", "deformable"]


class Known:
    """A rigid method that knows the true pose: the time of the search is none of these tests'."""

    def __init__(self, ct_T_world: np.ndarray, verdict: str = "accepted") -> None:
        self.result = SimpleNamespace(fixed_T_moving=ct_T_world, verdict=verdict)

    def __call__(self, moving_mm: Any, fixed_mm: Any, initial: None, *, moving_frame: Any) -> Any:
        assert len(moving_mm) == len(moving_frame) and initial is None
        return self.result


@pytest.fixture(scope="module")
def truth() -> Any:
    # Pictures take far longer than all else.
    return runtime.simulate_sweep(SMALL, 3, pictures=False)


@pytest.fixture
def parts(truth: Any, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    asked = []

    def simulated(settings: PhantomSettings, sweep: int, pictures: bool) -> Any:
        asked.append(pictures)
        return truth

    def stream(frames: Any) -> Any:
        for index, _ in enumerate(frames):
            times = SimpleNamespace(preprocessing_s=1e-6)
            yield SimpleNamespace(soft_mask=truth.masks[index].astype(np.float32), times=times)

    predictor = SimpleNamespace(stream=stream, batch_size=4)
    monkeypatch.setattr(runtime, "simulate_sweep", simulated)
    monkeypatch.setattr(Predictor, "load", lambda path, device, engine: predictor)
    return {
        "phantom": SMALL, "phantoms": ["artery"], "mask_outliers": MaskOutliers(), "pieces": VesselPieces(),
        "contours": ContourExtractor(), "filters": {"voxel": VoxelDownsampling(0.7)},
        "surface": PoissonSurface(cell_mm=1.2, bridge_mm=4.0), "smoothing": TaubinSmoothing(),
        "centerline": CenterlineExtractor(), "rigid": {"known": Known(truth.ct_T_world)},
        "deformable": {"none": None}, "masks": "exact", "model_path": None, "device": "cpu",
        "sweep_index": 3, "repeats": 1, "frame_rate_hz": None, "max_gap_s": 0.5, "fixed_points": 800,
        "seed": 0, "workspace": Path(), "progress": Silent(), "asked": asked,
    }  # fmt: skip


def run(parts: dict[str, Any], **changes: Any) -> Outcome:
    return runtime.run(**{key: value for key, value in {**parts, **changes}.items() if key != "asked"})


def test_every_stage_has_its_time_and_its_peak_of_memory(parts: dict[str, Any]) -> None:
    outcome = run(parts, masks="model", model_path="model.pt", deformable={"cpd": CoherentPointDrift()})
    costs = outcome.cases
    assert costs is not None and parts["asked"] == [True]
    for _, repeat in costs.groupby("repeat"):
        assert list(repeat["stage"]) == ["acquisition", "preprocessing", "segmentation", *REST]
        assert (repeat["error"] == "").all()
        assert (repeat["seconds"] > 0).all()
    # 20 frames in 4 s; the rate is that of the sweep.
    assert costs.loc[costs["stage"] == "acquisition", "seconds"].to_numpy() == pytest.approx(4.0, rel=0.06)
    assert costs["modelled"].tolist() == [stage == "acquisition" for stage in costs["stage"]]
    measured = costs[~costs["modelled"]]
    assert measured["peak_memory_mb"].between(50, 100_000).all()
    assert costs["simulated"].all()
    total = costs.groupby("repeat")["seconds"].sum().median()
    assert outcome.metrics["total_s_median"] == pytest.approx(total)
    preprocessing = costs.loc[costs["stage"] == "preprocessing", "seconds"]
    assert preprocessing.to_numpy() == pytest.approx(20e-6)
    assert outcome.metrics["tre_mm"] == pytest.approx(0.0, abs=1e-9)
    assert set(outcome.tables["runtime by stage"]["data"]) == {"simulated, not comparable"}


def test_exact_masks_leave_segmentation_out_and_the_total_says_so(parts: dict[str, Any]) -> None:
    outcome = run(parts, frame_rate_hz=10.0)
    assert outcome.cases is not None and parts["asked"] == [False]
    assert list(outcome.cases["stage"]) == ["acquisition", *REST[:-1]]
    assert outcome.cases["seconds"].iloc[0] == 2.0
    table = outcome.tables["runtime of the workflow"]
    assert table["without"].tolist() == ["preprocessing, segmentation"]
    assert table["data"].tolist() == ["simulated, not comparable"]
    assert "without pre-processing and segmentation" in outcome.findings[0]
    assert "without pre-processing and segmentation" in outcome.figures["runtime"].get_suptitle()
    assert not any("segmentation" in name for name in outcome.metrics)


def test_a_stage_that_fails_has_no_time_and_neither_has_the_total(parts: dict[str, Any], truth: Any) -> None:
    def none(cloud: object) -> Mesh:
        raise RegistrationInputError("cloud: expected points that a surface fits, received 12")

    failed = {"known": Known(truth.ct_T_world, "failed")}
    outcome = run(parts, surface=none, rigid=failed, deformable={"cpd": CoherentPointDrift()})
    costs = outcome.cases
    assert costs is not None
    # No surface, no centerline; the cloud is registered all the same.
    assert list(costs["stage"]) == ["acquisition", "reconstruction", "rigid", "deformable"]
    by_stage = costs.set_index("stage")
    assert by_stage["seconds"].isna().to_dict() == {
        "acquisition": False,
        "reconstruction": True,
        "rigid": False,
        "deformable": True,
    }
    assert np.isnan(outcome.metrics["total_s_median"])
    assert any("the stage reconstruction failed: cloud: expected points" in one for one in outcome.findings)
    assert any("the rigid registration failed" in one for one in outcome.findings)


def test_masks_without_any_vessel_are_refused(parts: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    empty = SimpleNamespace(
        batch_size=4,
        stream=lambda frames: (
            SimpleNamespace(
                soft_mask=np.zeros((64, 64), np.float32), times=SimpleNamespace(preprocessing_s=0.0)
            )
            for _ in frames
        ),
    )
    monkeypatch.setattr(Predictor, "load", lambda path, device, engine: empty)
    with pytest.raises(InputError, match="masks: expected a vessel in some frames"):
        run(parts, masks="model", model_path="model.pt")


def test_phantoms_stand_next_to_each_other() -> None:
    about = {"repeat": 0, "error": "", "frames": 20, "tre_mm": 0.1, "simulated": True, "peak_memory_mb": 1.0}
    stages = [("acquisition", 4.0, True), ("rigid", 0.5, False)]
    results = [
        JobResult(
            {"phantoms": [name]},
            {},
            pd.DataFrame(
                {"phantom": name, "stage": stage, "seconds": seconds, "modelled": modelled, **about}
                for stage, seconds, modelled in stages
            ),
            Path(),
        )
        for name in ("artery", "vein")
    ]
    both = runtime.summarise(results)
    assert both.tables["runtime of the workflow"]["phantom"].tolist() == ["artery", "vein"]
    assert {"artery/total_s_median", "vein/total_s_median", "vein/rigid_s_median"} <= set(both.metrics)
    assert runtime.summarise([]).findings == ("No job has times.",)


def config(**changes: Any) -> dict[str, Any]:
    return {"phantoms": ["artificial", "vein"], **changes}


def test_one_job_for_each_phantom() -> None:
    assert runtime.jobs(config()) == [{"phantoms": ["artificial"]}, {"phantoms": ["vein"]}]
    with pytest.raises(InputError, match="phantoms: expected a list of phantoms, received 'vein'"):
        runtime.jobs(config(phantoms="vein"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"repeats": 0}, "repeats: expected"),
        ({"frame_rate_hz": 0.0}, "frame_rate_hz: expected"),
        ({"masks": "drawn"}, "masks: expected model or exact, received 'drawn'"),
        ({"model_path": "model.pt"}, "model_path: expected null with masks=exact"),
        ({"masks": "model"}, "model_path: expected a model file .* or masks=exact"),
        ({"masks": "model", "model_path": "/no/such.pt"}, "model_path: expected a model file"),
        ({"phantoms": ["artery", "vein"]}, "phantoms: expected one phantom a job"),
        ({"rigid": {}}, "rigid: expected exactly one method"),
        ({"deformable": {}}, "deformable: expected exactly one method"),
    ],
)
def test_settings_that_do_not_fit_are_refused_before_any_work(changes: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {
        "phantom": SMALL, "phantoms": ["artery"], "rigid": {"icp": object()}, "deformable": {"none": None},
        "masks": "exact", "model_path": None, "repeats": 1, "frame_rate_hz": None,
    }  # fmt: skip
    runtime.check(**settings)
    with pytest.raises((InputError, RegistrationInputError), match=message):
        runtime.check(**{**settings, **changes})
