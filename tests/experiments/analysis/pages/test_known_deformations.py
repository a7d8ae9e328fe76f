"""The page of the known deformations names its command and holds its tables."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from experiments.analysis.pages import known_deformations as page


def test_the_page_names_command_commit_and_vessels(tmp_path: Path) -> None:
    cases = pd.DataFrame(
        {
            "case": ["a_bending_80", "b_bending_80"],
            "anatomy": ["a", "b"],
            "deformation": "bending",
            "coverage": 0.8,
            "largest_mm": 1.5,
            "rigid_verdict": "accepted",
            "same_vessel": True,
            "tre_rigid_mm": 0.1,
            "tre_mm": 1.0,
            "tre_covered_mm": 1.0,
            "tre_uncovered_mm": 2.0,
            "tre_deformed_mm": 0.5,
            "tre_deformed_covered_mm": [0.25, 0.75],
            "tre_deformed_uncovered_mm": 1.0,
            "jacobian_min": 0.8,
            "verdict": "deformed",
            "rigid_s": 1.0,
            "deformable_s": 1.0,
        }
    )
    page.write_page(cases, "python scripts/bench_known_deformations.py --results here", "abc123", tmp_path)
    text = (tmp_path / "known_deformations.md").read_text()
    assert (
        "Made by `python scripts/bench_known_deformations.py --results here`, commit abc123. 3000 points"
        in text
    )
    assert "Vessels: a, b. The rigid pose" in text
    assert "| bending | 80 % | 2 | 0 | 1.000 | 0.500 |" in text
    assert text.count("### ") == 2
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "known_deformations.csv"), cases, check_dtype=False)
