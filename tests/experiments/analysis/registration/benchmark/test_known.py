"""Rows, tables and sentences of the known deformations."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from experiments.analysis.registration.benchmark.known import (
    describe_known,
    has_start,
    known_row,
    known_tables,
)
from registration.benchmark.known_cases import KnownSpec, build_known
from registration.benchmark.known_vessels import known_vessel


def rows(ratio: float = 0.4, holds: float = 1.0) -> pd.DataFrame:
    """Six anatomies in one bend and none; one without a start."""
    found = []
    for number in range(6):
        for deformation in ("bending", "none"):
            before = 1.0 + 0.1 * number if deformation == "bending" else 0.1
            after = ratio * before if deformation == "bending" else before
            found.append(
                {
                    "case": f"{number}_{deformation}",
                    "anatomy": f"a{number}",
                    "deformation": deformation,
                    "coverage": 0.8,
                    "largest_mm": 3.0,
                    "rigid_verdict": "accepted",
                    "same_vessel": True,
                    "tre_rigid_mm": 9.0 if number == 5 and deformation == "bending" else 0.2,
                    "tre_mm": before,
                    "tre_covered_mm": before,
                    "tre_uncovered_mm": before,
                    "tre_deformed_mm": np.inf if number == 5 and deformation == "bending" else after,
                    "tre_deformed_covered_mm": after,
                    "tre_deformed_uncovered_mm": after,
                    "jacobian_min": 0.9,
                    "verdict": "deformed" if deformation == "bending" else "rigid stands",
                    "holds_covered": holds,
                    "holds_uncovered": 1.0,
                    "targets_hold_covered": 0.9,
                    "targets_hold_uncovered": 0.9,
                    "rigid_s": 1.0,
                    "deformable_s": 2.0,
                }
            )
    return pd.DataFrame(found)


def test_tables_have_a_row_for_each_coverage_and_deformation_and_one_for_all() -> None:
    tables = known_tables(rows())
    errors = tables["errors, simulated"]
    assert errors["deformation"].tolist() == ["bending", "bending", "none", "none", "all that deform"]
    assert errors["coverage"].tolist() == ["80 %", "all", "80 %", "all", "all"]
    last = errors.iloc[-1]
    assert (last["cases"], last["no_start"], last["covered_better"]) == (6, 1, "5/5")
    assert last["covered_rigid_mm"] == pytest.approx(1.2) and last["covered_deformed_mm"] == pytest.approx(
        0.48
    )
    assert last["covered_ratio"] == "0.40 (0.40 to 0.40)"
    predictions = tables["predictions and verdicts, simulated"]
    assert predictions["rigid_stands"].tolist() == [0, 0, 6, 6, 0]
    assert predictions["covered_hold"].iloc[-1] == "5/5 (0.57 to 1.00)"


@pytest.mark.parametrize(
    ("ratio", "holds", "sentences"),
    [
        (0.4, 1.0, ("at most 0.5; met.", "5 of 5 hold the error (100 %", "so many cases leave it open")),
        (0.6, 0.0, ("at most 0.5; not met.", "0 of 5 hold the error (0 %", "85 to 95 %; not met.")),
    ],
)
def test_sentences_say_what_is_met(ratio: float, holds: float, sentences: tuple[str, ...]) -> None:
    said = " ".join(describe_known(rows(ratio, holds)))
    for sentence in sentences:
        assert sentence in said
    assert "6 cases that deform, of 6 anatomies; 1 without a start" in said
    assert "it was accepted in 1 of them" in said
    assert "0 of 5 fields fold. Asked for: none; met." in said
    assert "the rigid pose stands in 6 of 6 cases; mean error 0.100 mm before, 0.100 mm after; " in said


def test_a_case_is_registered_and_its_errors_measured() -> None:
    spec = KnownSpec("artery", "bending", 3.0, 0.8, 4)
    row = known_row(spec, build_known(spec, known_vessel("artery")))
    assert has_start(pd.DataFrame([row])).all() and row["verdict"] == "deformed"
    assert row["tre_deformed_covered_mm"] < row["tre_covered_mm"]
    assert row["jacobian_min"] > 0 and 0.0 <= row["targets_hold_covered"] <= 1.0
    assert row["holds_covered"] in (0.0, 1.0)
