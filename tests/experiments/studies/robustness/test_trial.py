"""One trial: what a method is told, what its result is measured by, and what it says of itself."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from vessels import bent_tube

from experiments.studies.robustness.design import Condition
from experiments.studies.robustness.trial import RobustnessTrial
from registration import transforms
from registration.geometry.shapes import surface_frame
from registration.perturbation.perturbation import Perturbation, Piece
from registration.rigid.result import RigidResult

TUBE = bent_tube()
TARGETS = TUBE.sample(40, np.random.default_rng(0))
PERTURBATION = Perturbation(180.0, 10.0, 0.0, 0.0, moving_points=200, fixed_points=200)
IDENTITY = np.eye(4)


def result(pose: np.ndarray, **more: Any) -> RigidResult:
    return RigidResult(pose, 0.0, 0.0, 1.0, 1, True, (), 0.25, **more)


def trial(method: Any, perturbation: Perturbation = PERTURBATION, **change: Any) -> RobustnessTrial:
    given: dict[str, Any] = {
        "anatomy": "tube",
        "name": "told",
        "method": method,
        "conditions": (Condition("rotation", math.nan, perturbation, 3),),
        "piece": Piece(),
        "moving": TUBE,
        "fixed": TUBE,
        "true_fixed_T_moving": IDENTITY,
        "targets_mm": TARGETS,
        "covered": np.ones(len(TARGETS), dtype=bool),
        "hand_centerlines": False,
        "seed": 0,
    }
    return RobustnessTrial(**(given | change))


def test_roll_and_slide_of_a_wrong_result_are_told() -> None:
    axis = surface_frame(TUBE).axes[:, 0]
    turn = transforms.Rotation.from_rotvec(np.deg2rad(40) * axis)
    error = transforms.compose(
        transforms.translation(6 * axis), transforms.rotate_about(turn, TARGETS.mean(axis=0))
    )
    still = dataclasses.replace(PERTURBATION, angle_max_deg=0.0, translation_max_mm=0.0)
    row = trial(lambda moving, fixed: result(error), still)((0, 0))
    assert row["roll_error_deg"] == pytest.approx(40, abs=1e-5)
    assert row["slide_error_mm"] == pytest.approx(6)
    assert row["rotation_error_deg"] == pytest.approx(40, abs=1e-5)
    assert not row["success_tre"]


def test_what_a_method_says_of_itself_is_in_the_row() -> None:
    shifts = np.tile(np.eye(4), (101, 1, 1))
    shifts[:, 0, 3] = np.linspace(0, 1, 101)
    said = result(
        IDENTITY,
        verdict="ambiguous",
        ambiguity_gap=1.2,
        weak_directions=("slide", "roll"),
        pose_samples=shifts,
    )
    row = trial(lambda moving, fixed: said)((0, 0))
    assert (row["verdict"], row["accepted"], row["ambiguity_gap"]) == ("ambiguous", False, 1.2)
    assert row["weak_directions"] == "slide,roll"
    assert (row["tre_low_mm"], row["tre_high_mm"]) == pytest.approx((0.05, 0.95))
    assert row["runtime_s"] == 0.25
    silent = trial(lambda moving, fixed: result(IDENTITY))((0, 0))
    assert (silent["verdict"], silent["accepted"]) == ("not judged", False)
    assert math.isnan(silent["tre_low_mm"]) and math.isnan(silent["ambiguity_gap"])


def test_a_method_that_takes_frames_gets_them_and_one_that_does_not_is_left_alone() -> None:
    told: list[np.ndarray] = []

    def with_frames(
        moving: np.ndarray, fixed: np.ndarray, moving_frame: np.ndarray | None = None
    ) -> RigidResult:
        assert moving_frame is not None and len(moving_frame) == len(moving)
        told.append(moving_frame)
        return result(IDENTITY)

    lossy = dataclasses.replace(PERTURBATION, missing_share=0.5, sweep_frames=20)
    row = trial(with_frames, lossy)((0, 1))
    assert row["error"] == "" and (row["missing_share"], row["missing"]) == (0.5, "contiguous")
    assert len(np.unique(told[0])) == 10
    assert trial(lambda moving, fixed: result(IDENTITY))((0, 0))["missing"] == ""


def test_centerlines_are_handed_over_where_asked_for() -> None:
    """The moving one lies where the truth brings it onto the fixed one."""
    found: dict[str, np.ndarray] = {}

    def with_lines(
        moving: np.ndarray,
        fixed: np.ndarray,
        *,
        moving_centerline_mm: np.ndarray | None = None,
        fixed_centerline_mm: np.ndarray | None = None,
    ) -> RigidResult:
        if moving_centerline_mm is not None and fixed_centerline_mm is not None:
            found.update(moving=moving_centerline_mm, fixed=fixed_centerline_mm)
        return result(IDENTITY)

    trial(with_lines)((0, 0))
    assert not found
    half = np.arange(len(TARGETS)) < 20
    task = trial(with_lines, covered=half, hand_centerlines=True)
    task((0, 2))
    truth = PERTURBATION(TUBE, TUBE, IDENTITY, Piece(), seed=0, trial=2).fixed_T_moving
    np.testing.assert_allclose(transforms.apply(truth, found["moving"]), TARGETS[:20], atol=1e-9)
    np.testing.assert_array_equal(found["fixed"], TARGETS)


def test_a_failure_has_no_number_that_looks_like_a_result() -> None:
    def lost(moving: np.ndarray, fixed: np.ndarray) -> RigidResult:
        raise RuntimeError("lost")

    row = trial(lost)((0, 0))
    assert row["error"] == "RuntimeError: lost"
    assert row["verdict"] == "failed" and not row["accepted"] and not row["converged"]
    assert {row[name] for name in ("rmse_mm", "tre_mm", "roll_error_deg", "slide_error_mm")} == {math.inf}
    assert math.isnan(row["tre_low_mm"]) and math.isnan(row["ambiguity_gap"])


def test_failed_and_measured_rows_have_the_same_columns() -> None:
    good, bad = trial(lambda moving, fixed: result(IDENTITY))((0, 0)), trial(lambda moving: None)((0, 0))
    assert list(good) == list(bad)


def test_angles_are_counted_in_bins_of_fifteen_degrees_where_there_are_none() -> None:
    half = dataclasses.replace(PERTURBATION, angle_max_deg=20.0)
    for number in range(5):
        row = trial(lambda moving, fixed: result(IDENTITY), half)((0, number))
        assert (row["angle_from_deg"], row["angle_to_deg"]) in ((0, 15), (15, 30))
        assert row["angle_from_deg"] <= row["angle_deg"] <= row["angle_to_deg"]


def test_a_whole_vessel_has_no_place() -> None:
    def told(moving: np.ndarray, fixed: np.ndarray) -> RigidResult:
        return result(IDENTITY)

    assert trial(told, piece=Piece(1.0, "end"))((0, 0))["place"] == "whole"
    assert trial(told, piece=Piece(0.5, "end"))((0, 0))["place"] == "end"


def test_a_trial_is_the_same_alone_and_after_others() -> None:
    def nudged(moving: np.ndarray, fixed: np.ndarray) -> RigidResult:
        return result(transforms.translation(moving[0] - fixed[0]))

    kinds = tuple(
        Condition("rotation", math.nan, dataclasses.replace(PERTURBATION, rotation=kind), 3)
        for kind in ("any", "roll")
    )
    after = [trial(nudged, conditions=kinds)((number, place)) for number in (0, 1) for place in range(3)]
    alone = trial(nudged, conditions=kinds)((1, 2))
    assert {name: value for name, value in alone.items() if value == value} == {
        name: value for name, value in after[-1].items() if value == value
    }
