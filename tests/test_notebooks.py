"""The notebooks of docs/ run from their first cell to their last, and show nothing longer than a screen."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import matplotlib
import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SCREEN_LINES, SCREEN_CHARACTERS = 40, 4000


def cells(path: Path) -> list[dict[str, Any]]:
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a kernel does: the value of its last line is what it shows."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "notebook", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "notebook", "eval"), names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_a_notebook_runs_and_shows_one_screen_a_cell(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CTUS_HOME", raising=False)
    matplotlib.use("Agg")
    names: dict[str, Any] = {}
    shown = [
        repr(run_cell("".join(cell["source"]), names)) for cell in cells(path) if cell["cell_type"] == "code"
    ]
    assert shown
    for text in shown:
        assert len(text) <= SCREEN_CHARACTERS and len(text.splitlines()) <= SCREEN_LINES
    if path.stem == "sweep_to_model":
        # Simulated, so that the truth is known; the interval that was predicted holds it here.
        low_mm, high_mm = names["rigid"].tre_interval_mm(names["targets_mm"])
        assert low_mm < names["tre_mm"].mean() < high_mm < 3.0
        assert names["deformed"].verdict == "deformed"
    if path.stem == "folds_to_model":
        # What the explanation of averaging and the page in results/ say.
        dsc = names["scores"]["dsc"].round(3)
        for network, average, ensemble in (("unet", 0.595, 0.689), ("unet from carotid", 0.722, 0.714)):
            assert (dsc[network, "uniform"], dsc[network, "ensemble of folds"]) == (average, ensemble)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_a_notebook_is_kept_without_outputs(path: Path) -> None:
    for cell in cells(path):
        assert not cell.get("outputs") and cell.get("execution_count") is None


def test_a_cell_shows_the_value_of_its_last_line() -> None:
    names: dict[str, Any] = {}
    assert run_cell("a = 2\na + 1", names) == 3
    assert run_cell("b = a", names) is None
    assert names["b"] == 2
