"""Every value that the PLUS toolkit published for its test data is met."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.validation import plus
from experiments.validation.plus import Value, table


@pytest.mark.parametrize(
    ("part", "count"),
    [
        ("reading_values", 6),
        ("cropped_values", 4),
        ("interpolation_values", 2),
        ("temporal_values", 3),
        ("spatial_values", 12),
    ],
)
def test_published_values_are_met(real_data: Path, part: str, count: int) -> None:
    values = list(getattr(plus, part)(real_data / "plus"))
    assert len(values) == count
    assert [value for value in values if value.met is False] == []


def test_lines_of_the_table() -> None:
    values = [
        Value("a", "x", 2.0, 2.04, tolerance=0.05),
        Value("a", "y", 2.0, 2.06, tolerance=0.05),
        Value("a", "z", 0.5, 0.5, "below"),
        Value("a", "w", float("nan"), 3.0, "report"),
        Value("a", "v", 7, 7),
    ]
    assert [value.met for value in values] == [True, False, False, None, True]
    found = table(values)
    assert found["PLUS"].tolist() == ["2 ± 0.05", "2 ± 0.05", "< 0.5", "-", "7"]
    assert found["met"].tolist() == ["yes", "NO", "NO", "-", "yes"]
