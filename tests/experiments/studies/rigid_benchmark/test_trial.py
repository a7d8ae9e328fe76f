"""One case solved: the file that is left, and the row that is the same as the file's."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_cases import drawn_case, off_by, written_cases

from experiments.analysis.registration.pose_scores import read_result, score_result
from experiments.studies.rigid_benchmark.trial import BenchmarkTrial
from registration import transforms
from registration.benchmark.case_files import read_case, truth_file, write_case
from registration.benchmark.cases import CaseTruth
from registration.benchmark.truth_files import read_truth
from registration.rigid.result import RigidResult


@dataclass(frozen=True)
class Told:
    """A method that returns a fixed pose, or raises; it predicts an error of 0 to 2 mm by shifts along x."""

    pose: np.ndarray
    error: str = ""

    def __call__(
        self,
        moving_mm: np.ndarray,
        fixed_mm: np.ndarray,
        initial: np.ndarray | None = None,
        *,
        moving_frame: np.ndarray | None = None,
    ) -> RigidResult:
        assert initial is None
        assert moving_frame is not None and len(moving_frame) == len(moving_mm)
        assert len(fixed_mm) == 900
        if self.error:
            raise RuntimeError(self.error)
        samples = np.tile(np.eye(4), (201, 1, 1))
        samples[:, 0, 3] = np.linspace(0, 2, 201)
        return RigidResult(
            self.pose, 0.1, 0.1, 1.0, 3, True, (), 0.25, ambiguity_gap=math.inf, pose_samples=samples
        )


@pytest.fixture
def truth(tmp_path: Path) -> CaseTruth:
    written_cases(tmp_path, {"tube_a": ("a", "whole")})
    (tmp_path / "out").mkdir()
    return read_truth(truth_file(tmp_path, "tube_a"))


def test_the_result_is_a_file_with_the_keys_of_a_registration(tmp_path: Path, truth: CaseTruth) -> None:
    method = Told(off_by(truth, (1.5, 0.0, 0.0)))
    row = BenchmarkTrial("told", method, tmp_path, tmp_path / "out")("tube_a")
    told = json.loads((tmp_path / "out" / "tube_a.json").read_text())
    np.testing.assert_array_equal(told["fixed_T_moving"], method.pose)
    assert (told["case"], told["rigid"], told["verdict"]) == ("tube_a", "told", "not judged")
    assert told["ambiguity_gap"] == "inf"
    # Shifts up to 2 mm, evenly: 5 and 95 % of them.
    assert told["predicted_tre_mm"] == {
        "low": pytest.approx(0.1),
        "high": pytest.approx(1.9),
        "level": 0.9,
        "includes_deformation": False,
    }
    assert row["method"] == "told"
    assert row["tre_mm"] == pytest.approx(1.5)
    assert row["covered_by_interval"] == 1.0
    assert row["ambiguity_gap"] == math.inf
    assert row["runtime_s"] == 0.25


def test_the_row_is_that_of_the_file(tmp_path: Path, truth: CaseTruth) -> None:
    turned = transforms.compose(transforms.translation((0.3, -0.2, 0.1)), truth.fixed_T_moving)
    row = BenchmarkTrial("told", Told(turned), tmp_path, tmp_path / "out")("tube_a")
    again = score_result(read_result(tmp_path / "out" / "tube_a.json"), truth, read_case(tmp_path / "tube_a"))
    left = {key: value for key, value in row.items() if key != "method"}
    assert list(left) == list(again)
    for key, value in left.items():
        assert value == again[key] or (math.isnan(value) and math.isnan(again[key])), key


def test_what_a_case_knows_is_given_to_the_method(tmp_path: Path) -> None:
    case, truth = drawn_case("tube_a", "a", "whole")
    line_mm = np.arange(12.0).reshape(4, 3)
    given = replace(
        case, initial=truth.fixed_T_moving, moving_centerline_mm=line_mm, fixed_centerline_mm=line_mm + 1
    )
    write_case(tmp_path, given, truth)
    seen: dict[str, Any] = {}

    def method(moving_mm: Any, fixed_mm: Any, initial: Any, **known: Any) -> RigidResult:
        seen.update(known, initial=initial)
        return RigidResult(initial, 0.1, 0.1, 1.0, 3, True, (), 0.25)

    (tmp_path / "out").mkdir()
    row = BenchmarkTrial("told", method, tmp_path, tmp_path / "out")("tube_a")
    assert row["tre_mm"] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(seen["initial"], truth.fixed_T_moving)
    np.testing.assert_array_equal(seen["moving_centerline_mm"], line_mm)
    np.testing.assert_array_equal(seen["fixed_centerline_mm"], line_mm + 1)


@pytest.mark.parametrize(
    "method, error",
    [(Told(np.eye(4), "lost the vessel"), "RuntimeError: lost"), (Told(2 * np.eye(4)), "InputError: ")],
    ids=["raises", "no pose"],
)
def test_a_method_that_fails_leaves_a_failed_row_and_a_file_that_says_so(
    tmp_path: Path, truth: CaseTruth, method: Any, error: str
) -> None:
    row = BenchmarkTrial("told", method, tmp_path, tmp_path / "out")("tube_a")
    assert row["verdict"] == "failed"
    assert row["error"].startswith(error)
    assert row["tre_mm"] == math.inf
    assert row["runtime_s"] >= 0
    assert json.loads((tmp_path / "out" / "tube_a.json").read_text())["fixed_T_moving"] is None
