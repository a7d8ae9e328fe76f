"""The table of all published values, each beside what was measured, or beside the command that measures it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from experiments.reporting.measured import Measured
from experiments.reporting.published import PERCENT, Published, published_values
from experiments.reporting.thesis_steps import SMOKE, command_for
from experiments.studies.report.sections import Section

if TYPE_CHECKING:
    import pandas as pd

ID_LENGTH = 8
COLUMNS = (
    *(
        "study",
        "value",
        "published",
        "published_on",
        "place",
        "measured_on",
        "ours",
        "interval",
        "n",
        "difference",
    ),
    *("comparable", "said", "budget", "run", "command"),
)
YES, NOT_MEASURED, SMALL = "yes", "not measured yet", "trainer=smoke: shows that all works, no result"
FOLDS_MISSING = "folds missing"
_DIGITS = {PERCENT: 1, "mm": 2, "s": 1}


def published_table(sections: Sequence[Section]) -> pd.DataFrame:
    """Put every published value beside the measured ones.

    Parameters
    ----------
    sections : sequence of Section
        Runs with what their studies measured.

    Returns
    -------
    pandas.DataFrame
        Texts, one row for each published value and each thing it was measured on; a value without a run has one row,
        with the command that makes it.
    """
    import pandas as pd

    rows = [
        row
        for study, values in published_values().items()
        for name, value in values.items()
        for row in _rows(study, name, value, sections)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS)).fillna("")


def _rows(study: str, name: str, value: Published, sections: Sequence[Section]) -> Iterator[dict[str, str]]:
    known = {
        "study": study,
        "value": value.metric,
        "published": value.text_with_unit,
        "published_on": value.data,
        "place": value.place,
        "command": command_for(study, tuple(value.dataset)),
    }
    found = [
        (section, one)
        for section in sections
        if section.study == study
        for one in section.measured
        if one.name == name
    ]
    if not found:
        yield {**known, "comparable": NOT_MEASURED}
    for section, one in found:
        yield {
            **known,
            "measured_on": one.of,
            "ours": number_text(one.value, value.unit),
            "interval": _interval(one, value.unit),
            "n": _number(one),
            "difference": _difference(one, value),
            "comparable": _comparable(section, one),
            "said": one.said,
            "budget": section.budget,
            "run": section.run_id[:ID_LENGTH],
            "command": str(section.family.run.tags.get("ctus.command") or known["command"]),
        }


def _number(one: Measured) -> str:
    """How many a value comes from, in words."""
    if not one.n:
        return ""
    units = one.units.removesuffix("s") if one.n == 1 else one.units
    return f"{one.n} {units}".strip()


def _comparable(section: Section, one: Measured) -> str:
    small = one.small or section.budget == SMOKE
    reasons = (one.not_comparable, "" if section.whole else FOLDS_MISSING, SMALL if small else "")
    return "; ".join(filter(None, reasons)) or YES


def number_text(value: float, unit: str) -> str:
    """Write a measured value in the unit of the published one.

    Parameters
    ----------
    value : float
        Value in the metric's own unit, a share where the unit is %.
    unit : str
        Unit of the published value; empty where it has none.

    Returns
    -------
    str
        The number with its unit; empty for NaN.

    Examples
    --------
    >>> number_text(0.934, "%"), number_text(0.5, "mm"), number_text(float("inf"), "mm")
    ('93.4 %', '0.50 mm', 'inf mm')
    """
    if math.isnan(value):
        return ""
    factor = 100 if unit == PERCENT else 1
    return f"{factor * value:.{_DIGITS.get(unit, 3)}f} {unit}".strip()


def _interval(one: Measured, unit: str) -> str:
    if math.isnan(one.low) or math.isnan(one.high):
        return ""
    return f"{number_text(one.low, unit)} to {number_text(one.high, unit)}"


def _difference(one: Measured, value: Published) -> str:
    """Whether the measured value lies in the published range, else by how much it does not."""
    if value.relation == "stated" or math.isnan(one.value):
        return ""
    if value.met(one.value):
        return "in range"
    apart = value.difference(one.value)
    sign = "+" if apart > 0 else ""
    return f"{sign}{number_text(apart, value.unit)}"
