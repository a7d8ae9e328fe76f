"""Rank correlation of two measures of the same cases, with an interval by resampling whole units."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from experiments.errors import InputError
from experiments.statistics.bootstrap import Bootstrap
from experiments.statistics.intervals import Interval

# Resampled ranks of fewer units take too few different orders for their quantiles to bound anything.
MIN_UNITS = 5


@dataclass(frozen=True)
class Spearman:
    """Spearman's rank correlation with a bootstrap interval over units.

    Cases of one unit, such as several networks on one sweep, are drawn together: they are not independent.

    Parameters
    ----------
    bootstrap : Bootstrap, optional
        Gives level, resamples, seed and the kind of interval.

    Notes
    -----
    Equal values share their mean rank. Within blocks, ranks are taken less their mean over the block, and the
    correlation is that of what is left over all blocks. A resample in which one of the two does not vary bounds
    nothing: it ranks lowest for the lower bound and highest for the upper one.

    References
    ----------
    C. Spearman, Am. J. Psychol. 15, 1904.

    A. C. Davison and D. V. Hinkley, Bootstrap Methods and their Application, 1997, section 3.8.

    Examples
    --------
    >>> Spearman()([0.9, 0.8, 0.5], [1.0, 2.0, float("inf")]).estimate
    -1.0
    """

    bootstrap: Bootstrap = field(default_factory=lambda: Bootstrap(resamples=2000))

    def __call__(
        self,
        first: ArrayLike,
        second: ArrayLike,
        units: Sequence[Hashable] | None = None,
        within: Sequence[Hashable] | None = None,
    ) -> Interval:
        """Correlate two measures.

        Parameters
        ----------
        first, second : array_like, shape (n,)
            One value a case of each. An infinite value, a failure, ranks beyond all others.
        units : sequence of hashable or None, optional
            Unit of each case; None makes each case a unit of its own.
        within : sequence of hashable or None, optional
            Block of each case, of one unit each, such as a sweep that several networks have segmented: cases are ranked
            within it, so that what blocks differ by does not count. None ranks all cases together.

        Returns
        -------
        Interval
            Correlation from -1 to 1 and its bounds; the correlation is NaN where one of the two does not vary, the
            bounds for fewer than 5 units as well.

        Raises
        ------
        InputError
            If the values are no pairs, there is none, one is NaN, or there is not one unit and block for each pair.
        """
        pairs = np.column_stack(_pairs(first, second))
        if within is not None:
            blocks = _numbers_of("within", within, len(pairs))
            for block in range(blocks.max() + 1):
                pairs[blocks == block] = _centred(_ranks(pairs[blocks == block]))
        correlate = _ranked if within is None else _of_ranks
        own = _numbers_of("units", list(range(len(pairs))) if units is None else units, len(pairs))
        count, level = int(own.max()) + 1, self.bootstrap.level
        (estimate,) = correlate(pairs, np.ones((1, len(pairs)))).tolist()
        if count < MIN_UNITS or math.isnan(estimate):
            return Interval(estimate, math.nan, math.nan, level, count)
        random = np.random.default_rng(self.bootstrap.seed)
        draws = random.integers(0, count, (self.bootstrap.resamples, count))
        # How often each resample has each unit, and with it each of its cases.
        times = np.stack([(draws == unit).sum(axis=1) for unit in range(count)], axis=1)
        found = correlate(pairs, times[:, own].astype(np.float64))
        low, high = self.bootstrap.places(count)
        lowest, highest = (np.sort(np.nan_to_num(found, nan=worst)) for worst in (-1.0, 1.0))
        return Interval(estimate, float(lowest[low]), float(highest[high]), level, count)


def _ranked(pairs: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The rank correlation of each resample, which has each case so many times."""
    sizes = times.sum(axis=1, keepdims=True)
    away = []
    for values in pairs.T:
        distinct, places = np.unique(values, return_inverse=True)
        held = np.stack([times[:, places == place].sum(axis=1) for place in range(len(distinct))], axis=1)
        # Equal values share their mean rank, whose mean is the same in both columns.
        ranks = np.cumsum(held, axis=1) - (held - 1) / 2
        away.append(ranks[:, places] - (sizes + 1) / 2)
    first, second = away
    return _correlation(first, second, times)


def _of_ranks(pairs: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The same of ranks that are less their mean already."""
    return _correlation(pairs[:, 0], pairs[:, 1], times)


def _correlation(first: np.ndarray, second: np.ndarray, times: np.ndarray) -> np.ndarray:
    both, one, other = ((times * product).sum(axis=1) for product in (first * second, first**2, second**2))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Rounding may carry it past the ends.
        found = np.clip(both / np.sqrt(one * other), -1.0, 1.0)
    return np.where((one > 0) & (other > 0), found, math.nan)


def _pairs(first: ArrayLike, second: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    one, other = (np.asarray(values, dtype=np.float64) for values in (first, second))
    if one.ndim != 1 or one.shape != other.shape or not len(one):
        raise InputError(
            f"first, second: expected one value a case of each, received shapes {one.shape} and {other.shape}"
        )
    if np.isnan(one).any() or np.isnan(other).any():
        raise InputError(
            "first, second: expected failures as infinity and undefined cases left out, received NaN"
        )
    return one, other


def _numbers_of(setting: str, names: Sequence[Hashable], count: int) -> np.ndarray:
    """The number of each case's unit or block, from 0 in the order of their first cases."""
    if len(names) != count:
        raise InputError(f"{setting}: expected one for each of {count} cases, received {len(names)}")
    number_of = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return np.array([number_of[name] for name in names], dtype=np.int64)


def _ranks(pairs: np.ndarray) -> np.ndarray:
    """The rank of each value in its column, equal ones sharing their mean rank."""
    columns = []
    for values in pairs.T:
        _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
        columns.append((np.cumsum(counts) - (counts - 1) / 2)[places])
    return np.column_stack(columns)


def _centred(ranks: np.ndarray) -> np.ndarray:
    centred: np.ndarray = ranks - ranks.mean(axis=0)
    return centred
