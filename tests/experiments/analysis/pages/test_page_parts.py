"""Cases that pages are made from, and the scripts that make the pages: thin, and plain about what is missing."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from experiments.analysis.pages.page_parts import listed, read_cases
from experiments.errors import InputError

# Scripts that make pages, with what they take before the folder.
SCRIPTS = {
    "robustness_results": (),
    "rigid_benchmark": (),
    "segmentation_results": ("usgra",),
    "consolidation_results": ("usgra",),
    "consistency": (),
}


def test_cases_of_a_folder_and_of_a_subset_are_read(tmp_path: Path) -> None:
    cases = pd.DataFrame({"case": ["a", "b"], "tre_mm": [0.5, float("inf")]})
    (tmp_path / "test").mkdir()
    cases.to_parquet(tmp_path / "cases.parquet")
    cases.iloc[:1].to_parquet(tmp_path / "test" / "cases.parquet")
    pd.testing.assert_frame_equal(read_cases(tmp_path, "x wrote"), cases)
    assert len(read_cases(tmp_path, "x wrote", "test")) == 1


def test_a_folder_without_cases_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected the folder that study=x wrote, found none"):
        read_cases(tmp_path, "study=x wrote")


def test_findings_are_a_list() -> None:
    assert listed(("One.", "Two.")) == "- One.\n- Two."
    assert listed(()) == ""


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_has_no_logic_of_its_own(name: str, repository: Path) -> None:
    text = (repository / "scripts" / f"{name}.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    assert [node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)] == ["main"]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_refuses_an_empty_folder_in_one_line(name: str, repository: Path, tmp_path: Path) -> None:
    script = [sys.executable, str(repository / "scripts" / f"{name}.py"), *SCRIPTS[name], str(tmp_path)]
    done = subprocess.run(script, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1].startswith(f"{tmp_path}: expected ")
    assert not list(tmp_path.iterdir())
