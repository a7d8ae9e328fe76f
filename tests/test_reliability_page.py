"""results/reliability.md: each of the two commands that write it keeps what the other wrote."""

from __future__ import annotations

import collections
import subprocess
import sys
from pathlib import Path

import fuzz_readers
import pytest
from reliability_page import COLUMNS, damaged_part, damaged_rows, faults_part, with_damaged, with_faults

ROOT = Path(__file__).resolve().parents[1]
FAULTS = "# Reliability\n\n| fault | attempts |\n|---|---:|\n| SIGKILL, training | 12 |\n"


def row(**counts: int) -> dict[str, str]:
    found = {name.replace("_", " "): number for name, number in counts.items()}
    return fuzz_readers.row(collections.Counter(found), count=100, seed=0, commit="abc")


def test_rows_come_back_as_they_were_written() -> None:
    rows = {"PLY, text": row(accepted=40, refused=59, foreign=1), "OBJ": row(refused=99, crashed=1)}
    page = with_damaged(FAULTS, rows)
    assert damaged_rows(page) == rows
    assert page.startswith(FAULTS)
    assert "| **all** | **200** | **40** | **158** | **1** | **1** | **0** | **0** | **0** |" in page


def test_one_reader_is_renewed_and_the_others_stay_in_their_order() -> None:
    page = with_damaged(FAULTS, {"PLY, text": row(accepted=40, refused=60), "OBJ": row(refused=100)})
    renewed = with_damaged(page, {"PLY, text": row(accepted=41, refused=59)})
    assert list(damaged_rows(renewed)) == ["PLY, text", "OBJ"]
    assert damaged_rows(renewed)["PLY, text"]["accepted"] == "41"
    assert damaged_rows(renewed)["OBJ"]["refused"] == "100"
    assert faults_part(renewed) == faults_part(page)


def test_faults_are_renewed_and_the_damaged_files_stay() -> None:
    page = with_damaged(FAULTS, {"OBJ": row(refused=100)})
    renewed = with_faults(page, FAULTS.replace("12", "13"))
    assert "| 13 |" in renewed and "| 12 |" not in renewed
    assert damaged_part(renewed) == damaged_part(page) != ""
    assert with_faults("", FAULTS) == FAULTS


@pytest.mark.parametrize(
    "text", ["", FAULTS, "## Damaged files\n\n| reader | other columns |\n|---|---|\n| OBJ | 1 |\n"]
)
def test_a_page_without_such_rows_has_none(text: str) -> None:
    assert damaged_rows(text) == {}


def test_the_command_writes_a_row_for_each_reader_that_was_asked_for(tmp_path: Path) -> None:
    page = tmp_path / "results" / "page.md"
    command = [
        sys.executable,
        "scripts/fuzz_readers.py",
        "--count",
        "20",
        "--reader",
        "XYZ",
        "--out",
        str(page),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (found,) = damaged_rows(page.read_text(encoding="utf-8")).items()
    assert found[0] == "XYZ"
    assert int(found[1]["accepted"]) + int(found[1]["refused"]) == int(found[1]["files"]) == 20
    assert set(found[1]) == set(COLUMNS)
