"""Two tables of cases row by row and column by column: equal, or what differs and by how much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.runs.timing import is_timing

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Difference:
    """A number, a text or a column of cases that is not the same in two runs.

    Parameters
    ----------
    name : str
        Name of the metric, the tag or the column.
    place : str
        Step of a curve, or the row of the largest difference; empty for a single number.
    original, reproduced : object
        Values there; None where there is none.
    size : float
        Absolute difference: NaN for texts and for a value that only one run has; infinite against a failure.
    rows : int, optional
        Number of rows that differ; 1 for what is no column.
    """

    name: str
    place: str
    original: object
    reproduced: object
    size: float
    rows: int = 1


@dataclass(frozen=True)
class ComparedCases:
    """How two tables of cases differ.

    Parameters
    ----------
    rows, columns : int
        Number of rows of the original and of columns that were compared.
    different_columns : tuple of Difference
        Columns that are not equal.
    different_rows : int
        Number of rows that differ in any column.
    left_out : tuple of str
        Columns that differ every time, such as runtimes.
    """

    rows: int = 0
    columns: int = 0
    different_columns: tuple[Difference, ...] = ()
    different_rows: int = 0
    left_out: tuple[str, ...] = ()


def compare_cases(
    original: pd.DataFrame | None, reproduced: pd.DataFrame | None, tolerance: float = 0.0
) -> ComparedCases:
    """Compare two tables of cases.

    Parameters
    ----------
    original, reproduced : pandas.DataFrame or None
        The tables; None where a run has none.
    tolerance : float, optional
        Largest difference that counts as equal: absolute up to a size of 1, relative above. NaN equals NaN,
        and an infinite value only itself.

    Returns
    -------
    ComparedCases
        Rows and columns that were compared and those that differ. Tables of different length have one
        difference, ``rows``, and no value of theirs is compared.
    """
    lengths = [0 if table is None else len(table) for table in (original, reproduced)]
    if original is None or reproduced is None or lengths[0] != lengths[1]:
        if original is None and reproduced is None:
            return ComparedCases()
        apart = abs(lengths[0] - lengths[1]) or max(lengths)
        found = Difference("rows", "", lengths[0], lengths[1], float(apart), apart)
        return ComparedCases(lengths[0], 0, (found,), max(lengths))
    columns = list(dict.fromkeys([*map(str, original), *map(str, reproduced)]))
    left_out = tuple(name for name in columns if is_timing(name))
    compared = [name for name in columns if name not in left_out]
    differences, wrong = list[Difference](), np.zeros(lengths[0], dtype=bool)
    for name in compared:
        if name not in original or name not in reproduced:
            sides = ["a column" if name in table else None for table in (original, reproduced)]
            differences.append(Difference(name, "", sides[0], sides[1], math.nan, lengths[0]))
            wrong[:] = True
            continue
        sizes = _sizes(original[name], reproduced[name], tolerance)
        bad = sizes != 0
        if bad.any():
            wrong |= bad
            row = int(np.argmax(np.where(np.isnan(sizes), np.inf, sizes)))
            pair = original[name].iloc[row], reproduced[name].iloc[row]
            place = _row_name(original, row)
            differences.append(Difference(name, place, *pair, float(sizes[row]), int(bad.sum())))
    return ComparedCases(lengths[0], len(compared), tuple(differences), int(wrong.sum()), left_out)


def size_of(one: float, other: float, tolerance: float) -> float:
    """Measure how far apart two numbers are.

    Parameters
    ----------
    one, other : float
        The original number and the other.
    tolerance : float
        Largest difference that counts as equal: absolute up to a size of 1, relative above.

    Returns
    -------
    float
        0 if they are equal, also for two NaN; infinite where only one is NaN.
    """
    if one == other or (math.isnan(one) and math.isnan(other)):
        return 0.0
    size = abs(one - other)
    if math.isnan(size):
        return math.inf
    return 0.0 if size <= tolerance * max(1.0, abs(one)) else size


def _sizes(old: pd.Series, new: pd.Series, tolerance: float) -> np.ndarray:
    """How far apart each pair of values is: 0 if equal, NaN where they are no numbers and differ."""
    pairs = zip(old.tolist(), new.tolist(), strict=True)
    if all(column.dtype.kind in "iufb" for column in (old, new)):
        return np.array([size_of(float(one), float(other), tolerance) for one, other in pairs])
    return np.array([0.0 if _same(one, other) else math.nan for one, other in pairs])


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return bool(np.array_equal(np.asarray(one), np.asarray(other)))
    # None and NaN both say that there is no value; a table may come back with either.
    absent = [value is None or value != value for value in (one, other)]
    return all(absent) if any(absent) else bool(one == other)


def _row_name(table: pd.DataFrame, row: int) -> str:
    named = [str(table[name].iloc[row]) for name in ("case_id", "case", "trial") if name in table]
    return f"row {row}" + (f" ({named[0]})" if named else "")
