"""Two runs of the same configuration number by number and row by row: equal, or what differs and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments.analysis.runs.case_difference import Difference, compare_cases, size_of
from experiments.analysis.runs.timing import is_timing
from experiments.errors import InputError

if TYPE_CHECKING:
    from experiments.tracking.run_record import RunRecord

# Tags of the project or of the tracker say who ran it and when; all others are results in words.
_TAGS_LEFT_OUT = ("ctus.", "mlflow.")


@dataclass(frozen=True)
class Compared:
    """What two runs were compared by.

    Parameters
    ----------
    numbers, curve_values, texts, rows, columns : int
        How many single numbers, values of curves, results in words, rows and columns of cases were compared.
    different_numbers, different_curve_values, different_texts, different_columns : tuple of Difference
        Those that are not equal.
    different_rows : int
        Number of rows that differ in any column.
    left_out : tuple of str
        Names that differ every time, such as runtimes.
    """

    numbers: int
    curve_values: int
    texts: int
    rows: int
    columns: int
    different_numbers: tuple[Difference, ...]
    different_curve_values: tuple[Difference, ...]
    different_texts: tuple[Difference, ...]
    different_columns: tuple[Difference, ...]
    different_rows: int
    left_out: tuple[str, ...]

    @property
    def differences(self) -> tuple[Difference, ...]:
        """All of them, numbers first."""
        return (
            *self.different_numbers,
            *self.different_curve_values,
            *self.different_texts,
            *self.different_columns,
        )

    @property
    def equal(self) -> bool:
        """Whether nothing differs, and there was anything to compare."""
        return not self.differences and bool(self.numbers or self.curve_values or self.rows)


def compare_records(original: RunRecord, reproduced: RunRecord, tolerance: float = 0.0) -> Compared:
    """Compare metrics, curves, results in words and cases of two runs.

    Parameters
    ----------
    original, reproduced : RunRecord
        The runs.
    tolerance : float, optional
        Largest difference that counts as equal: absolute up to a size of 1, relative above; 0 asks for the
        same bits. NaN equals NaN, and an infinite value only itself.

    Returns
    -------
    Compared
        Counts and differences.

    Raises
    ------
    InputError
        If the tolerance is negative or no number.
    """
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise InputError(f"tolerance: expected a number from 0, received {tolerance!r}")
    old, new = _points(original), _points(reproduced)
    names = {name for name, _ in (*old, *new)}
    left_out = sorted(name for name in names if is_timing(name))
    curves = {name for name, step in (*old, *new) if step} - set(left_out)
    single = [key for key in _union(old, new) if key[0] not in curves and key[0] not in left_out]
    values = [key for key in _union(old, new) if key[0] in curves]
    tags = [_results_in_words(record.tags) for record in (original, reproduced)]
    cases = compare_cases(original.cases, reproduced.cases, tolerance)
    return Compared(
        numbers=len(single),
        curve_values=len(values),
        texts=len(_union(*tags)),
        rows=cases.rows,
        columns=cases.columns,
        different_numbers=tuple(_numbers(single, old, new, tolerance)),
        different_curve_values=tuple(_numbers(values, old, new, tolerance)),
        different_texts=tuple(
            Difference(name, "", tags[0].get(name), tags[1].get(name), math.nan)
            for name in _union(*tags)
            if tags[0].get(name) != tags[1].get(name)
        ),
        different_columns=cases.different_columns,
        different_rows=cases.different_rows,
        left_out=(*left_out, *(name for name in cases.left_out if name not in left_out)),
    )


def _numbers(
    keys: Iterable[tuple[str, int]],
    old: Mapping[tuple[str, int], float],
    new: Mapping[tuple[str, int], float],
    tolerance: float,
) -> Iterable[Difference]:
    for key in keys:
        name, step = key
        place = f"step {step}" if step else ""
        if key not in old or key not in new:
            yield Difference(name, place, old.get(key), new.get(key), math.nan)
        elif size := size_of(old[key], new[key], tolerance):
            yield Difference(name, place, old[key], new[key], size)


def _points(record: RunRecord) -> dict[tuple[str, int], float]:
    """The last value that was logged of each metric and step, and of other metrics that in the run's file."""
    kept = {(str(name), 0): float(value) for name, value in record.metrics.items()}
    ordered = record.history.sort_values("timestamp_ms", kind="stable")
    rows = zip(ordered["metric"], ordered["step"], ordered["value"], strict=True)
    return kept | {(str(name), int(step)): float(value) for name, step, value in rows}


def _results_in_words(tags: Mapping[str, str]) -> dict[str, str]:
    from experiments.tracking.archive import without_folders
    from experiments.tracking.headline import LEVEL_TAG

    # An archive has no folders of a machine; neither may what it is compared with.
    # Where a run stands in its sweep is of the call: by itself a fold is no repeat.
    return {
        name: without_folders(text)
        for name, text in tags.items()
        if not name.startswith(_TAGS_LEFT_OUT) and name != LEVEL_TAG
    }


def _union(one: Iterable[Any], other: Iterable[Any]) -> list[Any]:
    return sorted({*one, *other})
