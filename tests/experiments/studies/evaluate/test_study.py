"""study=evaluate: what it leaves behind, for masks and for transforms, and how it ends on bad input."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmark_cases import off_by, written_cases
from PIL import Image

from experiments.cli import main
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies.evaluate import study as evaluate

NAMES = {"tube_a": ("a", "whole"), "tube_b": ("b", "whole"), "tube_c": ("c", "piece80")}


def run(prediction: Path, reference: Path, workspace: Path, **change: Any) -> Outcome:
    workspace.mkdir(exist_ok=True)
    given: dict[str, Any] = {"spacing_mm": None, "targets": None} | change
    return evaluate.run(
        prediction=str(prediction),
        reference=str(reference),
        workspace=workspace,
        progress=Silent(),
        **given,
    )


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    for folder, left in (("truth", 10), ("given", 12)):
        (tmp_path / folder).mkdir()
        for name in ("a", "b"):
            picture = np.zeros((30, 30), dtype=np.uint8)
            picture[5:15, left : left + 10] = 255
            Image.fromarray(picture).save(tmp_path / folder / f"{name}.png")
    return tmp_path


@pytest.fixture
def transforms(tmp_path: Path) -> Path:
    made = written_cases(tmp_path / "subset", NAMES)
    (tmp_path / "mine").mkdir()
    for name, shift_mm, report in (
        ("tube_a", (1.0, 0.0, 0.0), {"verdict": "accepted", "predicted_tre_mm": {"low": 0.2, "high": 1.5}}),
        ("tube_b", (0.0, 30.0, 0.0), {"verdict": "ambiguous", "ambiguity_gap": 0.4}),
    ):
        pose = off_by(made[name][1], shift_mm).tolist()
        (tmp_path / "mine" / f"{name}.json").write_text(json.dumps({"fixed_T_moving": pose} | report))
    return tmp_path


def test_masks_leave_a_summary_and_a_row_a_case(masks: Path) -> None:
    (masks / "given" / "b.png").unlink()
    outcome = run(masks / "given", masks / "truth", masks / "out", spacing_mm=0.1)
    report = json.loads((masks / "out" / "evaluation.json").read_text())
    assert (report["kind"], report["cases"], report["missing"], report["spacing_mm"]) == (
        "masks",
        2,
        ["b"],
        [0.1, 0.1],
    )
    assert report["metrics"]["dsc_mean"] == pytest.approx(0.4)
    assert report["metrics"]["hd95_mm_n"] == 2
    rows = pd.read_csv(masks / "out" / "evaluation.csv")
    assert rows["case_id"].tolist() == ["a", "b"]
    assert rows["dsc"].tolist() == pytest.approx([0.8, 0.0])
    assert outcome.metrics["dsc_mean"] == pytest.approx(0.4)
    assert outcome.tags == {"evaluated": "masks"}
    assert [data.source for data in outcome.inputs] == [str(masks / "given"), str(masks / "truth")]


def test_transforms_leave_a_summary_and_a_row_a_case(transforms: Path) -> None:
    outcome = run(transforms / "mine", transforms / "subset", transforms / "out")
    report = json.loads((transforms / "out" / "evaluation.json").read_text())
    assert (report["kind"], report["cases"], report["missing"]) == ("transforms", 3, ["tube_c"])
    # A case without a result makes the mean infinite, which JSON does not know; the rates count it.
    assert report["metrics"]["tre_mm_mean"] is None
    assert report["metrics"]["success_tre_rate"] == pytest.approx(1 / 3)
    assert report["metrics"]["acceptance_rate"] == pytest.approx(1 / 3)
    assert report["metrics"]["success_accepted_rate"] == 1.0
    assert report["metrics"]["interval_coverage_rate"] == 1.0
    assert report["metrics"]["cases_without_result"] == 1.0
    rows = pd.read_csv(transforms / "out" / "evaluation.csv").set_index("case")
    assert rows.loc["tube_a", "tre_mm"] == pytest.approx(1.0)
    assert rows.loc["tube_b", "tre_mm"] == pytest.approx(30.0)
    assert rows.loc["tube_c", "tre_mm"] == math.inf
    assert set(rows["method"]) == {"mine"}
    assert rows["simulated"].all()
    assert outcome.tags == {"evaluated": "transforms", "simulated": "true"}
    assert all(name.endswith(", simulated") for name in outcome.tables)
    said = " ".join(outcome.findings)
    assert "mine: 1 of 3 cases within 2 mm TRE" in said
    assert "1 of 3 cases have no file and count as failed (first: tube_c)" in said


def test_one_pose_against_one_truth(transforms: Path) -> None:
    truth = transforms / "subset" / "truth" / "tube_a.json"
    outcome = run(transforms / "mine" / "tube_a.json", truth, transforms / "out")
    assert outcome.metrics["tre_mm_mean"] == pytest.approx(1.0)
    assert outcome.metrics["success_tre_rate"] == 1.0
    report = json.loads((transforms / "out" / "evaluation.json").read_text())
    assert report["cases"] == 1


def test_settings_of_the_other_kind_are_refused(masks: Path, transforms: Path) -> None:
    with pytest.raises(InputError, match=r"spacing_mm: expected none with transforms, received 0\.1"):
        run(transforms / "mine", transforms / "subset", transforms / "out", spacing_mm=0.1)
    with pytest.raises(InputError, match="label: expected none with transforms, received 2"):
        run(transforms / "mine", transforms / "subset", transforms / "out", label=2)
    with pytest.raises(InputError, match="targets: expected none with masks"):
        run(masks / "given", masks / "truth", masks / "out", targets="line.csv")
    with pytest.raises(InputError, match=r"reference: expected a file or folder, received .*nowhere"):
        run(masks / "given", masks / "nowhere", masks / "out")


def test_references_without_any_vessel_are_refused(masks: Path) -> None:
    for name in ("a", "b"):
        Image.fromarray(np.zeros((30, 30), dtype=np.uint8)).save(masks / "truth" / f"{name}.png")
    with pytest.raises(InputError, match="reference: expected masks with a vessel, received 2 empty ones"):
        run(masks / "given", masks / "truth", masks / "out")


def test_a_label_from_the_command_line(home: Path, masks: Path) -> None:
    for folder in ("given", "truth"):
        for path in (masks / folder).iterdir():
            labels = (np.asarray(Image.open(path)) > 0).astype(np.uint8) * 2
            labels[0] = 1
            Image.fromarray(labels).save(path)
    words = ["study=evaluate", f"prediction={masks / 'given'}", f"reference={masks / 'truth'}"]
    assert main([*words, f"out={home / 'none'}"]) == 2
    assert main([*words, "label=2", f"out={home / 'two'}"]) == 0
    report = json.loads((home / "two" / "evaluation.json").read_text())
    assert report["labels"] == {"reference": [2], "prediction": [2]}


def test_from_the_command_line(home: Path, masks: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["study=evaluate", f"prediction={masks / 'given'}", f"reference={masks / 'truth'}"]
    assert main([*words, f"out={home / 'result'}"]) == 0
    assert {"evaluation.json", "evaluation.csv"} <= {path.name for path in (home / "result").iterdir()}
    capsys.readouterr()
    Image.fromarray(np.zeros((8, 8), dtype=np.uint8)).save(masks / "given" / "b.png")
    assert main([*words, f"out={home / 'broken'}"]) == 2
    report = capsys.readouterr().err.strip().splitlines()
    assert "expected the size of its reference" in report[-1]
    assert not (home / "broken" / "evaluation.json").exists()
