"""One sweep: exact masks leave little, wider ones more, and empty ones leave nothing that looks like a result."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from experiments.analysis.registration.registered_sweep import RegistrationStages
from experiments.studies.propagation.trial import Trial, mask_scores
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.rigid.multi_start import MultiStartICP

SMALL = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=40, length_mm=90.0, noise_mm=0.0, noise_deg=0.0),
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)


@pytest.fixture(scope="module")
def sweep() -> SimulatedSweep:
    return simulate_sweep(SMALL, 1000, pictures=False)


def trial(**changes: Any) -> Trial:
    methods: dict[str, Any] = {"rigid": {"multistart": MultiStartICP()}, "deformable": {"none": None}}
    stages = RegistrationStages(**(methods | changes), fixed_points=2000, inlier_mm=1.0, keep=0.9, seed=0)
    chain = Reconstruction(
        ContourExtractor(),
        {"voxel": VoxelDownsampling(0.6)},
        PoissonSurface(cell_mm=0.9, bridge_mm=3.0),
        TaubinSmoothing(),
    )
    return Trial(chain, stages, max_gap_s=0.3, samples=2000)


def test_exact_masks_leave_the_errors_of_geometry_and_wider_ones_more(sweep: SimulatedSweep) -> None:
    exact = trial()(sweep, sweep.masks)
    assert (exact["dsc"], exact["hd95_mm"], exact["missed"], exact["false_alarms"]) == (1.0, 0.0, 0, 0)
    assert exact["surface_rmse_mm"] < 0.5
    assert exact["tre_mm"] < 1.0
    assert exact["surface_coverage"] > 0.8
    assert (exact["error"], exact["surface_error"]) == ("", "")
    assert np.isnan(exact["deformed_tre_mm"])
    wide = trial()(sweep, binary_dilation(sweep.masks, np.ones((1, 3, 3), bool), iterations=2))
    assert wide["dsc"] < 0.9
    assert wide["surface_rmse_mm"] > exact["surface_rmse_mm"] + 0.3


def test_a_vessel_that_is_missed_entirely_is_infinitely_far_off(sweep: SimulatedSweep) -> None:
    row = trial(deformable={"cpd": CoherentPointDrift()})(sweep, np.zeros_like(sweep.masks))
    assert row["dsc"] == 0.0
    assert row["missed"] == row["frames"] > 0
    infinite = ("surface_rmse_mm", "surface_hd95_mm", "rmse_mm", "tre_mm", "deformed_tre_mm")
    assert all(np.isinf(row[name]) for name in infinite)
    assert row["surface_coverage"] == 0.0
    assert "expected a vessel" in row["error"]
    assert "expected a vessel" in row["surface_error"]
    assert row["verdict"] == "failed"
    assert np.isnan(trial()(sweep, np.zeros_like(sweep.masks))["deformed_tre_mm"])


def test_a_registration_or_surface_that_is_refused_fails_alone(
    sweep: SimulatedSweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise RegistrationInputError("fixed_mm: expected points, received none")

    row = trial(rigid={"broken": refused})(sweep, sweep.masks)
    assert np.isinf(row["tre_mm"])
    assert row["error"].startswith("fixed_mm")
    assert np.isfinite(row["surface_rmse_mm"])
    monkeypatch.setattr(Reconstruction, "build", refused)
    row = trial()(sweep, sweep.masks)
    assert np.isinf(row["surface_hd95_mm"])
    assert row["surface_error"].startswith("fixed_mm")
    assert np.isfinite(row["tre_mm"])


def test_dsc_is_over_frames_with_a_vessel_and_false_alarms_over_the_others(sweep: SimulatedSweep) -> None:
    exact = np.zeros((4, 8, 8), bool)
    exact[:3, 2:4, 2:4] = True
    masks = exact.copy()
    masks[1] = False
    masks[3, 0, 0] = True
    truth = SimpleNamespace(
        masks=exact,
        sweep=replace(sweep.sweep, images=np.zeros((4, 8, 8), np.uint8), image_times_s=np.arange(4.0)),
    )
    row = mask_scores(masks, truth)  # type: ignore[arg-type]
    assert row["dsc"] == pytest.approx(2 / 3)
    assert (row["frames"], row["missed"], row["frames_empty"], row["false_alarms"]) == (3, 1, 1, 1)
    diagonal_mm = float(np.hypot(*(8 * side for side in sweep.sweep.calibration.spacing_mm)))
    assert row["hd95_mm"] == pytest.approx(diagonal_mm / 3, rel=0.2)
    truth.masks = np.zeros_like(exact)
    assert np.isnan(mask_scores(masks, truth)["dsc"])  # type: ignore[arg-type]
