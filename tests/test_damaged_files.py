"""Damaged and hostile files, for every reader: refused in one sentence that names the file, or read; nothing else."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from damage import ACCEPTED, REFUSED, damaged, flipped, said
from reader_table import Reader, readers

# As many changes for each reader as the suite has time for; make fuzz makes more, each in a process that may die.
CHANGES, FLIPS = 12, 36
IN_PROCESS = ("lines", "volumes", "sweeps", "pictures", "tables")
# Their library is tried in a process of its own for every file, or may crash over what nobody can check before.
APART = ("VTP, centerline", "bag, SQLite", "bag, MCAP", "image, JPEG", "image, TIFF", "image, TIFF LZW")


def of(*groups: str) -> list[Reader]:
    return readers(*groups)


@pytest.mark.parametrize(
    "reader", [r for r in of("volumes", "sweeps", "pictures", "lines") if r.begin], ids=lambda r: r.name
)
def test_no_flipped_bit_of_what_is_packed_changes_what_is_read(reader: Reader, tmp_path: Path) -> None:
    path = reader.make(tmp_path)
    target = tmp_path / reader.changed if reader.changed else path
    data, chance = target.read_bytes(), random.Random(1)
    assert reader.begin is not None
    before = reader.read(path)
    refused = 0
    for _ in range(FLIPS):
        target.write_bytes(flipped(data, chance, reader.begin(data), reader.end or 12 * (b"IEND" in data)))
        how, message = said(reader.read, path)
        assert how in (ACCEPTED, REFUSED), (how, message)
        refused += how == REFUSED
        if how == ACCEPTED:
            assert same(reader.read(path), before)
    assert refused >= FLIPS * 3 // 4


@pytest.mark.parametrize(
    "reader", [r for r in of(*IN_PROCESS, "surfaces") if r.name not in APART], ids=lambda r: r.name
)
def test_damaged_files_are_read_or_refused_by_name(reader: Reader, tmp_path: Path) -> None:
    path = reader.make(tmp_path)
    assert said(reader.read, path)[0] == ACCEPTED
    target = tmp_path / reader.changed if reader.changed else path
    data, chance = target.read_bytes(), random.Random(2)
    for _ in range(CHANGES):
        target.write_bytes(damaged(data, chance))
        how, message = said(reader.read, path)
        assert how in (ACCEPTED, REFUSED), (how, message)
        assert "\n" not in message


def same(first: object, second: object) -> bool:
    if hasattr(first, "lines"):
        return all(
            np.array_equal(a.points_mm, b.points_mm) and np.array_equal(a.radius_mm, b.radius_mm)
            for a, b in zip(first.lines, second.lines, strict=True)
        )
    return np.array_equal(first, second)
