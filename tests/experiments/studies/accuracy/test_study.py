"""The accuracy study on small sweeps without noise: known errors, stages apart, failures that count."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.studies import accuracy
from experiments.studies.accuracy.parameter_study import least, setting_figure, setting_means
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.rigid.multi_start import MultiStartICP

BENT = PhantomSettings(
    subset="artery",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=40, length_mm=90.0, noise_mm=0.0, noise_deg=0.0),
    deformation=Deformation(bend_mm=2.0, pressure_mm=0.0),
)


def run(**changes: Any) -> Outcome:
    settings: dict[str, Any] = {
        "phantom": BENT, "phantoms": ["artery"], "mask_outliers": MaskOutliers(), "contours": ContourExtractor(),
        "filters": {"voxel": VoxelDownsampling(0.5)}, "rigid": {"multistart": MultiStartICP()},
        "deformable": {"cpd": CoherentPointDrift()}, "sweeps": 1, "first_sweep": 1000, "coverage": 1.0,
        "masks": "exact", "model_path": None, "max_gap_s": 0.1, "fixed_points": 3000, "inlier_mm": 1.0,
        "keep": 0.9, "seed": 0, "workspace": Path(), "progress": Silent(),
    }  # fmt: skip
    return accuracy.run(**(settings | changes))


@cache
def bent() -> Outcome:
    return run()


def result_of(outcome: Outcome, **choices: str) -> JobResult:
    return JobResult({}, outcome.metrics, outcome.cases, Path(), choices=choices)


def test_the_deformable_stage_undoes_a_bend_that_no_rigid_pose_undoes() -> None:
    outcome = bent()
    cases = outcome.cases
    assert cases is not None
    rigid, deformable = (row for _, row in cases.iterrows())
    assert (rigid["stage"], deformable["stage"]) == ("rigid", "deformable")
    assert deformable["tre_covered_mm"] < 0.7 * rigid["tre_covered_mm"]
    assert deformable["rmse_mm"] < rigid["rmse_mm"]
    # What the pose itself is off is a part of the error of the material.
    assert rigid["tre_rigid_mm"] < rigid["tre_mm"]
    assert deformable["jacobian_min"] > 0.5
    assert cases["simulated"].all()
    # Plain names are those of the last stage.
    assert outcome.metrics["tre_mm_median"] == deformable["tre_mm"]
    assert outcome.metrics["rigid_tre_mm_median"] == rigid["tre_mm"]
    assert outcome.metrics["interval_rate"] == deformable["holds"]
    assert outcome.metrics["sweeps_failed"] == outcome.metrics["rigid_sweeps_failed"] == 0
    assert any("nothing of others" in finding for finding in outcome.findings)


def test_without_a_deformation_the_rigid_stage_is_all_there_is_to_find() -> None:
    still = replace(BENT, deformation=Deformation(bend_mm=0.0, pressure_mm=0.0))
    outcome = run(phantom=still, deformable={"none": None})
    assert outcome.cases is not None
    assert list(outcome.cases["stage"]) == ["rigid"]
    assert outcome.metrics["tre_mm_median"] < 0.3
    assert not any(name.startswith("rigid_tre") for name in outcome.metrics)


def test_a_part_of_the_sweep_covers_a_part_of_the_targets() -> None:
    outcome = run(coverage=0.5, deformable={"none": None})
    assert outcome.cases is not None
    assert np.isfinite(outcome.cases[["tre_covered_mm", "tre_uncovered_mm"]].to_numpy()).all()
    assert outcome.cases["coverage"].iloc[0] < 0.75


def test_a_stage_that_fails_is_infinitely_far_off_and_counted() -> None:
    def refused(*_: object, **__: object) -> None:
        raise RegistrationInputError("fixed_mm: expected points, received none")

    outcome = run(deformable={"broken": refused})
    assert outcome.cases is not None
    rigid, deformable = (row for _, row in outcome.cases.iterrows())
    assert np.isfinite(rigid["tre_mm"])
    assert np.isinf(deformable["tre_mm"])
    assert "expected points, received none" in deformable["error"]
    assert outcome.metrics["sweeps_failed"] == 1
    assert any(finding.startswith("artery: broken failed on 1 of 1 sweeps") for finding in outcome.findings)

    outcome = run(rigid={"broken": refused})
    assert outcome.cases is not None
    assert np.isinf(outcome.cases["tre_mm"]).all()
    assert outcome.metrics["rigid_sweeps_failed"] == outcome.metrics["sweeps_failed"] == 1
    assert outcome.figures == {}


def test_methods_share_the_rigid_stage_that_they_start_from() -> None:
    outcome = bent()
    assert outcome.cases is not None
    other = replace(outcome, cases=outcome.cases.assign(deformable="cpd_point"))
    summary = accuracy.summarise([result_of(outcome), result_of(other)])
    assert summary.cases is not None
    assert list(summary.cases["method"]) == ["multistart", "cpd", "cpd_point"]
    # No metric of the parent mixes methods.
    assert summary.metrics == {}
    residuals, errors, _ = summary.tables.values()
    assert list(residuals["method"]) == ["multistart", "cpd", "cpd_point"]
    assert residuals["rmse_published"].tolist() == [
        "about 1.4 (not comparable: simulated)",
        "< 0.6 (not comparable: simulated)",
        "< 0.6 (not comparable: simulated)",
    ]
    assert errors["better"].tolist() == ["", "1/1", "1/1"]
    assert errors["min_p"].tolist()[1:] == [1.0, 1.0]
    assert accuracy.summarise([]).findings == ("No job has sweeps to compare.",)


def test_two_settings_make_a_map_of_residual_and_true_error() -> None:
    outcome = bent()
    assert outcome.cases is not None
    results = []
    tried = [("5", "1", 0.1, 2.0), ("5", "8", 0.2, 1.5), ("9", "1", 0.3, 1.0), ("9", "8", 0.4, 1.2)]
    for beta, weight, rmse_mm, tre_mm in tried:
        cases = outcome.cases.assign(rmse_mm=rmse_mm, tre_mm=tre_mm)
        choices = {"deformable.cpd.point.beta_mm": beta, "deformable.cpd.point.roughness_per_mm2": weight}
        results.append(result_of(replace(outcome, cases=cases), **choices))
    summary = accuracy.summarise(results)
    (means,) = summary.tables.values()
    assert means[["beta_mm", "roughness_per_mm2", "tre_mm"]].to_numpy().tolist() == [
        [5, 1, 2.0], [5, 8, 1.5], [9, 1, 1.0], [9, 8, 1.2]
    ]  # fmt: skip
    assert list(summary.figures) == ["accuracy_settings"]
    assert summary.findings[0] == (
        "The least RMSE, 0.10 mm, is at beta_mm 5, roughness_per_mm2 1, with a true error of 2.0 mm; the least true "
        "error, 1.0 mm, is at beta_mm 9, roughness_per_mm2 1, with an RMSE of 0.30 mm."
    )


def test_a_setting_that_failed_somewhere_is_never_the_best() -> None:
    cases = pd.DataFrame({"stage": "deformable", "a": [1.0, 1.0, 2.0], "b": 1.0, "rmse_mm": [0.1, np.inf, 0.5],
                          "hd95_mm": 1.0, "tre_mm": [0.1, np.inf, 0.9], "tre_covered_mm": 1.0})  # fmt: skip
    means = setting_means(cases, ("a", "b"))
    assert "is at a 2, b 1" in least(means, ("a", "b"))[0]
    assert setting_figure(means, ("a", "b")).axes
    failed = means.assign(tre_mm=np.inf)
    assert least(failed, ("a", "b")) == ("Every setting failed on some sweep.",)


def test_a_job_is_one_phantom_and_one_method() -> None:
    jobs = accuracy.jobs(
        {"phantoms": ["vein", "artery"], "deformable": {"none": None, "cpd": {"residual": "plane"}}}
    )
    assert jobs == [
        {"phantoms": [phantom], "deformable": deformable}
        for phantom in ("vein", "artery")
        for deformable in ({"none": None}, {"cpd": {"residual": "plane"}})
    ]
    for wrong in ({}, None, "cpd"):
        with pytest.raises(InputError, match="deformable: expected methods by name"):
            accuracy.jobs({"phantoms": ["vein"], "deformable": wrong})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coverage": 0.0}, "coverage: expected a share"),
        ({"coverage": 1.5}, "coverage: expected a share"),
        ({"sweeps": 0}, "sweeps: expected"),
        ({"first_sweep": -1}, "first_sweep: expected"),
        ({"phantoms": ["vein", "artery"]}, "phantoms: expected one phantom a job"),
        ({"masks": "drawn"}, "masks: expected exact or model"),
        ({"masks": "model"}, "model_path: expected a network with masks=model"),
        ({"deformable": {}}, "deformable: expected exactly one method"),
        ({"rigid": {"a": None, "b": None}}, "rigid: expected exactly one method"),
    ],
)
def test_settings_that_allow_no_registration_are_refused(change: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {
        "phantom": BENT, "phantoms": ["artery"], "rigid": {"multistart": None}, "deformable": {"none": None},
        "sweeps": 1, "first_sweep": 0, "coverage": 1.0, "masks": "exact", "model_path": None,
    }  # fmt: skip
    accuracy.check(**settings)
    with pytest.raises(InputError, match=message):
        accuracy.check(**(settings | change))
