"""Which transform belongs to which truth, and what is said of those that belong to none."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from benchmark_cases import drawn_case, off_by, written_cases

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies.evaluate.transforms import (
    are_transforms,
    pair_transforms,
    read_reference,
    target_notes,
    transform_rows,
)
from registration.benchmark.case_files import write_case
from registration.geometry.shapes import Centerline, Polyline
from registration.io.centerlines import write_centerline
from registration.io.transforms import read_transform, write_transform

NAMES = {"tube_a": ("a", "whole"), "tube_b": ("b", "whole"), "tube_c": ("c", "piece80")}


@pytest.fixture
def subset(tmp_path: Path) -> Path:
    """Three cases; the results to two of them, wrong by 1 and 5 mm, and one to no case, in ``results``."""
    made = written_cases(tmp_path / "subset", NAMES)
    results = tmp_path / "results"
    results.mkdir()
    first, second = made["tube_a"][1], made["tube_b"][1]
    (results / "tube_a.json").write_text(
        json.dumps({"fixed_T_moving": off_by(first, (1.0, 0.0, 0.0)).tolist()})
    )
    write_transform(results / "tube_b.h5", off_by(second, (3.0, 0.0, 4.0)))
    write_transform(results / "tube_z.tfm", np.eye(4))
    return tmp_path


@pytest.mark.parametrize("reference", ["subset", "subset/truth"])
def test_results_are_paired_by_name_and_a_missing_one_has_failed(subset: Path, reference: str) -> None:
    pairs = pair_transforms(subset / "results", subset / reference, None)
    assert pairs.unused == ("tube_z",)
    rows = {row["case"]: row for row in transform_rows(pairs, Silent())}
    assert list(rows) == sorted(NAMES)
    assert rows["tube_a"]["tre_mm"] == pytest.approx(1.0)
    assert rows["tube_b"]["tre_mm"] == pytest.approx(5.0)
    assert rows["tube_c"]["tre_mm"] == math.inf
    assert rows["tube_c"]["error"] == "no file for this case"
    assert rows["tube_c"]["verdict"] == "failed"
    assert math.isfinite(rows["tube_a"]["rmse_mm"])


def test_names_that_look_alike_belong_together(subset: Path) -> None:
    results = subset / "results"
    truth = subset / "subset" / "truth"
    truth.rename(subset / "moved")
    (subset / "moved" / "tube_a.json").rename(subset / "moved" / "tub\u00e9.json")
    (results / "tube_a.json").rename(results / "tube\u0301.json")
    pairs = pair_transforms(results, subset / "moved", None)
    rows = list(transform_rows(pairs, Silent()))
    assert [row["tre_mm"] for row in rows].count(math.inf) == 1 and pairs.unused == ("tube_z",)


def test_without_the_cases_there_is_no_residual(subset: Path) -> None:
    (subset / "subset" / "truth").rename(subset / "moved")
    pairs = pair_transforms(subset / "results", subset / "moved", None)
    rows = list(transform_rows(pairs, Silent()))
    assert rows[0]["tre_mm"] == pytest.approx(1.0)
    assert math.isnan(rows[0]["rmse_mm"])


def test_one_file_goes_with_one_truth_whatever_their_names(subset: Path) -> None:
    truth = subset / "subset" / "truth" / "tube_b.json"
    pairs = pair_transforms(subset / "results" / "tube_b.h5", truth, None)
    (row,) = transform_rows(pairs, Silent())
    assert row["tre_mm"] == pytest.approx(5.0)


@pytest.mark.parametrize("suffix", [".mat", ".txt"])
def test_transforms_of_other_programs_are_scored_in_their_direction(subset: Path, suffix: str) -> None:
    """A .mat of ITK maps fixed to moving, four rows of text are fixed_T_moving itself."""
    pose = read_transform(subset / "results" / "tube_b.h5")
    if suffix == ".txt":
        np.savetxt(subset / f"pose{suffix}", pose)
    else:
        itk = SimpleITK.ReadTransform(str(subset / "results" / "tube_b.h5"))
        SimpleITK.WriteTransform(itk, str(subset / f"pose{suffix}"))
    truth = subset / "subset" / "truth" / "tube_b.json"
    (row,) = transform_rows(pair_transforms(subset / f"pose{suffix}", truth, None), Silent())
    assert row["tre_mm"] == pytest.approx(5.0)


def test_a_reference_that_is_a_bare_pose_needs_targets(subset: Path, tmp_path: Path) -> None:
    write_transform(tmp_path / "truth.tfm", np.eye(4))
    turned = np.eye(4)
    turned[:3, 3] = [0.0, 0.0, 2.5]
    write_transform(tmp_path / "pose.tfm", turned)
    line = Polyline(np.outer(np.arange(5.0), [1.0, 0, 0]), np.ones(5))
    write_centerline(tmp_path / "line.csv", Centerline((line,)))
    write_centerline(tmp_path / "line.vtp", Centerline((line,)))
    for targets in ("line.csv", "line.vtp"):
        pairs = pair_transforms(tmp_path / "pose.tfm", tmp_path / "truth.tfm", str(tmp_path / targets))
        (row,) = transform_rows(pairs, Silent())
        assert row["tre_mm"] == pytest.approx(2.5)
        assert row["case"] == "truth"
        assert not row["simulated"]
    with pytest.raises(InputError, match=r"targets: expected a centerline \(.csv, .vtp\)"):
        read_reference(tmp_path / "truth.tfm", None)
    with pytest.raises(InputError, match=r"targets: .*nothing\.csv"):
        pair_transforms(tmp_path / "pose.tfm", tmp_path / "truth.tfm", str(tmp_path / "nothing.csv"))


def test_against_another_vessel_nothing_is_right(tmp_path: Path) -> None:
    case, truth = drawn_case("tube_a", "a", "other_whole")
    other = replace(truth, block="wrong_vessel", same_vessel=False, fixed_T_moving=np.full((4, 4), np.nan))
    write_case(tmp_path / "subset", case, other)
    (tmp_path / "results").mkdir()
    told = {"fixed_T_moving": truth.fixed_T_moving.tolist(), "verdict": "accepted"}
    (tmp_path / "results" / "tube_a.json").write_text(
        json.dumps(told | {"predicted_tre_mm": {"low": 0.1, "high": 0.5}})
    )
    pairs = pair_transforms(tmp_path / "results", tmp_path / "subset", None)
    (row,) = transform_rows(pairs, Silent())
    assert row["block"] == "wrong_vessel" and not row["same_vessel"] and not row["success_tre_symmetric"]
    assert row["verdict"] == "accepted" and row["rmse_mm"] < 1e-3
    for name in ("tre_mm", "covered_by_interval", "second_pose_gap", "lowest_tre_mm"):
        assert math.isnan(row[name])
    assert len(target_notes(pairs, None)) == 1


def test_masks_are_no_transforms(tmp_path: Path, subset: Path) -> None:
    folder = tmp_path / "masks"
    folder.mkdir()
    (folder / "segmentation.json").write_text("{}")
    (folder / "a.png").write_bytes(b"")
    assert not are_transforms(folder)
    assert not are_transforms(folder / "a.png")
    assert are_transforms(subset / "subset")
    assert are_transforms(subset / "subset" / "truth")
    assert are_transforms(subset / "results" / "tube_b.h5")


def test_what_does_not_belong_together_is_refused(subset: Path) -> None:
    with pytest.raises(InputError, match="prediction: expected a folder, as reference is, received a file"):
        pair_transforms(subset / "results" / "tube_a.json", subset / "subset", None)
    other = subset / "other"
    other.mkdir()
    with pytest.raises(InputError, match=r"prediction: expected transforms .* received none"):
        pair_transforms(other, subset / "subset", None)
    write_transform(other / "nobody.tfm", np.eye(4))
    with pytest.raises(InputError, match=r"expected files named after the cases \(tube_a.json"):
        pair_transforms(other, subset / "subset", None)
    write_transform(subset / "results" / "tube_a.tfm", np.eye(4))
    with pytest.raises(
        InputError, match=r"expected one transform of each name .* tube_a.json and tube_a.tfm"
    ):
        pair_transforms(subset / "results", subset / "subset", None)


def test_a_case_that_is_broken_names_the_reference(subset: Path) -> None:
    (subset / "subset" / "tube_b" / "moving.ply").unlink()
    pairs = pair_transforms(subset / "results", subset / "subset", None)
    with pytest.raises(InputError, match=r"reference: .*tube_b/moving.ply"):
        list(transform_rows(pairs, Silent()))


def simulated_truth(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """A truth.json as a simulated sweep has it: the pose, and targets along a line in the ct frame."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    pose[:3, 3] = [200.0, -50.0, 30.0]
    targets_mm = np.array([10.0, 0.0, 0.0]) + np.outer(np.arange(20.0), [0.0, 1.0, 0.1])
    report = {"fixed_T_moving": pose.tolist(), "targets_mm": targets_mm.tolist(), "targets_frame": "ct"}
    folder.mkdir(exist_ok=True)
    (folder / "truth.json").write_text(json.dumps({**report, "fixed_frame": "ct", "simulated": True}))
    return pose, targets_mm


def registered(folder: Path, pose: np.ndarray) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "registration.json"
    path.write_text(json.dumps({"fixed_T_moving": pose.tolist(), "verdict": "accepted"}))
    return path


@pytest.mark.parametrize("as_folders", [True, False])
def test_one_registration_is_scored_against_the_truth_of_a_simulated_sweep(
    as_folders: bool, tmp_path: Path
) -> None:
    pose, targets_mm = simulated_truth(tmp_path / "simulated")
    shifted = pose.copy()
    shifted[:3, 3] += [0.0, 3.0, 4.0]
    result = registered(tmp_path / "registered", shifted)
    reference = tmp_path / "simulated" / "truth.json"
    assert are_transforms(reference) and are_transforms(reference.parent)
    given = (result.parent, reference.parent) if as_folders else (result, reference)
    pairs = pair_transforms(*given, None)
    (row,) = transform_rows(pairs, Silent())
    assert row["tre_mm"] == pytest.approx(5.0) and row["simulated"]
    assert target_notes(pairs, None) == [
        "Errors are measured at 20 targets in the frame of the fixed side (ct: mm in LPS)."
    ]
    np.testing.assert_allclose(read_reference(reference, None).targets_mm, targets_mm)


def test_an_inverted_result_is_noticed(tmp_path: Path) -> None:
    pose, _ = simulated_truth(tmp_path / "simulated")
    result = registered(tmp_path / "registered", np.linalg.inv(pose))
    pairs = pair_transforms(result, tmp_path / "simulated" / "truth.json", None)
    assert "were moving and fixed swapped?" in target_notes(pairs, None)[1]


def test_targets_of_the_moving_frame_are_refused(tmp_path: Path) -> None:
    pose, targets_mm = simulated_truth(tmp_path / "simulated")
    result = registered(tmp_path / "registered", pose)
    inverse = np.linalg.inv(pose)
    for name, points_mm in (("ct", targets_mm), ("world", targets_mm @ inverse[:3, :3].T + inverse[:3, 3])):
        line = Polyline(points_mm, np.ones(len(points_mm)))
        write_centerline(tmp_path / f"{name}.csv", Centerline((line,)))
    reference = tmp_path / "simulated" / "truth.json"
    pairs = pair_transforms(result, reference, str(tmp_path / "ct.csv"))
    assert next(transform_rows(pairs, Silent()))["tre_mm"] == pytest.approx(0.0, abs=1e-9)
    assert target_notes(pairs, str(tmp_path / "ct.csv"))[0].startswith("Errors are measured at ")
    pairs = pair_transforms(result, reference, str(tmp_path / "world.csv"))
    with pytest.raises(
        InputError, match=r"in the frame of the fixed side \(ct\), received points of the moving frame"
    ):
        next(transform_rows(pairs, Silent()))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"targets_mm": [[0, 1]]}, r"expected targets_mm as points \(t, 3\)"),
        ({"targets_mm": "none"}, r"expected targets_mm as points \(t, 3\)"),
        ({"targets_frame": "world"}, r"in the frame of the fixed side \(ct\), received world"),
    ],
)
def test_targets_that_can_not_be_used_are_refused(changes: dict, sentence: str, tmp_path: Path) -> None:
    simulated_truth(tmp_path)
    report = json.loads((tmp_path / "truth.json").read_text())
    (tmp_path / "truth.json").write_text(json.dumps({**report, **changes}))
    with pytest.raises(InputError, match=sentence):
        read_reference(tmp_path / "truth.json", None)


def test_a_pose_in_json_without_targets_needs_them(tmp_path: Path) -> None:
    reference = registered(tmp_path, np.eye(4))
    with pytest.raises(
        InputError, match=r"targets: expected a centerline .* in mm in the frame of its fixed side"
    ):
        read_reference(reference, None)
