"""The page of the frozen benchmark, letter by letter from rows written by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.analysis.pages import rigid_benchmark
from experiments.analysis.pages.rigid_benchmark import HEAD

NAN = math.nan


def row(anatomy: str, kind: str, tre_mm: float, symmetric: bool = False, **change: Any) -> dict[str, Any]:
    made = {
        "method": "mine", "case": f"{anatomy}_{kind}", "anatomy": anatomy, "kind": kind, "symmetric": symmetric,
        "rmse_mm": 0.2, "tre_mm": tre_mm, "tre_max_mm": tre_mm, "tre_symmetric_mm": tre_mm,
        "rotation_error_deg": 0.0, "translation_error_mm": tre_mm, "success": True, "success_tre": tre_mm <= 2,
        "success_tre_symmetric": tre_mm <= 2, "verdict": "accepted", "ambiguity_gap": 9.0, "tre_low_mm": 0.1,
        "tre_high_mm": 1.0, "covered_by_interval": float(tre_mm <= 1), "second_pose_gap": NAN,
        "second_tre_mm": NAN, "ambiguous_rightly": NAN, "runtime_s": 0.5, "error": "", "simulated": True,
        "block": "undeformed", "same_vessel": True, "tre_rigid_mm": tre_mm, "lowest_tre_mm": 0.0,
        "high_over_error": 1.0 / tre_mm, "place": "",
    }  # fmt: skip
    return made | change


TEST = pd.DataFrame([row(name, kind, 0.5) for name in "abc" for kind in ("whole", "piece")])
SYMMETRIC = pd.DataFrame([row("tube", kind, 7.0, symmetric=True) for kind in ("whole", "piece")])
OTHERS = {"same_vessel": False, "tre_rigid_mm": NAN, "lowest_tre_mm": NAN, "success": False}
BLOCKS = pd.DataFrame(
    [
        row("a", "bend", 1.5, block="deforming", lowest_tre_mm=1.0),
        row("b", "bend", 2.5, block="deforming", lowest_tre_mm=2.0),
        row("a", "other", NAN, block="wrong_vessel", **OTHERS),
        row("b", "other", NAN, block="wrong_vessel", verdict="ambiguous", **OTHERS),
    ]
)


def written(folder: Path, **subsets: pd.DataFrame) -> Path:
    for name, rows in subsets.items():
        (folder / name).mkdir(parents=True)
        rows.to_parquet(folder / name / "cases.parquet")
    return folder


PAGE = Path(__file__).with_name("rigid_benchmark_page.md")


def test_page_table_and_figure_of_both_subsets(tmp_path: Path) -> None:
    folder, out = written(tmp_path / "found", test=TEST, symmetric=SYMMETRIC), tmp_path / "results"
    assert rigid_benchmark.write_page(folder, out) == 8
    page = (out / "rigid_benchmark.md").read_text(encoding="utf-8")
    assert page.startswith(HEAD)
    assert page.removeprefix(HEAD) == "\n" + PAGE.read_text(encoding="utf-8")
    table = pd.read_csv(out / "rigid_benchmark.csv")
    assert table["tre_mm"].tolist() == [0.5] * 6 + [7.0] * 2
    assert {path.name for path in out.iterdir()} == {f"rigid_benchmark.{end}" for end in ("md", "csv", "png")}


def test_symmetric_shapes_may_be_missing(tmp_path: Path) -> None:
    folder = written(tmp_path / "found", test=TEST)
    assert rigid_benchmark.write_page(folder, tmp_path) == 6
    page = (tmp_path / "rigid_benchmark.md").read_text(encoding="utf-8")
    assert "## Test anatomies" in page
    assert "## Symmetric" not in page


def test_blocks_stand_beside_the_baseline_that_is_kept(tmp_path: Path) -> None:
    folder, out = written(tmp_path / "found", test=TEST, blocks=BLOCKS), tmp_path / "results"
    assert rigid_benchmark.write_page(folder, out) == 10
    page = (out / "rigid_benchmark.md").read_text(encoding="utf-8")
    assert "## Deforming tissue, other vessels, partial overlap and noise" in page
    assert "- Wrong vessel: mine accepts 50.0 %" in page
    assert "### judgements by block, simulated" in page
    assert "### not accepted" not in page.split("## Deforming")[1]
    assert "earlier version" not in page
    assert (out / "rigid_benchmark_blocks.png").is_file()
    before = BLOCKS.assign(method="before", verdict="accepted")
    before.to_csv(out / rigid_benchmark.BASELINE_FILE, index=False)
    assert rigid_benchmark.write_page(folder, out) == 10
    page = (out / "rigid_benchmark.md").read_text(encoding="utf-8")
    assert "`before` is an earlier version of the method" in page
    assert "- Wrong vessel: mine accepts 50.0 %" in page
    assert "- Wrong vessel: before accepts 100.0 %" in page
    assert "before gave no result" not in page
    assert "before" not in set(pd.read_csv(out / "rigid_benchmark.csv")["method"])
