"""Deformable methods in study=evaluate: a displacement beside each pose, and what is refused."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import pandas as pd
import pytest
from benchmark_cases import off_by
from deforming_cases import NAMES, deforming_case, sway, written_deforming_cases

from experiments.cli import main
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies.evaluate import study as evaluate
from experiments.studies.evaluate.displacements import displacement_beside
from registration import transforms
from registration.benchmark.deformable_entries import write_entry
from registration.benchmark.scoring import material_error_mm
from registration.cpd import CoherentPointDrift
from registration.io.displacement_fields import sample_grid, write_displacement_transform
from registration.metrics.surface_distance import rms


def scored(folder: Path, prediction: str = "mine", reference: str = "subset") -> Outcome:
    out = folder / "out"
    out.mkdir(exist_ok=True)
    return evaluate.run(
        prediction=str(folder / prediction),
        reference=str(folder / reference),
        spacing_mm=None,
        targets=None,
        workspace=out,
        progress=Silent(),
    )


@pytest.fixture
def entries(tmp_path: Path) -> Path:
    """Three cases; of each the true displacement, that of the second after a pose that is 1 mm off."""
    made = written_deforming_cases(tmp_path / "subset")
    (tmp_path / "mine").mkdir()
    for name, (case, truth) in made.items():
        pose = off_by(truth, (1.0, 0.0, 0.0)) if name == "tube_b" else truth.fixed_T_moving
        write_entry(tmp_path / "mine", name, pose, sway, case.fixed_mm)
    return tmp_path


def test_errors_are_given_before_and_after_the_displacement(entries: Path) -> None:
    outcome = scored(entries)
    rows = pd.read_csv(entries / "out" / "evaluation.csv").set_index("case")
    assert rows["tre_deformed_mm"].tolist() == pytest.approx([0.0, 1.0, 0.0], abs=0.01)
    assert (rows["tre_mm"] > 1.5).all() and (rows["jacobian_min"] > 0).all()
    metrics = outcome.metrics
    assert metrics["deformed_cases"] == 3 and metrics["folding_cases"] == 0
    assert metrics["deformed_covered_mm"] == pytest.approx(1 / 3, abs=0.01)
    assert metrics["deformed_covered_better_rate"] == 1.0
    assert metrics["deformed_covered_change_mm_high"] < 0
    report = json.loads((entries / "out" / "evaluation.json").read_text())
    assert report["metrics"]["deformed_uncovered_mm"] == pytest.approx(1 / 3, abs=0.01)
    table = outcome.tables["rigid and deformed"].set_index("targets")
    assert list(table.index) == ["all", "covered", "uncovered"] and table.loc["covered", "anatomies"] == 3
    said = " ".join(outcome.findings)
    assert "better in 3 of 3 cases" in said and "0 of 3 displacements fold." in said


def test_the_rigid_score_stays_as_it_is(entries: Path) -> None:
    with_them = scored(entries)
    for path in (entries / "mine").glob("*.nrrd"):
        path.unlink()
    without = scored(entries)
    assert not [name for name in without.cases if "deformed" in name]
    assert without.metrics == {name: with_them.metrics[name] for name in without.metrics}
    pd.testing.assert_frame_equal(without.cases, with_them.cases[list(without.cases)])


def test_our_own_method_scores_from_files_what_it_scores_in_memory(tmp_path: Path) -> None:
    case, truth = written_deforming_cases(tmp_path / "subset")["tube_a"]
    swept_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
    found = CoherentPointDrift()(case.fixed_mm, swept_mm)
    (tmp_path / "mine").mkdir()
    write_entry(tmp_path / "mine", "tube_a", truth.fixed_T_moving, found.displacement, case.fixed_mm)
    row = scored(tmp_path).cases.set_index("case").loc["tube_a"]
    errors_mm = material_error_mm(truth.fixed_T_moving, truth, found.displacement(truth.targets_mm))
    assert found.verdict == "deformed"
    assert row["tre_deformed_mm"] == pytest.approx(rms(errors_mm), abs=0.01)
    assert row["tre_deformed_covered_mm"] == pytest.approx(rms(errors_mm[truth.covered]), abs=0.01)
    assert row["tre_deformed_mm"] < row["tre_mm"]


def test_a_case_without_a_pose_has_failed_and_a_pose_far_off_is_not_compared(entries: Path) -> None:
    (entries / "mine" / "tube_a.json").write_text('{"fixed_T_moving": null, "error": "gave up"}')
    (entries / "mine" / "tube_a_displacement.nrrd").unlink()
    truth = deforming_case("tube_c", "c", 2)[1]
    far = off_by(truth, (20.0, 0.0, 0.0)).tolist()
    (entries / "mine" / "tube_c.json").write_text(json.dumps({"fixed_T_moving": far}))
    outcome = scored(entries)
    rows = outcome.cases.set_index("case")
    assert rows.loc["tube_a", "tre_deformed_mm"] == math.inf and math.isnan(
        rows.loc["tube_a", "jacobian_min"]
    )
    assert rows.loc["tube_c", "tre_deformed_mm"] == pytest.approx(20.0, abs=0.02)
    assert outcome.metrics["deformed_cases"] == 1 and outcome.metrics["deformed_left_out"] == 2
    assert "2 of 3 cases are not compared" in " ".join(outcome.findings)


def test_a_transform_of_itk_is_a_displacement_and_no_pose(entries: Path) -> None:
    mine = entries / "mine"
    fixed_mm = deforming_case("tube_a", "a")[0].fixed_mm
    low_mm, high_mm = fixed_mm.min(axis=0) - 3, fixed_mm.max(axis=0) + 3
    write_displacement_transform(
        mine / "tube_a_displacement.h5", sample_grid(sway, low_mm, high_mm, 1.5), "lps"
    )
    with pytest.raises(InputError, match=r"one displacement of each name .*tube_a_displacement\.h5 and"):
        scored(entries)
    (mine / "tube_a_displacement.nrrd").unlink()
    assert scored(entries).cases["tre_deformed_mm"].iloc[0] < 0.01


def test_what_can_not_be_scored_is_refused_and_named(entries: Path) -> None:
    mine = entries / "mine"
    (mine / "tube_b_displacement.nrrd").rename(entries / "kept.nrrd")
    with pytest.raises(
        InputError, match=r"tube_b_displacement\.nrrd: expected a displacement for every case"
    ):
        scored(entries)
    (mine / "tube_b_displacement.npz").write_bytes(b"")
    with pytest.raises(InputError, match=r"tube_b_displacement\.npz: expected a displacement on a grid"):
        scored(entries)
    (mine / "tube_b_displacement.npz").unlink()
    (mine / "tube_b_displacement.nrrd").write_bytes((entries / "kept.nrrd").read_bytes()[:2000])
    with pytest.raises(InputError, match=r"prediction: .*tube_b_displacement\.nrrd: expected .* cut short"):
        scored(entries)
    for path in mine.glob("*.nrrd"):
        path.rename(path.with_name(f"x{path.name}"))
    with pytest.raises(
        InputError, match=r"expected displacements named after cases with a pose \(tube_a_displ"
    ):
        scored(entries)


def test_a_displacement_of_no_case_is_named(entries: Path) -> None:
    shutil.copy(entries / "mine" / "tube_a_displacement.nrrd", entries / "mine" / "z_displacement.nrrd")
    assert "1 files belong to no case and are not scored (first: z_displacement)" in " ".join(
        scored(entries).findings
    )


def test_one_registration_is_scored_with_its_displacement_of_the_fixed_side(entries: Path) -> None:
    folder = entries / "registered"
    folder.mkdir()
    shutil.copy(entries / "mine" / "tube_a_displacement.nrrd", folder / "displacement.nrrd")
    told = json.loads((entries / "mine" / "tube_a.json").read_text())
    result = folder / "registration.json"
    for side, expected in (("moving", None), ("fixed", folder / "displacement.nrrd")):
        result.write_text(json.dumps(told | {"deformable": {"model_side": side}}))
        assert displacement_beside(result) == expected
    outcome = scored(entries, "registered", "subset/truth/tube_a.json")
    assert outcome.metrics["deformed_all_mm"] < 0.01
    assert math.isnan(outcome.metrics["deformed_all_change_mm_low"])  # one anatomy has no interval
    paths = evaluate.implicit_paths({"prediction": str(result), "reference": str(entries / "subset")})
    assert list(paths) == [folder / "displacement.nrrd"]


def test_a_reference_that_knows_no_material_scores_the_pose_alone(entries: Path) -> None:
    truth = deforming_case("tube_a", "a")[1]
    (entries / "truth.json").write_text(
        json.dumps({"fixed_T_moving": truth.fixed_T_moving.tolist(), "targets_mm": truth.targets_mm.tolist()})
    )
    outcome = scored(entries, "mine/tube_a.json", "truth.json")
    assert outcome.metrics["tre_mm_mean"] == pytest.approx(0.0, abs=1e-9)
    assert "tre_deformed_mm" not in outcome.cases
    assert "The displacement is not scored" in " ".join(outcome.findings)


def test_from_the_command_line(home: Path, entries: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["study=evaluate", f"prediction={entries / 'mine'}", f"reference={entries / 'subset'}"]
    assert main([*words, f"out={home / 'result'}"]) == 0
    assert "rigid and deformed" in capsys.readouterr().out
    assert len(NAMES) == len(pd.read_csv(home / "result" / "evaluation.csv"))
