"""Exact tests of two methods on the same units: signed rank, McNemar, and adjustment for several comparisons."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from experiments.errors import InputError
from experiments.statistics.exact_distribution import tails

ALTERNATIVES = ("two_sided", "greater", "less")
# Differences that agree to this part of the largest value are ties: sums in another order differ by as little.
_TIES_WITHIN = 1e-9


@dataclass(frozen=True)
class SignedRankResult:
    """Result of a signed-rank test.

    Parameters
    ----------
    units : int
        Number of pairs.
    nonzero : int
        Number of pairs that differ.
    positive_ranks, negative_ranks : float
        Sum of the ranks of positive and of negative differences.
    p : float
        P-value, exact unless ``exact`` is False.
    min_attainable_p : float
        Smallest p-value possible with as many non-zero differences: where it is above the level, no result
        could have been significant.
    rank_biserial : float
        Effect size, from -1 (second larger in every unit) to 1 (first larger).
    exact : bool
        Whether the p-value is exact.
    """

    units: int
    nonzero: int
    positive_ranks: float
    negative_ranks: float
    p: float
    min_attainable_p: float
    rank_biserial: float
    exact: bool


@dataclass(frozen=True)
class SignedRank:
    """Wilcoxon's signed-rank test of paired values, exact with ties and with zeros.

    Tied differences share their mean rank. Zeros are ranked with the others and then dropped (Pratt), so that
    units without a difference count against one. The effect size is the matched-pairs rank-biserial
    correlation, the share of ranks in favour less the share against (Kerby).

    Parameters
    ----------
    alternative : {"two_sided", "greater", "less"}, optional
        Alternative about the first minus the second.

    Raises
    ------
    InputError
        If the alternative is unknown.

    References
    ----------
    F. Wilcoxon, Biometrics Bulletin 1, 1945.

    J. W. Pratt, J. Am. Stat. Assoc. 54, 1959.

    D. S. Kerby, Comprehensive Psychology 3, 2014.

    Examples
    --------
    >>> SignedRank()([1, 2, 3, 4, 5], [0, 0, 0, 0, 0]).p
    0.0625
    """

    alternative: Literal["two_sided", "greater", "less"] = "two_sided"

    def __post_init__(self) -> None:
        if self.alternative not in ALTERNATIVES:
            raise InputError(
                f"alternative: expected one of {', '.join(ALTERNATIVES)}, received {self.alternative!r}"
            )

    def __call__(self, first: ArrayLike, second: ArrayLike) -> SignedRankResult:
        """Test one value a unit of each method.

        Parameters
        ----------
        first, second : array_like, shape (n,)
            One value a unit. An infinite value, a failure, ranks beyond all others; two failures of one unit
            are a tie.

        Returns
        -------
        SignedRankResult
            P-value and effect size.

        Raises
        ------
        InputError
            If the values are no pairs, there is none, or one is NaN.
        """
        difference = paired_differences(first, second)
        nonzero = difference != 0
        # Mean ranks are whole or half numbers: twice as large they can be counted exactly.
        ranks = _doubled_ranks(np.abs(difference))
        positive = int(ranks[difference > 0].sum())
        negative = int(ranks[difference < 0].sum())
        chances = tails(ranks[nonzero], positive)
        p = {
            "two_sided": chances.two_sided,
            "greater": chances.at_least,
            "less": chances.at_most,
        }[self.alternative]
        total = positive + negative
        return SignedRankResult(
            units=len(difference),
            nonzero=int(nonzero.sum()),
            positive_ranks=positive / 2,
            negative_ranks=negative / 2,
            p=p,
            min_attainable_p=chances.min_two_sided
            if self.alternative == "two_sided"
            else chances.min_one_sided,
            rank_biserial=(positive - negative) / total if total else 0.0,
            exact=chances.exact,
        )


@dataclass(frozen=True)
class McNemar:
    """Result of McNemar's test.

    Parameters
    ----------
    units : int
        Number of independent units.
    rows : int
        Number of rows.
    first_only, second_only : int
        Rows in which only the first, or only the second, method succeeded.
    p : float
        Exact two-sided p-value.
    min_attainable_p : float
        Smallest p-value that was possible.
    """

    units: int
    rows: int
    first_only: int
    second_only: int
    p: float
    min_attainable_p: float


def mcnemar(first: ArrayLike, second: ArrayLike, units: Sequence[Hashable]) -> McNemar:
    """Test the success of two methods on the same rows by McNemar's exact test.

    With one row a unit it is the binomial test of the rows in which one method alone succeeded. Rows of one
    unit are not independent: what is tested is then each unit's surplus of rows won, whose sign is a fair
    coin when the methods are alike.

    Parameters
    ----------
    first, second : array_like of bool, shape (n,)
        Success of each method in each row.
    units : sequence of hashable
        Unit of each row.

    Returns
    -------
    McNemar
        Counts and p-value.

    Raises
    ------
    InputError
        If a value is neither true nor false, or the lengths differ.

    References
    ----------
    Q. McNemar, Psychometrika 12, 1947.

    Examples
    --------
    >>> mcnemar([1, 1, 1, 1, 1, 0], [0, 0, 0, 0, 0, 0], units=range(6)).p
    0.0625
    """
    won, lost = _booleans("first", first), _booleans("second", second)
    if not len(won) == len(lost) == len(units):
        raise InputError(
            f"second, units: expected one for each of {len(won)} rows, received {len(lost)} and {len(units)}"
        )
    surplus: dict[Hashable, int] = dict.fromkeys(units, 0)
    for unit, one, other in zip(units, won.tolist(), lost.tolist(), strict=True):
        surplus[unit] += one - other
    each = np.array(list(surplus.values()), dtype=np.int64)
    chances = tails(np.abs(each[each != 0]), int(each[each > 0].sum()))
    return McNemar(
        units=len(each),
        rows=len(won),
        first_only=int((won & ~lost).sum()),
        second_only=int((lost & ~won).sum()),
        p=chances.two_sided,
        min_attainable_p=chances.min_two_sided,
    )


def holm(p_values: ArrayLike) -> np.ndarray:
    """Adjust p-values for testing several hypotheses at once.

    Parameters
    ----------
    p_values : array_like, shape (n,)
        P-values. A NaN is a test that could not be made: it stays NaN and does not count.

    Returns
    -------
    ndarray, shape (n,)
        Adjusted p-values in the order given.

    Raises
    ------
    InputError
        If a value lies outside 0 to 1.

    References
    ----------
    S. Holm, Scand. J. Stat. 6, 1979.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    values = np.atleast_1d(np.asarray(p_values, dtype=np.float64))
    made = np.flatnonzero(~np.isnan(values))
    if ((values[made] < 0) | (values[made] > 1)).any():
        raise InputError(f"p_values: expected numbers from 0 to 1, received {values.tolist()}")
    adjusted = np.full(len(values), np.nan)
    order = made[np.argsort(values[made], kind="stable")]
    steps = values[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0) if len(order) else steps
    return adjusted


def paired_differences(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Compute first minus second, ties made exact.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        One value a unit of each method.

    Returns
    -------
    ndarray, shape (n,)
        Differences; two failures (equal infinities) of one unit differ by 0.

    Raises
    ------
    InputError
        If the values are no pairs, there is none, or one is NaN.
    """
    one, other = (np.asarray(values, dtype=np.float64) for values in (first, second))
    if one.ndim != 1 or one.shape != other.shape or not len(one):
        raise InputError(
            f"first, second: expected one value a unit of each, received shapes {one.shape} and {other.shape}"
        )
    if np.isnan(one).any() or np.isnan(other).any():
        raise InputError(
            "first, second: expected failures as infinity and undefined units left out, received NaN"
        )
    with np.errstate(invalid="ignore"):
        difference = np.where(one == other, 0.0, one - other)
    sizes = np.abs(np.concatenate([one, other]))
    largest = sizes[np.isfinite(sizes)].max(initial=0.0)
    if largest == 0:
        return difference
    step = float(largest) * _TIES_WITHIN
    rounded: np.ndarray = np.round(difference / step) * step
    return rounded


def _doubled_ranks(sizes: np.ndarray) -> np.ndarray:
    """Twice the rank of each size, those of equal size sharing their mean rank: whole numbers."""
    _, places, counts = np.unique(sizes, return_inverse=True, return_counts=True)
    doubled: np.ndarray = (2 * np.cumsum(counts) - counts + 1)[places]
    return doubled


def _booleans(name: str, values: ArrayLike) -> np.ndarray:
    row = np.asarray(values)
    if row.ndim != 1 or not np.isin(row, (0, 1)).all():
        raise InputError(
            f"{name}: expected true or false in every row, received {np.unique(row).tolist()[:5]}"
        )
    return row.astype(bool)
