"""Tables that come with a data set: CSV files with a line of column names."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from experiments.errors import InputError, reading
from experiments.unicode_names import same_name
from registration.text_files import read_text


def read_table(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Read a CSV file with a line of column names.

    Parameters
    ----------
    path : Path
        The file, in UTF-8 with or without a byte-order mark.
    columns : sequence of str
        Columns that must be there; there may be more.

    Returns
    -------
    list of dict
        One mapping of column to text for each row, in the form of ``same_name``, with surrounding blanks
        removed; a missing cell is empty.

    Raises
    ------
    InputError
        If the file is missing, is no text, lacks a column or has one twice, or a row has more cells than columns.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a table with columns {', '.join(columns)}, found no file")
    with reading(path, "a table in UTF-8"):
        table = csv.DictReader(io.StringIO(read_text(path), newline=""))
        found = [name.strip() for name in table.fieldnames or ()]
        table.fieldnames = found
        rows = list(table)
    if not set(columns) <= set(found):
        raise InputError(
            f"{path}: expected columns {', '.join(columns)}, received {', '.join(found) or 'none'}"
        )
    twice = sorted({name for name in found if name and found.count(name) > 1})
    if twice:
        raise InputError(f"{path}: expected each column once, received {', '.join(twice)} twice")
    for row in rows:
        # More cells than columns come of decimal commas, which move all that follows into the wrong column.
        more: object = row.get(None)
        if isinstance(more, list) and any(cell.strip() for cell in more):
            raise InputError(
                f"{path}: expected {len(found)} cells a row, received {len(found) + len(more)} in the row of "
                f"{row[found[0]]!r}"
            )
    return [{name: same_name((row[name] or "").strip()) for name in found} for row in rows]
