"""What repeats cannot show, the truth does: sweeps that share a wrong calibration agree with each other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.studies.consistency import study as consistency
from registration.errors import InputError as RegistrationInputError
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Mesh
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.scan import SimulatedSweep
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces

EXACT = Motion(frames=50, length_mm=40.0, noise_mm=0.0, noise_deg=0.0)
PHANTOM = PhantomSettings(
    scanner=Scanner(height_px=128, width_px=128),
    motion=EXACT,
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)


def run(phantom: PhantomSettings, **changes: Any) -> Outcome:
    settings: dict[str, Any] = {
        "phantoms": ["artificial"], "mask_outliers": MaskOutliers(), "pieces": VesselPieces(),
        "contours": ContourExtractor(), "filters": {"voxel": VoxelDownsampling(0.6)},
        "surface": PoissonSurface(cell_mm=0.9, bridge_mm=3.0), "smoothing": TaubinSmoothing(), "sweeps": 2,
        "masks": "exact", "model_path": None, "max_gap_s": 0.1, "samples": 3000, "seed": 0,
        "workspace": Path(), "progress": Silent(),
    }  # fmt: skip
    return consistency.run(phantom=phantom, **(settings | changes))


@pytest.fixture(scope="module")
def exact() -> Outcome:
    return run(PHANTOM)


def test_exact_sweeps_agree_with_each_other_and_with_the_truth(exact: Outcome) -> None:
    assert exact.cases is not None
    assert exact.cases["kind"].tolist() == ["truth", "truth", "common", "pair"]
    assert exact.metrics["hd95_covered_mm_median"] < 0.25
    assert exact.metrics["truth_hd95_covered_mm_median"] < 0.25
    assert exact.metrics["truth_msd_covered_mm_mean"] < 0.1
    assert abs(exact.metrics["truth_bias_mm_mean"]) < 0.03
    assert exact.cases["simulated"].all()
    assert exact.tags["simulated"] == "true"


def test_a_wrong_calibration_is_common_to_all_sweeps(exact: Outcome) -> None:
    wrong = run(replace(PHANTOM, motion=replace(EXACT, calibration_mm=1.0)))
    # Both sweeps are off by the same millimetre, turned as the probe was; only the truth can tell.
    assert wrong.metrics["msd_covered_mm_mean"] < 0.15
    assert wrong.metrics["truth_msd_covered_mm_mean"] > 0.3
    assert wrong.metrics["common_mm"] == pytest.approx(wrong.metrics["truth_msd_covered_mm_mean"], rel=0.3)
    assert exact.metrics["common_mm"] < 0.1


def test_a_known_deformation_is_taken_out() -> None:
    soft = replace(PHANTOM, subset="vein", deformation=Deformation(bend_mm=3.0, pressure_mm=3.0))
    found = run(soft, phantoms=["vein"])
    assert found.metrics["truth_hd95_covered_mm_median"] < 0.25
    assert found.metrics["hd95_tissue_mm_median"] < 0.25
    # Each sweep presses as it likes.
    assert found.metrics["hd95_covered_mm_median"] > 1.5 * found.metrics["hd95_tissue_mm_median"]


def test_all_phantoms_side_by_side(exact: Outcome) -> None:
    assert exact.cases is not None
    other = exact.cases.assign(phantom="vein")
    results = [JobResult({}, {}, cases, Path()) for cases in (exact.cases, other)]
    summary = consistency.summarise(results)
    (between, to_truth) = summary.tables.values()
    assert between["phantom"].tolist() == to_truth["phantom"].tolist() == ["artificial", "vein", "all"]
    assert between["pairs"].tolist() == [1, 1, 2]
    assert "not comparable" in between.iloc[0]["hd95_mm_median published"]
    choices = [{"surface": name} for name in ("poisson", "ball_pivoting")]
    twice = [JobResult({}, {}, exact.cases, Path(), choices=choice) for choice in choices]
    (apart, _) = consistency.summarise(twice).tables.values()
    assert apart["phantom"].tolist() == [
        "artificial surface=poisson",
        "artificial surface=ball_pivoting",
        "all",
    ]
    assert consistency.summarise([]).findings == ("No job has sweeps to compare.",)


def test_a_network_sees_the_pictures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from models.predictor import Predictor

    simulate = consistency.simulate_sweep

    def painted(settings: PhantomSettings, number: int, pictures: bool) -> SimulatedSweep:
        assert pictures
        truth = simulate(settings, number, pictures=False)
        sweep = replace(truth.sweep, images=np.where(truth.masks, 30, 200).astype(np.uint8))
        return replace(truth, sweep=sweep, masks=np.zeros_like(truth.masks))

    dark = SimpleNamespace(probability=lambda images: (images < 100).astype(np.float32))
    monkeypatch.setattr(consistency, "simulate_sweep", painted)
    monkeypatch.setattr(Predictor, "load", lambda path: dark)
    (tmp_path / "model.pt").write_bytes(b"weights")
    found = run(PHANTOM, masks="model", model_path=str(tmp_path / "model.pt"))
    # Stairs of pixels are all that such probabilities leave.
    assert found.metrics["truth_hd95_covered_mm_median"] < 0.5
    assert found.tags["masks"] == "model"


def test_a_sweep_without_a_surface_has_failed() -> None:
    poisson, calls = PoissonSurface(cell_mm=0.9, bridge_mm=3.0), []

    def sometimes(cloud: OrientedCloud) -> Mesh:
        calls.append(cloud)
        if len(calls) == 1:
            raise RegistrationInputError("cloud: expected points that a surface fits, received others")
        return poisson(cloud)

    found = run(PHANTOM, surface=sometimes)
    assert found.cases is not None
    truths = found.cases[found.cases["kind"] == "truth"]
    assert truths["hd95_mm"].tolist()[0] == np.inf
    assert np.isfinite(truths["hd95_mm"].tolist()[1])
    assert "expected points that a surface fits" in truths["error"].tolist()[0]
    assert found.metrics["hd95_mm_median"] == np.inf
    assert found.metrics["sweeps_failed"] == 1

    def never(cloud: OrientedCloud) -> Mesh:
        raise RegistrationInputError("cloud: expected points that a surface fits, received others")

    with pytest.raises(InputError, match="sweeps: expected some that can be reconstructed, received none"):
        run(PHANTOM, surface=never)


def test_jobs_are_phantoms() -> None:
    assert consistency.jobs({"phantoms": ["vein", "artery"]}) == [
        {"phantoms": ["vein"]},
        {"phantoms": ["artery"]},
    ]
    for wrong in ("vein", [], None):
        with pytest.raises(InputError, match="phantoms: expected a list of phantoms"):
            consistency.jobs({"phantoms": wrong})


@pytest.mark.parametrize(
    "change, message",
    [
        ({"sweeps": 1}, "sweeps: expected a whole number of at least 2, received 1"),
        ({"masks": "drawn"}, "masks: expected exact or model, received 'drawn'"),
        ({"masks": "model"}, "model_path: expected a network with masks=model only, received None"),
        ({"model_path": "a.pt"}, "model_path: expected a network with masks=model only, received 'a.pt'"),
        ({"masks": "model", "model_path": "absent.pt"}, "model_path: expected a network trained by"),
        ({"phantoms": ["vein", "artery"]}, "phantoms: expected one phantom a job, received 2"),
        ({"phantoms": ["mesh"]}, "phantoms: expected .mesh. with phantom.mesh and only then"),
    ],
)
def test_settings_that_allow_no_comparison_are_refused(change: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {
        "phantom": PHANTOM, "phantoms": ["vein"], "sweeps": 2, "masks": "exact", "model_path": None,
    }  # fmt: skip
    with pytest.raises(InputError, match=message):
        consistency.check(**(settings | change))
