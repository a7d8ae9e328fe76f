"""Intervals by resampling whole units, which need no assumption on how scores are distributed."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from experiments.errors import InputError
from experiments.statistics.intervals import Interval, check_level

STATISTICS = ("mean_of_units", "median_of_units", "mean_of_cases")
METHODS = ("expanded", "percentile")
# Drawn indices held at once: 16 MB, whatever the number of units.
_INDICES_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Bootstrap:
    """Interval of a mean or median by the bootstrap over units.

    Units are drawn with replacement, each with all its cases (the cluster bootstrap: Davison and Hinkley).

    Parameters
    ----------
    statistic : {"mean_of_units", "median_of_units", "mean_of_cases"}, optional
        The mean or the median over units of each unit's mean, or the mean over all cases, in which a unit
        weighs as many cases as it has.
    method : {"expanded", "percentile"}, optional
        ``percentile`` takes the quantiles of the resampled statistic, ``expanded`` outer ones; see the notes.
    level : float, optional
        Confidence level, between 0 and 1.
    resamples : int, optional
        Number of resamples, at least 100.
    seed : int, optional
        Seed of the resampling.

    Raises
    ------
    InputError
        If a value is out of range or a choice is unknown.

    Notes
    -----
    The percentiles lie too close together when units are few. The expanded ones are further out by the factor
    that makes an interval around a normal mean Student's (Hesterberg, section 5.3). In 1000 samples of 5, 8
    and 11 normal values the expanded 95 % interval held the mean 93, 95 and 94 % of the time, the plain one
    84, 90 and 91 %. Under 5 units, or where a few units differ much from all others, both are too narrow.

    References
    ----------
    B. Efron, Ann. Stat. 7, 1979.

    A. C. Davison and D. V. Hinkley, Bootstrap Methods and their Application, 1997, section 3.8.

    T. C. Hesterberg, The American Statistician 69, 2015.
    """

    statistic: Literal["mean_of_units", "median_of_units", "mean_of_cases"] = "mean_of_units"
    method: Literal["expanded", "percentile"] = "expanded"
    level: float = 0.95
    resamples: int = 10_000
    seed: int = 0

    def __post_init__(self) -> None:
        if self.statistic not in STATISTICS:
            raise InputError(
                f"statistic: expected one of {', '.join(STATISTICS)}, received {self.statistic!r}"
            )
        if self.method not in METHODS:
            raise InputError(f"method: expected one of {', '.join(METHODS)}, received {self.method!r}")
        check_level(self.level)
        if self.resamples < 100:
            raise InputError(f"resamples: expected at least 100, received {self.resamples}")

    def __call__(self, values: ArrayLike, units: Sequence[Hashable] | None = None) -> Interval:
        """Compute the interval of the statistic.

        Parameters
        ----------
        values : array_like, shape (n,)
            One value a case. An infinite value, a failure, makes a mean infinite and ranks at its end in a
            median.
        units : sequence of hashable or None, optional
            Unit of each case; None makes each case a unit of its own.

        Returns
        -------
        Interval
            The interval. Its bounds are NaN for a single unit and, of a mean, where infinities of both signs
            meet.

        Raises
        ------
        InputError
            If there is no value, a value is NaN, or there is not one unit for each value.
        """
        cases = np.asarray(values, dtype=np.float64)
        if cases.ndim != 1 or not len(cases):
            raise InputError(f"values: expected at least one number in a row, received shape {cases.shape}")
        if np.isnan(cases).any():
            raise InputError(
                f"values: expected failures as infinity and undefined cases left out, "
                f"received {np.isnan(cases).sum()} NaN"
            )
        sums, counts = _sums_of_units(cases, units)
        with np.errstate(invalid="ignore"):  # infinities of both signs: their mean is undefined, and says so
            estimate = float(self._statistic(sums, counts, np.arange(len(sums))[None])[0])
            if len(sums) == 1 or math.isnan(estimate):
                return Interval(estimate, math.nan, math.nan, self.level, len(sums))
            resampled = np.sort(self._resample(sums, counts))
        low, high = (resampled[place] for place in self.places(len(sums)))
        return Interval(estimate, float(low), float(high), self.level, len(sums))

    def ratio(self, above: ArrayLike, below: ArrayLike, units: Sequence[Hashable] | None = None) -> Interval:
        """Compute the interval of a ratio of two means over the same units, which are drawn together.

        Parameters
        ----------
        above, below : array_like, shape (n,)
            One value a case of each, finite. Means are over units of each unit's mean, whatever the statistic.
        units : sequence of hashable or None, optional
            Unit of each case; None makes each case a unit of its own.

        Returns
        -------
        Interval
            The interval; all NaN where the mean below is 0, its bounds NaN for a single unit.

        Raises
        ------
        InputError
            If the values are no pairs, there is none, one is not finite, or there is not one unit for each pair.
        """
        pairs = [np.asarray(values, dtype=np.float64) for values in (above, below)]
        if pairs[0].ndim != 1 or pairs[0].shape != pairs[1].shape or not len(pairs[0]):
            raise InputError(
                f"above, below: expected one number a case of each, received shapes {pairs[0].shape} and "
                f"{pairs[1].shape}"
            )
        if not all(np.isfinite(values).all() for values in pairs):
            raise InputError("above, below: expected finite numbers, received others")
        parts = [_sums_of_units(values, units) for values in pairs]
        first, second = (sums / counts for sums, counts in parts)
        count = len(first)
        if not second.mean():
            return Interval(math.nan, math.nan, math.nan, self.level, count)
        estimate = float(first.mean() / second.mean())
        if count == 1:
            return Interval(estimate, math.nan, math.nan, self.level, count)
        drawn = np.random.default_rng(self.seed).integers(0, count, (self.resamples, count))
        # Draws of units that all have 0 below have no ratio and rank last.
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.nan_to_num(first[drawn].mean(axis=1) / second[drawn].mean(axis=1), nan=math.inf)
        low, high = (np.sort(found)[place] for place in self.places(count))
        return Interval(estimate, float(low), float(high), self.level, count)

    def places(self, units: int) -> tuple[int, int]:
        """Give the places of the bounds among the sorted resamples.

        They are order statistics, for infinities cannot be interpolated.

        Parameters
        ----------
        units : int
            Number of units that were drawn from, at least 2.

        Returns
        -------
        tuple of int
            Index of the lower and of the upper bound.
        """
        tail = (1 - self.level) / 2
        if self.method == "expanded":
            from scipy.special import stdtrit  # a tenth of the time that importing scipy.stats takes

            students = float(stdtrit(units - 1, tail))
            tail = NormalDist().cdf(math.sqrt(units / (units - 1)) * students)
        low = max(0, math.ceil(tail * self.resamples) - 1)
        return low, self.resamples - 1 - low

    def _resample(self, sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
        random, units = np.random.default_rng(self.seed), len(sums)
        at_once = max(1, _INDICES_AT_ONCE // units)
        parts = []
        for first in range(0, self.resamples, at_once):
            drawn = random.integers(0, units, (min(at_once, self.resamples - first), units))
            parts.append(self._statistic(sums, counts, drawn))
        return np.concatenate(parts)

    def _statistic(self, sums: np.ndarray, counts: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """The statistic of the units in each row of ``drawn``."""
        found: np.ndarray
        if self.statistic == "mean_of_cases":
            found = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
        elif self.statistic == "mean_of_units":
            found = (sums / counts)[drawn].mean(axis=1)
        else:
            found = np.median((sums / counts)[drawn], axis=1)
        return found


def _sums_of_units(cases: np.ndarray, units: Sequence[Hashable] | None) -> tuple[np.ndarray, np.ndarray]:
    """The sum and the number of cases of each unit."""
    if units is None:
        return cases, np.ones(len(cases))
    if len(units) != len(cases):
        raise InputError(f"units: expected one for each of {len(cases)} values, received {len(units)}")
    number_of = {unit: number for number, unit in enumerate(dict.fromkeys(units))}
    numbers = np.array([number_of[unit] for unit in units])
    with np.errstate(invalid="ignore"):
        return np.bincount(numbers, weights=cases), np.bincount(numbers).astype(np.float64)
