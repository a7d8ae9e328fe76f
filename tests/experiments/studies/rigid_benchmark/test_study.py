"""study=rigid_benchmark on small drawn cases: rows, results, workers, and the same numbers from study=evaluate."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmark_cases import drawn_case, written_cases

from experiments.analysis.registration.benchmark.cases import block_specs
from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.running.jobs import job_configs
from experiments.studies.evaluate import study as evaluate
from experiments.studies.rigid_benchmark import study as rigid_benchmark
from registration.benchmark.case_files import write_case
from registration.rigid.comparators import SingleStartICP
from registration.rigid.multi_start import MultiStartICP

ICP = SingleStartICP(max_iterations=10)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first three development cases, drawn by formula in place of the simulator's."""
    folder = tmp_path_factory.mktemp("benchmark")
    specs = block_specs("development")[:3]
    written_cases(folder / "development", {spec.name: (spec.anatomy, spec.kind) for spec in specs})
    return folder


def run(root: Path, workspace: Path, **change: Any) -> Outcome:
    workspace.mkdir(parents=True, exist_ok=True)
    given: dict[str, Any] = {
        "subset": "development", "blocks": ["undeformed"],
        "rigid": {"single_icp": ICP}, "cases": 3, "workers": 1, "root": str(root),
    }  # fmt: skip
    return rigid_benchmark.run(**(given | change), workspace=workspace, progress=Silent())


def test_multistart_solves_the_cases_and_leaves_a_result_each(root: Path, tmp_path: Path) -> None:
    outcome = run(root, tmp_path / "w", rigid={"multistart": MultiStartICP()})
    assert outcome.cases is not None
    assert outcome.cases["success_tre"].all()
    assert outcome.metrics["success_tre_rate"] == 1.0
    names = [spec.name for spec in block_specs("development")[:3]]
    assert outcome.cases["case"].tolist() == names
    assert sorted(path.stem for path in (tmp_path / "w" / "multistart").iterdir()) == sorted(names)
    assert outcome.cases["simulated"].all()
    assert set(outcome.cases["subset"]) == {"development"}
    assert outcome.tags["rigid"] == "multistart"
    assert (tmp_path / "w" / "rigid_benchmark.csv").is_file()


def test_cases_that_are_not_the_frozen_ones_are_said_plainly(root: Path, tmp_path: Path) -> None:
    outcome = run(root, tmp_path / "w")
    assert outcome.findings[-1].startswith("3 of 3 development cases in ")
    assert "are not the frozen ones" in outcome.findings[-1]
    assert outcome.tags["frozen"] == "false"


def test_rows_do_not_depend_on_the_number_of_workers(root: Path, tmp_path: Path) -> None:
    one, two = (run(root, tmp_path / str(workers), workers=workers).cases for workers in (1, 2))
    assert one is not None and two is not None
    pd.testing.assert_frame_equal(one.drop(columns="runtime_s"), two.drop(columns="runtime_s"))


def test_evaluate_gives_the_results_the_same_scores(root: Path, tmp_path: Path) -> None:
    own = run(root, tmp_path / "w").cases
    (tmp_path / "evaluated").mkdir()
    outcome = evaluate.run(
        prediction=str(tmp_path / "w" / "single_icp"),
        reference=str(root / "development"),
        spacing_mm=None,
        targets=None,
        workspace=tmp_path / "evaluated",
        progress=Silent(),
    )
    assert outcome.findings[-2].startswith("3 of 3 development cases in ")
    other = outcome.cases
    assert own is not None and other is not None
    columns = [column for column in other if column != "runtime_s"]
    one, two = (cases.sort_values("case", ignore_index=True)[columns] for cases in (own, other))
    pd.testing.assert_frame_equal(one, two)


def test_blocks_lie_apart_and_are_scored_together(root: Path, tmp_path: Path) -> None:
    wanted = block_specs("development", "wrong_vessel")[:2]
    folder = root / "development_wrong_vessel"
    for seed, spec in enumerate(wanted):
        case, truth = drawn_case(spec.name, spec.anatomy, spec.kind, seed)
        pose = np.full((4, 4), np.nan)
        write_case(folder, case, replace(truth, block="wrong_vessel", same_vessel=False, fixed_T_moving=pose))
    outcome = run(root, tmp_path / "w", blocks=["undeformed", "wrong_vessel"], cases=2)
    rows = outcome.cases
    assert rows is not None
    assert rows["block"].tolist() == ["undeformed"] * 2 + ["wrong_vessel"] * 2
    assert rows["tre_mm"].notna().tolist() == [True, True, False, False]
    assert outcome.tags["blocks"] == "undeformed, wrong_vessel"
    assert len(outcome.inputs) == 2
    results = tmp_path / "w" / "single_icp"
    assert {path.stem for path in (results / "wrong_vessel").iterdir()} == {spec.name for spec in wanted}
    assert "judgements by block, simulated" in outcome.tables
    (tmp_path / "evaluated").mkdir()
    scored = evaluate.run(
        prediction=str(results / "wrong_vessel"),
        reference=str(folder),
        spacing_mm=None,
        targets=None,
        workspace=tmp_path / "evaluated",
        progress=Silent(),
    )
    assert any("cannot refuse the 2 models of other vessels" in one for one in scored.findings)
    assert any(one.startswith("2 of 2 development_wrong_vessel cases in ") for one in scored.findings)


def test_methods_stand_beside_each_other_in_the_summary(root: Path, tmp_path: Path) -> None:
    first = run(root, tmp_path / "a", rigid={"multistart": MultiStartICP()})
    second = run(root, tmp_path / "b")
    results = [JobResult({}, one.metrics, one.cases, tmp_path) for one in (first, second)]
    outcome = rigid_benchmark.summarise(results)
    assert outcome.cases is not None and len(outcome.cases) == 6
    assert any("single_icp" in sentence and "alone" in sentence for sentence in outcome.findings)
    assert set(outcome.figures) == {"rigid_benchmark"}
    assert second.cases is not None
    other = JobResult({}, {}, second.cases.assign(subset="test"), tmp_path)
    named = rigid_benchmark.summarise([results[0], other]).cases
    assert named is not None
    assert set(named["method"]) == {"multistart, development", "single_icp, test"}
    choices = [{"rigid.single_icp.max_iterations": count} for count in ("20", "40")]
    twice = [JobResult({}, {}, second.cases, tmp_path, choices=choice) for choice in choices]
    apart = rigid_benchmark.summarise(twice).cases
    assert apart is not None
    assert set(apart["method"]) == {
        f"single_icp rigid.single_icp.max_iterations={count}" for count in (20, 40)
    }
    assert rigid_benchmark.summarise([]).findings == ("No job has cases to summarise.",)


def test_one_job_a_method() -> None:
    ((config, _),) = compose_sweep(["study=rigid_benchmark", "rigid=[multistart,single_icp]"])
    assert [list(job["rigid"]) for job, _ in job_configs(config)] == [["multistart"], ["single_icp"]]
    with pytest.raises(InputError, match="rigid: expected at least one method"):
        rigid_benchmark.jobs({"rigid": {}})


def test_settings_that_allow_no_case_are_refused(root: Path, tmp_path: Path) -> None:
    for change, told in (
        ({"subset": "all"}, "subset: expected one of development, test, symmetric"),
        ({"blocks": ["soft"]}, "blocks: expected some of undeformed, deforming"),
        ({"blocks": []}, "blocks: expected a list of at least one block"),
        ({"blocks": ["noise", "noise"]}, "blocks: expected a list of at least one block, each once"),
        ({"subset": "symmetric", "blocks": ["noise"]}, "blocks: expected some of undeformed with symmetric"),
        ({"workers": 0}, "workers: expected a whole number of at least 1"),
        ({"cases": 0}, "cases: expected a whole number of at least 1"),
        ({"rigid": {}}, "rigid: expected exactly one method"),
    ):
        with pytest.raises(InputError, match=told):
            run(root, tmp_path / "w", **change)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="root: expected a folder for the cases, received the file"):
        run(tmp_path / "file", tmp_path / "w")


def test_a_file_of_results_is_json_that_others_can_write(root: Path, tmp_path: Path) -> None:
    run(root, tmp_path / "w", cases=1)
    (path,) = (tmp_path / "w" / "single_icp").iterdir()
    told = json.loads(path.read_text())
    assert {"case", "rigid", "fixed_T_moving", "verdict", "predicted_tre_mm", "runtime_s"} <= set(told)
