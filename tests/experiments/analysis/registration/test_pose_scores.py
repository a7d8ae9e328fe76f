"""Results as files hold them, and the rows they get."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_cases import drawn_case, off_by

from experiments.analysis.registration.pose_scores import PoseResult, plain_metrics, read_result, score_result
from experiments.errors import InputError
from registration.benchmark.symmetry import Screw, Symmetry
from registration.io.transforms import write_transform

CASE, TRUTH = drawn_case()
POSE = off_by(TRUTH, (0.0, 3.0, 0.0))


def written(path: Path, **found: Any) -> Path:
    path.write_text(json.dumps({"fixed_T_moving": POSE.tolist()} | found))
    return path


def test_a_bare_transform_is_an_accepted_result(tmp_path: Path) -> None:
    write_transform(tmp_path / "a.h5", POSE)
    write_transform(tmp_path / "a.tfm", POSE)
    for path in (tmp_path / "a.h5", tmp_path / "a.tfm", written(tmp_path / "a.json")):
        result = read_result(path)
        assert result.fixed_T_moving is not None
        np.testing.assert_allclose(result.fixed_T_moving, POSE, atol=1e-9)
        assert result.verdict == "not judged"
        assert math.isnan(result.tre_high_mm)
        assert math.isnan(result.ambiguity_gap)


def test_what_registration_json_says_is_read(tmp_path: Path) -> None:
    result = read_result(
        written(
            tmp_path / "a.json",
            verdict="ambiguous",
            ambiguity_gap=1.25,
            predicted_tre_mm={"low": 0.1, "high": 4.5, "level": 0.9},
            runtime_s=0.3,
            candidates=[{"fixed_T_moving": np.eye(4).tolist()}],
        )
    )
    assert (result.verdict, result.ambiguity_gap) == ("ambiguous", 1.25)
    assert (result.tre_low_mm, result.tre_high_mm, result.runtime_s) == (0.1, 4.5, 0.3)
    np.testing.assert_array_equal(result.candidates[0], np.eye(4))
    assert read_result(written(tmp_path / "b.json", ambiguity_gap="inf")).ambiguity_gap == math.inf


def test_null_is_no_result(tmp_path: Path) -> None:
    result = read_result(written(tmp_path / "a.json", fixed_T_moving=None, error="lost the vessel"))
    assert result.fixed_T_moving is None
    assert result.verdict == "failed"
    assert result.error == "lost the vessel"


@pytest.mark.parametrize(
    "found, expected",
    [
        (
            {"verdict": "sure"},
            "expected a verdict of accepted, ambiguous, failed, not judged, received 'sure'",
        ),
        ({"fixed_T_moving": [[1.0]]}, "expected fixed_T_moving as 4 rows of 4 numbers"),
        ({"fixed_T_moving": (2 * np.eye(4)).tolist()}, "fixed_T_moving"),
        ({"predicted_tre_mm": 3.0}, "expected numbers as registration.json has them"),
        ({"runtime_s": "quick"}, "expected numbers as registration.json has them"),
        ({"candidates": [{}]}, "expected numbers as registration.json has them"),
        ({"candidates": [{"fixed_T_moving": (2 * np.eye(4)).tolist()}]}, "received candidates: expected"),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, found: dict[str, Any], expected: str) -> None:
    path = written(tmp_path / "a.json", **found)
    with pytest.raises(InputError, match=expected) as refusal:
        read_result(path)
    assert "a.json" in str(refusal.value)
    assert str(refusal.value).startswith("prediction: ")


def test_files_that_hold_no_result_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="received none"):
        read_result(tmp_path / "nothing.json")
    (tmp_path / "a.json").write_text("{")
    with pytest.raises(InputError, match="expected JSON"):
        read_result(tmp_path / "a.json")
    (tmp_path / "a.json").write_text("[]")
    with pytest.raises(InputError, match="expected a JSON object, received a list"):
        read_result(tmp_path / "a.json")


def test_the_row_of_a_result_that_is_wrong_by_3_mm() -> None:
    row = score_result(PoseResult(POSE, tre_low_mm=2.5, tre_high_mm=3.5), TRUTH, None)
    assert row["tre_mm"] == pytest.approx(3.0)
    assert not row["success_tre"]
    assert row["covered_by_interval"] == 1.0
    assert (
        score_result(PoseResult(POSE, tre_low_mm=0.0, tre_high_mm=2.9), TRUTH, None)["covered_by_interval"]
        == 0.0
    )
    assert math.isnan(score_result(PoseResult(POSE), TRUTH, CASE)["covered_by_interval"])
    assert (row["case"], row["anatomy"], row["kind"], row["symmetric"]) == (
        "tube_whole",
        "tube",
        "whole",
        False,
    )
    assert row["covered_share"] == pytest.approx(50 / 80)
    # An accepted result of a method that does not judge itself is not compared with a second pose.
    assert math.isnan(score_result(PoseResult(POSE), TRUTH, CASE)["second_pose_gap"])


def test_a_doubted_result_is_compared_with_the_best_second_pose() -> None:
    rng = np.random.default_rng(0)
    noisy = replace(CASE, moving_mm=CASE.moving_mm + 0.1 * rng.normal(size=(300, 3)))
    row = score_result(PoseResult(TRUTH.fixed_T_moving, "ambiguous"), TRUTH, noisy)
    # The bent tube with its bulge has one pose alone: the doubt was not right.
    assert row["ambiguous_rightly"] == 0.0
    assert row["second_pose_gap"] > 1.645
    assert math.isnan(score_result(PoseResult(POSE, "ambiguous"), TRUTH, None)["ambiguous_rightly"])


def test_a_result_that_was_wrongly_accepted_is_compared_too_where_the_method_judges_itself() -> None:
    row = score_result(PoseResult(POSE, "accepted", tre_low_mm=0.0, tre_high_mm=1.0), TRUTH, CASE)
    assert not math.isnan(row["second_pose_gap"])
    assert math.isnan(row["ambiguous_rightly"])


def test_an_interval_is_held_against_the_error_up_to_symmetry() -> None:
    slide = Symmetry((Screw(np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.0, 1.0, -20.0, 20.0),))
    row = score_result(
        PoseResult(POSE, tre_low_mm=0.0, tre_high_mm=0.5), replace(TRUTH, symmetry=slide), None
    )
    assert row["tre_mm"] == pytest.approx(3.0)
    assert row["covered_by_interval"] == 1.0
    assert row["success_tre_symmetric"] and not row["success_tre"] and row["symmetric"]


def test_no_result_is_infinitely_wrong_and_says_why() -> None:
    row = score_result(PoseResult(None, "failed", error="lost the vessel"), TRUTH, None)
    assert row["tre_mm"] == math.inf
    assert row["error"] == "lost the vessel"
    assert not row["success"]


def test_json_has_null_for_what_is_not_finite() -> None:
    assert plain_metrics({"a": 1.0, "b": math.inf, "c": math.nan}) == {"a": 1.0, "b": None, "c": None}
