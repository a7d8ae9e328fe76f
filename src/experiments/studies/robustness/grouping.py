"""The groups of trials that tables, figures and findings of the robustness study go through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from experiments.studies.robustness.design import CONDITION, CROSSED

if TYPE_CHECKING:
    import pandas as pd

# The same problem for every method, within one condition.
PROBLEM = ("anatomy", "factor", "level", "rotation", "overlap", "place", "trial")


def with_condition(cases: pd.DataFrame, columns: Sequence[str]) -> tuple[str, ...]:
    """Put the column of the condition before others where the trials have one.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.
    columns : sequence of str
        Names of columns.

    Returns
    -------
    tuple of str
        Names of columns to group by, so that trials of two conditions never mix.
    """
    return (CONDITION, *columns) if CONDITION in cases else tuple(columns)


def by_condition(cases: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Split the trials by their condition.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    list of tuple[str, pandas.DataFrame]
        Each condition with its trials; all trials under an empty name where none is told.
    """
    if CONDITION not in cases:
        return [("", cases)]
    return [(str(name), part) for (name,), part in groups(cases, (CONDITION,))]


def groups(cases: pd.DataFrame, columns: Sequence[str]) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame]]:
    """Group the trials by the values of some columns.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.
    columns : sequence of str
        Names of the columns.

    Returns
    -------
    iterator of tuple[tuple of Any, pandas.DataFrame]
        The values of ``columns``, in the order in which they first occur, each with its trials.
    """
    for values, group in cases.groupby(list(columns), sort=False, dropna=False):
        yield values if isinstance(values, tuple) else (values,), group


def crossed(cases: pd.DataFrame) -> pd.DataFrame:
    """Select the trials in which rotation and overlap are crossed.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    pandas.DataFrame
        Rows of these trials.
    """
    return cases[cases["factor"] == CROSSED]


def methods(cases: pd.DataFrame) -> list[str]:
    """List the methods in the order in which they first occur.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    list of str
        Names of the methods.
    """
    return [str(name) for name in cases["method"].drop_duplicates()]
