"""The truth of a case as JSON comes back number by number, and a file that lacks something is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_cases import drawn_case

from registration.benchmark.symmetry import Screw, Symmetry, half_turn
from registration.benchmark.truth_files import read_truth, truth_as_json
from registration.errors import InputError

ALONG = np.array([0.0, 0.0, 1.0])
SYMMETRY = Symmetry((Screw(np.ones(3), ALONG, 4.5, 1.0, -2.0, 3.0),), (half_turn(np.zeros(3), ALONG),))


def test_all_of_it_comes_back(tmp_path: Path) -> None:
    _, truth = drawn_case(symmetry=SYMMETRY)
    truth.outlier[[3, 8]] = True
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(truth_as_json(truth)))
    found = read_truth(path)
    for name in ("fixed_T_moving", "targets_mm", "covered", "outlier"):
        np.testing.assert_array_equal(getattr(found, name), getattr(truth, name))
    for name in ("name", "anatomy", "kind", "place", "angle_deg", "translation_mm", "block", "same_vessel"):
        assert getattr(found, name) == getattr(truth, name)
    (screw,), (flip,) = found.symmetry.screws, found.symmetry.flips
    assert (screw.turn_deg, screw.shift_mm, screw.low, screw.high) == (4.5, 1.0, -2.0, 3.0)
    np.testing.assert_array_equal(screw.point_mm, np.ones(3))
    np.testing.assert_array_equal(flip, SYMMETRY.flips[0])


def test_displacements_come_back_and_another_vessel_has_no_pose(tmp_path: Path) -> None:
    path, truth = tmp_path / "truth.json", drawn_case()[1]
    soft = replace(truth, block="deforming", displacement_mm=np.random.default_rng(0).normal(size=(80, 3)))
    path.write_text(json.dumps(truth_as_json(soft)))
    assert read_truth(path).block == "deforming"
    np.testing.assert_array_equal(read_truth(path).displacement_mm, soft.displacement_mm)
    other = replace(truth, same_vessel=False, fixed_T_moving=np.full((4, 4), np.nan))
    path.write_text(json.dumps(truth_as_json(other), allow_nan=False))
    found = read_truth(path)
    assert not found.same_vessel and np.isnan(found.fixed_T_moving).all()
    # Files from before there were blocks lack all three.
    told = truth_as_json(truth)
    for name in ("block", "same_vessel", "displacement_mm"):
        del told[name]
    path.write_text(json.dumps(told))
    old = read_truth(path)
    assert (old.block, old.same_vessel, old.displacement_mm) == ("undeformed", True, None)


@pytest.mark.parametrize(
    "change, told",
    [
        ({"targets_mm": None}, "expected the truth of a benchmark case"),
        ({"targets_mm": []}, "received 0 targets"),
        ({"covered": [True]}, "80 targets with 1 marks"),
        ({"fixed_T_moving": [[1.0]]}, "expected the truth of a benchmark case"),
        ({"fixed_T_moving": (2 * np.eye(4)).tolist()}, "fixed_T_moving"),
        ({"displacement_mm": [[0.0, 0.0, 1.0]]}, "expected the truth of a benchmark case"),
        ({"same_vessel": False}, "a fixed_T_moving of another vessel"),
        ({"outliers": [900]}, "expected the truth of a benchmark case"),
        ({"symmetry": {"screws": []}}, "received none of 'flips'"),
    ],
)
def test_a_file_that_is_no_truth_is_named(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(truth_as_json(drawn_case()[1]) | change))
    with pytest.raises(InputError, match=told) as refusal:
        read_truth(path)
    assert str(path) in str(refusal.value)


def test_files_that_are_no_json_object_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    with pytest.raises(InputError, match="expected a file, received nothing there"):
        read_truth(path)
    path.write_text("{")
    with pytest.raises(InputError, match="expected JSON"):
        read_truth(path)
    path.write_text("[1]")
    with pytest.raises(InputError, match="expected a JSON object, received a list"):
        read_truth(path)
