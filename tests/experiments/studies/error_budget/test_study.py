"""The error budget on made-up errors, whose shares are known, and on a small sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.studies import error_budget
from experiments.studies.error_budget.report import metrics, shares, shown
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.error_sources import ErrorSources
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.rigid.multi_start import MultiStartICP

SMALL = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=40, length_mm=90.0, noise_mm=0.0, noise_deg=0.0),
)


def made_up(sweep: int, own: dict[str, float], deformed: float = 0.5) -> pd.DataFrame:
    """Errors that add up, half as large after the deformable stage."""
    rows: list[dict[str, Any]] = []
    names = list(own)
    for bits in range(2 ** len(names)):
        on = [name for place, name in enumerate(names) if bits >> place & 1]
        tre_mm = 0.1 + sum(own[name] for name in on)
        rows.append(
            {"kind": "sources", "on": "+".join(on), "tre_mm": tre_mm, "bias_mm": 0.0, "deviation_mm": 0.0}
        )
    for bias_mm, dsc in ((0.0, 1.0), (0.5, 0.85)):
        rows.append(
            {
                "kind": "masks",
                "on": "",
                "tre_mm": 0.1 + bias_mm,
                "bias_mm": bias_mm,
                "deviation_mm": 0.0,
                "dsc": dsc,
            }
        )
    table = pd.DataFrame(rows).assign(sweep=sweep, phantom="artery", rmse_mm=0.3, error="")
    return table.assign(deformed_tre_mm=deformed * table["tre_mm"], dsc=table["dsc"].fillna(1.0))


def run(**changes: Any) -> Outcome:
    settings: dict[str, Any] = {
        "phantom": SMALL, "phantoms": ["artery"], "error_sources": ErrorSources(lag_s=0.2),
        "mask_outliers": MaskOutliers(), "contours": ContourExtractor(), "filters": {"voxel": VoxelDownsampling(0.6)},
        "rigid": {"multistart": MultiStartICP()}, "deformable": {"none": None}, "sweeps": 1, "first_sweep": 1000,
        "sources": ["lag"], "mask_biases_mm": [0.5], "mask_deviations_mm": [], "max_gap_s": 0.3, "fixed_points": 2000,
        "inlier_mm": 1.0, "keep": 0.9, "seed": 0, "workspace": Path(), "progress": Silent(),
    }  # fmt: skip
    return error_budget.run(**(settings | changes))


def test_shares_of_errors_that_add_up_are_the_errors() -> None:
    own = {"lag": 0.2, "calibration": 1.0, "deformation": -0.05}
    found = shares(made_up(0, own))
    rigid = found[found["stage"] == "rigid"].set_index("source")["share_mm"].to_dict()
    later = found[found["stage"] == "deformable"].set_index("source")["share_mm"].to_dict()
    assert rigid == pytest.approx(own)
    assert later == pytest.approx({name: value / 2 for name, value in own.items()})
    scalars = metrics(made_up(0, own))
    assert scalars["share_calibration_mm"] == pytest.approx(0.5)
    assert scalars["tre_mm"] == pytest.approx(0.5 * 1.25)
    assert scalars["tre_without_errors_mm"] == pytest.approx(0.05)


def test_the_range_over_sweeps_stands_next_to_the_mean() -> None:
    tables = [made_up(0, {"lag": 0.2, "ct": 0.4}), made_up(1, {"lag": 0.6, "ct": 0.4})]
    results = [JobResult({}, {}, table, Path()) for table in tables]
    outcome = error_budget.summarise(results)
    share, masks = outcome.tables.values()
    lag = share[(share["stage"] == "rigid") & (share["source"] == "lag")].iloc[0]
    assert (lag["sweeps"], lag["share_mm"], lag["low_mm"], lag["high_mm"]) == pytest.approx(
        (2, 0.4, 0.2, 0.6)
    )
    assert lag["share_%"] == pytest.approx(50.0)
    assert masks["dsc"].tolist() == [1.0, 0.85]
    assert outcome.findings[0] == (
        "artery, after the rigid stage: the true error rises from 0.1 mm without errors to 0.9 mm with all; the "
        "largest shares are lag 0.40 mm, ct 0.40 mm."
    )
    assert len(outcome.figures["error_budget"].axes) == 2
    assert error_budget.summarise([]).findings == ("No job has registrations to share.",)


def test_a_sweep_with_a_failed_registration_has_no_shares() -> None:
    table = made_up(0, {"lag": 0.2, "ct": 0.4})
    table.loc[1, ["tre_mm", "deformed_tre_mm"]] = np.inf
    table.loc[1, "error"] = "nothing found"
    outcome = shown(table, metrics(table))
    assert np.isnan(outcome.metrics["share_lag_mm"])
    assert outcome.metrics["failed"] == 1
    assert outcome.findings[0].startswith("artery: 1 of 4 registrations failed")


def test_a_lag_along_the_vessel_is_felt_and_wider_masks_lower_the_dsc() -> None:
    outcome = run()
    assert outcome.cases is not None
    rows = outcome.cases.set_index(["kind", "on"])
    # 90 mm in 10 s: 0.2 s too late puts the cloud 1.8 mm along the vessel.
    assert rows.loc[("sources", ""), "tre_mm"] < 0.5
    assert rows.loc[("sources", "lag"), "tre_mm"] == pytest.approx(1.8, abs=0.5)
    assert rows.loc[("sources", "lag"), "dsc"] == 1.0
    assert rows.loc[("masks", ""), "dsc"] < 0.95
    assert outcome.cases["deformed_tre_mm"].isna().all()
    assert set(shares(outcome.cases)["stage"]) == {"rigid"}
    assert outcome.cases["simulated"].all()


def test_a_registration_that_fails_is_infinitely_far_off() -> None:
    def refused(*_: object, **__: object) -> None:
        raise RegistrationInputError("fixed_mm: expected points, received none")

    outcome = run(rigid={"broken": refused}, deformable={"cpd": CoherentPointDrift()})
    assert outcome.cases is not None
    assert np.isinf(outcome.cases["tre_mm"]).all()
    assert outcome.metrics["failed"] == 3
    assert outcome.figures == {}


def test_a_job_is_one_sweep_of_one_phantom() -> None:
    assert error_budget.jobs({"phantoms": ["vein", "artery"], "first_sweep": 5, "sweeps": 2}) == [
        {"phantoms": [phantom], "first_sweep": number, "sweeps": 1}
        for phantom in ("vein", "artery")
        for number in (5, 6)
    ]
    with pytest.raises(InputError, match="sweeps: expected"):
        error_budget.jobs({"phantoms": ["vein"], "first_sweep": 0, "sweeps": 0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sources": []}, "sources: expected of mask_bias"),
        ({"sources": ["lag", "lag"]}, "sources: expected of mask_bias"),
        ({"sources": ["wind"]}, "sources: expected of mask_bias"),
        ({"sources": "lag"}, "sources: expected of mask_bias"),
        ({"mask_biases_mm": [float("nan")]}, "mask_biases_mm: expected a list of lengths"),
        ({"mask_deviations_mm": [-0.1]}, "mask_deviations_mm: expected a list of lengths"),
        ({"phantoms": []}, "phantoms: expected one phantom a job"),
        ({"rigid": {}}, "rigid: expected exactly one method"),
    ],
)
def test_settings_that_make_no_budget_are_refused(change: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {
        "phantom": SMALL, "phantoms": ["artery"], "rigid": {"multistart": None}, "deformable": {"none": None},
        "sources": ["lag"], "mask_biases_mm": [], "mask_deviations_mm": [],
    }  # fmt: skip
    error_budget.check(**settings)
    with pytest.raises(InputError, match=message):
        error_budget.check(**(settings | change))
