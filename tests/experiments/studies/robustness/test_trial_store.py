"""Rows that are kept as they come: in order, whoever solves them, and never a broken one."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info

from experiments.studies.robustness.trial_store import KeptRows, solved_rows

KEYS = [(0, 0), (0, 1), (1, 0)]


def solve(key: tuple[int, int]) -> dict[str, Any]:
    return {"value": 10.0 * key[0] + key[1], "lost": math.inf}


@pytest.fixture
def kept(tmp_path: Path) -> KeptRows:
    return KeptRows(tmp_path / "cache" / "rows.jsonl")


def test_all_trials_are_solved_in_order_and_nothing_is_left(kept: KeptRows) -> None:
    rows = list(solved_rows(solve, KEYS, workers=1, kept=kept, resume=False))
    assert [row["value"] for row in rows] == [0, 1, 10]
    assert not kept.path.exists()


def test_rows_come_back_as_they_were(kept: KeptRows) -> None:
    kept.begin({})
    row = {
        "tre_mm": 0.1 + 0.2,
        "gap": math.inf,
        "missing": math.nan,
        "error": 'said: "no"\n',
        "accepted": True,
    }
    kept.append((1, 7), row)
    (found,) = kept.read().values()
    assert math.isnan(found.pop("missing"))
    assert found == {name: value for name, value in row.items() if name != "missing"}
    assert list(kept.read()) == [(1, 7)]


def test_a_line_that_was_cut_off_is_solved_again(kept: KeptRows) -> None:
    kept.begin({(0, 0): {"value": -1.0}, (0, 1): {"value": -2.0}})
    kept.path.write_text(kept.path.read_text()[:-9])
    assert list(kept.read()) == [(0, 0)]
    rows = list(solved_rows(solve, KEYS, workers=1, kept=kept, resume=True))
    assert [row["value"] for row in rows] == [-1, 1, 10]


def test_without_resume_what_was_left_is_forgotten(kept: KeptRows) -> None:
    kept.begin({(0, 0): {"value": -1.0}})
    rows = solved_rows(solve, KEYS, workers=1, kept=kept, resume=False)
    assert next(rows)["value"] == 0
    assert list(kept.read()) == [(0, 0)]


def test_a_row_is_kept_before_it_is_handed_on_and_again_after_a_second_stop(kept: KeptRows) -> None:
    first = solved_rows(solve, KEYS, workers=1, kept=kept, resume=False)
    next(first)
    second = solved_rows(solve, KEYS, workers=1, kept=kept, resume=True)
    next(second), next(second)
    assert list(kept.read()) == [(0, 0), (0, 1)]


def test_trials_of_another_design_are_not_taken(kept: KeptRows) -> None:
    kept.begin({(9, 9): {"value": -1.0}})
    assert len(list(solved_rows(solve, KEYS, workers=1, kept=kept, resume=True))) == 3


def test_the_file_depends_on_the_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CTUS_HOME", str(tmp_path))
    assert KeptRows.of(("a", 1)) == KeptRows.of(("a", 1)) != KeptRows.of(("a", 2))
    assert KeptRows.of("a").path.parent == tmp_path / ".cache" / "robustness"


def test_this_process_too_solves_with_one_thread(kept: KeptRows) -> None:
    def threads(_: tuple[int, int]) -> dict[str, Any]:
        import open3d

        linear_algebra = [library["num_threads"] for library in threadpool_info()]
        return {"threads": [*linear_algebra, open3d.utility.get_max_threads()]}

    (row,) = solved_rows(threads, [(0, 0)], workers=1, kept=kept, resume=False)
    assert set(row["threads"]) == {1}
