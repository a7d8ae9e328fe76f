"""The end of the demonstration, of results that are known."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

from experiments.analysis.pages.demo import closing
from experiments.errors import InputError
from experiments.running.terminal import print_tables


def left(folder: Path, **registration: Any) -> Path:
    known = {
        "segmentation": {"dsc_mean": 0.9512, "hd95_mm_mean": 0.4},
        "pipeline": {
            "dsc_mean": 0.94,
            "hd95_mm_mean": 0.5,
            "rmse_mm": 0.3,
            "tre_mm": 1.2,
            "deformed_rmse_mm": 0.2,
        },
    }
    for name, metrics in known.items():
        (folder / name).mkdir(parents=True)
        (folder / name / "metrics.json").write_text(json.dumps(metrics))
    record = {
        "verdict": "accepted",
        "reason": "the next pose is worse by 4.0 standard errors",
        "predicted_tre_mm": {"low": 0.5, "high": 2.0},
        "deformable": None,
    } | registration
    (folder / "pipeline" / "registration.json").write_text(json.dumps(record))
    rows = [
        {
            "condition": f"angle_max_deg={angle}",
            "method": method,
            "success_tre": good,
            "rmse_mm": 0.3,
            "tre_mm": 0.5,
        }
        for angle in (45, 180)
        for method, count in (("single_icp", 7 if angle == 180 else 10), ("multistart", 10))
        for good in [True] * count + [False] * (10 - count)
    ]
    (folder / "robustness").mkdir()
    pd.DataFrame(rows).to_parquet(folder / "robustness" / "cases.parquet")
    return folder


def test_two_small_tables_and_a_sentence_for_each_step(tmp_path: Path) -> None:
    deformed = {"measured_tre_mm": 0.8, "predicted_tre_mm": {"low": 0.1, "high": None}}
    tables, sentences = closing(left(tmp_path, deformable=deformed))
    segmentation, registration = tables.values()
    assert segmentation["DSC"].tolist() == ["0.951", "0.940"]
    assert registration["TRE (mm)"].tolist() == ["1.20", "0.80", "0.50", "0.50", "0.50", "0.50"]
    assert registration["predicted TRE"].tolist() == ["0.50 to 2.00", "", "", "", "", ""]
    assert registration["success"].tolist() == ["", "", "10 of 10", "10 of 10", "7 of 10", "10 of 10"]
    assert len(sentences) == 3
    assert sentences[1].endswith(
        "1.20 mm and 0.80 mm after the deformable stage. "
        "Verdict: accepted, the next pose is worse by 4.0 standard errors."
    )
    assert sentences[2] == (
        "Turned by up to 180 degrees, within 2 mm of the truth: single_icp 7 of 10 (40 to 89 %), "
        "multistart 10 of 10 (72 to 100 %); one that finds the same pose from every start has the same row at all "
        "angles."
    )
    shown = io.StringIO()
    print_tables(tables, Console(file=shown, width=100))
    assert max(len(line.rstrip()) for line in shown.getvalue().splitlines()) <= 100


def test_without_a_deformable_stage_or_a_step_it_is_said(tmp_path: Path) -> None:
    _, sentences = closing(left(tmp_path / "a"))
    assert "deformable" not in sentences[1]
    with pytest.raises(InputError, match=r"metrics.json: expected what the demonstration wrote, found none"):
        closing(tmp_path / "b")


def test_the_error_at_the_targets_stands_beside_what_was_predicted_there(tmp_path: Path) -> None:
    deformed = {
        "measured_tre_mm": 0.8,
        "predicted_tre_mm": {"low": 0.1, "high": 1.7},
        "predicted_tre_at_targets_mm": {"low": 0.2, "high": 1.9},
    }
    tables, _ = closing(left(tmp_path, deformable=deformed))
    assert tables["Registration, simulated sweep"]["predicted TRE"][1] == "0.20 to 1.90"


def test_how_many_results_a_method_accepts_is_said(tmp_path: Path) -> None:
    path = left(tmp_path) / "robustness" / "cases.parquet"
    cases = pd.read_parquet(path)
    verdicts = ["ambiguous", "accepted"] * (len(cases) // 2)
    cases["verdict"] = [
        verdict if method == "multistart" else "not judged"
        for verdict, method in zip(verdicts, cases["method"], strict=True)
    ]
    cases.to_parquet(path)
    _, sentences = closing(tmp_path)
    assert sentences[2].endswith(
        "single_icp 7 of 10 (40 to 89 %), multistart 10 of 10 (72 to 100 %, 5 accepted by the method itself); one that "
        "finds the same pose from every start has the same row at all angles."
    )
