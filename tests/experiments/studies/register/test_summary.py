"""A sweep of registrations ends with a row for each, with its verdict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.cli import main


@pytest.fixture
def files(home: Path) -> list[str]:
    """Two clouds, the second a quarter turn away."""
    moving = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [40.0, 12.0, 5.0]
    np.savetxt(home / "moving.xyz", moving)
    np.savetxt(home / "fixed.xyz", moving @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [5.0, -3, 2])
    return [f"moving={home / 'moving.xyz'}", f"fixed={home / 'fixed.xyz'}", f"out={home / 'out'}"]


def test_each_registration_has_a_row_by_what_varies(files: list[str], home: Path, capsys) -> None:
    words = ["-m", "study=register", *files, "seed=0,1", "rigid=single_icp,multistart"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "Registrations" in printed and "Of 4 registrations: " in printed
    summary = (home / "out" / "summary.md").read_text().splitlines()
    assert summary[2].startswith("| rigid | deformable | seed | verdict | rmse_mm | inlier_share |")
    rows = pd.DataFrame([line.strip("| ").split(" | ") for line in summary[4:8]])
    assert sorted(zip(rows[0], rows[2], strict=True)) == [
        ("multistart", "0"), ("multistart", "1"), ("single_icp", "0"), ("single_icp", "1"),
    ]  # fmt: skip
    assert set(rows[3][rows[0] == "single_icp"]) == {"not judged"}
    assert set(rows[3][rows[0] == "multistart"]) <= {"accepted", "ambiguous", "failed"}
    # What had finished is in the table of a later call too.
    assert main([*words, "resume=true"]) == 0
    assert "Of 4 registrations: " in capsys.readouterr().out
