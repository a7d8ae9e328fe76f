"""Clouds as rows of text, whatever separates the numbers; refused where they could be read as other numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.io.surface_files.polygons import Polygons
from registration.text_files import parse_number, read_text

_COMMENT = re.compile(r"^(#|//|%)+")
_WORDS = re.compile(r"[\s,;]+")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
# x, x_mm, x[mm], x(mm), and the names of ParaView's tables.
_AXIS = re.compile(r"([xyz])(?:[_ ]?[(\[]?mm[)\]]?)?|points[:_]([012])")
# From so many rows on, a first column that counts them is not taken for x.
_MIN_COUNTED_ROWS = 4


def read_text_cloud(path: Path) -> Polygons:
    """Read rows of x y z, or of columns that a header names so; what follows in a row is left out.

    Parameters
    ----------
    path : Path
        File of text, its numbers separated by blanks, semicolons or commas; they may have decimal commas
        where commas do not separate.

    Returns
    -------
    Polygons
        Points without polygons.

    Raises
    ------
    InputError
        If rows are of other numbers, or commas may stand for a decimal point, for thousands or between
        numbers.
    """
    lines = [line.strip() for line in read_text(path).splitlines()]
    lines = [line for line in lines if line]
    try:
        names, first = _header(lines)
        body = [line for line in lines[first:] if not _COMMENT.match(line)]
        rows = _split(body)
        columns = _columns(names, len(rows[0]) if rows else 0)
        _refuse_counted(rows, names)
        values = [[parse_number(row[column]) for column in columns] for row in rows]
    except ValueError as refusal:
        raise InputError(f"{path}: expected rows of x y z, received {refusal}") from refusal
    return Polygons(np.array(values, dtype=np.float64).reshape(-1, 3))


def _header(lines: Sequence[str]) -> tuple[list[str], int]:
    """The names of the columns, none where the file has none, and the line at which the numbers begin."""
    names: list[str] = []
    for place, line in enumerate(lines):
        comment = _COMMENT.match(line)
        words = [
            word.strip("\"'").lower()
            for word in _WORDS.split(line[comment.end() :] if comment else line)
            if word
        ]
        axes = [_axis(word) for word in words]
        if set("xyz") <= set(axes):
            names = [axis or word for axis, word in zip(axes, words, strict=True)]
        elif not comment:
            counts = line.isascii() and line.isdigit() and int(line) == len(lines) - place - 1
            return names, place + counts
    return names, len(lines)


def _axis(word: str) -> str:
    found = _AXIS.fullmatch(word)
    return "" if found is None else found[1] or "xyz"[int(found[2])]


def _columns(names: list[str], width: int) -> list[int]:
    if not names:
        return [0, 1, 2]
    # A comment may name x, y and z alone where more numbers follow.
    if len(names) != width and names[:3] != list("xyz"):
        raise ValueError(f"{width} numbers in a row under {len(names)} names ({', '.join(names)})")
    if any(names.count(axis) > 1 for axis in "xyz"):
        raise ValueError(f"two columns of one name ({', '.join(names)})")
    return [names.index(axis) for axis in "xyz"]


def _split(lines: list[str]) -> list[list[str]]:
    """The numbers of every row, all with decimal points."""
    rows, by_comma, decimal = [], [], []
    for line in lines:
        row, role = _fields(line)
        if len(row) < 3:
            raise ValueError(f"the row {line!r}")
        rows.append(row)
        if role == "separates":
            by_comma.append(row)
        elif role == "decimal":
            decimal.append(row)
    if len({len(row) for row in rows}) > 1:
        widths = sorted({len(row) for row in rows})
        raise ValueError(f"rows of {widths[0]} and of {widths[-1]} numbers")
    _refuse_ambiguous(by_comma, decimal)
    return [[field.replace(",", ".") for field in row] for row in rows]


def _fields(line: str) -> tuple[list[str], str]:
    """The fields of a row and what its commas do: nothing, separate, or mark decimals."""
    if ";" in line:
        fields = [field.strip() for field in line.removesuffix(";").split(";")]
        return fields, "decimal" if "," in line else ""
    if "," not in line:
        return line.split(), ""
    fields = [field.strip() for field in line.removesuffix(",").split(",")]
    if all(field and not re.search(r"\s", field) for field in fields):
        return fields, "separates"
    words = line.split()
    if all("," not in word.strip(",") for word in words):
        # "1, 2, 3" with a gap, or numbers between blanks and commas in turn.
        raise ValueError(f"the row {line!r}")
    return words, "decimal"


def _refuse_ambiguous(by_comma: list[list[str]], decimal: list[list[str]]) -> None:
    if by_comma and decimal:
        raise ValueError(f"commas between numbers ({by_comma[0]}) and within them ({decimal[0]})")
    with_comma = [field for row in decimal for field in row if "," in field]
    other = next((field for field in with_comma if not _DECIMAL_COMMA.fullmatch(field)), None)
    if other is not None:
        raise ValueError(f"{other!r}, whose comma is no decimal one")
    if with_comma and all(_THOUSANDS.fullmatch(field) for field in with_comma):
        raise ValueError(f"{with_comma[0]!r}, which may be a thousand or have a decimal comma")
    if by_comma and len(by_comma[0]) > 3:
        _refuse_whole(by_comma)


def _refuse_whole(rows: list[list[str]]) -> None:
    """Refuse rows between commas whose whole numbers may be parts of numbers with commas."""
    columns = list(zip(*rows, strict=True))
    whole = [all(re.fullmatch(r"[+-]?\d{1,3}", field) for field in column) for column in columns]
    unsigned = [all(re.fullmatch(r"\d+(\.\d*)?", field) for field in column) for column in columns]
    grouped = [all(re.fullmatch(r"\d{3}(\.\d*)?", field) for field in column) for column in columns]
    no_point = not any("." in field or "e" in field.lower() for row in rows for field in row)
    in_pairs = len(columns) >= 6 and all(whole[:5:2]) and all(unsigned[1:6:2])
    in_thousands = any(first and second for first, second in zip(whole, grouped[1:], strict=False))
    if no_point or in_pairs or in_thousands:
        raise ValueError(
            f"the row {','.join(rows[0])!r}, whose commas may separate numbers or be part of them "
            "(separate numbers by blanks or semicolons)"
        )


def _refuse_counted(rows: list[list[str]], names: list[str]) -> None:
    """A first column that counts the rows is no x."""
    if (
        names
        or len(rows) < _MIN_COUNTED_ROWS
        or len(rows[0]) < 4
        or not all(row[0].isdigit() for row in rows)
    ):
        return
    first: Float64[np.ndarray, " n"] = np.array([row[0] for row in rows], dtype=np.float64)
    if first[0] in (0, 1) and (np.diff(first) == 1).all():
        raise ValueError("a first column that counts the rows (name the columns in a first line: id x y z)")
