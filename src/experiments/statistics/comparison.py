"""Paired comparison of two methods on the same units: difference, uncertainty, and equivalence within a margin."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from experiments.errors import InputError
from experiments.statistics.bootstrap import Bootstrap
from experiments.statistics.intervals import Interval
from experiments.statistics.paired_tests import SignedRank, SignedRankResult, paired_differences


@dataclass(frozen=True)
class Equivalence:
    """Test of whether two methods differ by less than a margin.

    Parameters
    ----------
    margin : float
        The margin, in the metric's unit.
    p : float
        Larger p-value of the two one-sided tests.
    min_attainable_p : float
        Smallest p-value possible with as many units.
    interval : Interval
        Interval of the mean difference at level 1 - 2 alpha.
    inside : bool
        Whether that interval lies within the margin.
    """

    margin: float
    p: float
    min_attainable_p: float
    interval: Interval
    inside: bool


@dataclass(frozen=True)
class PairedResult:
    """Comparison of two methods over the same units; differences are first minus second.

    Parameters
    ----------
    units : int
        Number of units.
    first, second : Interval
        Mean of each method.
    mean_difference, median_difference : Interval
        Mean and median of the differences.
    test : SignedRankResult
        Signed-rank test of the differences.
    equivalence : Equivalence or None
        Test of equivalence; None without a margin.
    """

    units: int
    first: Interval
    second: Interval
    mean_difference: Interval
    median_difference: Interval
    test: SignedRankResult
    equivalence: Equivalence | None


@dataclass(frozen=True)
class PairedComparison:
    """Comparison of two methods by one value a unit of each.

    Means and differences get bootstrap intervals over units, the difference an exact signed-rank test and the
    rank-biserial correlation. With a margin the claim that the methods differ by less is tested as well.

    Parameters
    ----------
    margin : float or None, optional
        Margin of equivalence in the metric's unit, above 0; None tests no equivalence.
    alpha : float, optional
        Level of the test of equivalence, between 0 and 0.5.
    bootstrap : Bootstrap, optional
        Bootstrap of the intervals; its statistic is replaced.

    Raises
    ------
    InputError
        If the margin or the level is out of range.

    Notes
    -----
    Equivalence is tested by two one-sided tests (Schuirmann), as signed-rank tests of the differences shifted
    by the margin (Wellek, chapter 5): being exact they can't claim anything from too few units. They are
    blind to a few units that differ much, so the bootstrap interval of the mean difference at 1 - 2 ``alpha``
    must lie within the margin as well.

    References
    ----------
    D. J. Schuirmann, J. Pharmacokinet. Biopharm. 15, 1987.

    S. Wellek, Testing Statistical Hypotheses of Equivalence and Noninferiority, 2010.
    """

    margin: float | None = None
    alpha: float = 0.05
    bootstrap: Bootstrap = field(default_factory=Bootstrap)

    def __post_init__(self) -> None:
        if self.margin is not None and not (np.isfinite(self.margin) and self.margin > 0):
            raise InputError(f"margin: expected a difference above 0, or none, received {self.margin}")
        if not 0 < self.alpha < 0.5:
            raise InputError(f"alpha: expected a level between 0 and 0.5, received {self.alpha}")

    def __call__(self, first: ArrayLike, second: ArrayLike) -> PairedResult:
        """Compare two methods.

        Parameters
        ----------
        first, second : array_like, shape (n,)
            One value a unit of each method; a failure is infinite, on the worse side.

        Returns
        -------
        PairedResult
            Means, differences and tests.

        Raises
        ------
        InputError
            If the values are no pairs, or one is NaN.
        """
        difference = paired_differences(first, second)
        mean = replace(self.bootstrap, statistic="mean_of_units")
        median = replace(self.bootstrap, statistic="median_of_units")
        return PairedResult(
            units=len(difference),
            first=mean(first),
            second=mean(second),
            mean_difference=mean(difference),
            median_difference=median(difference),
            test=SignedRank()(first, second),
            equivalence=None if self.margin is None else self._equivalence(difference, self.margin),
        )

    def _equivalence(self, difference: np.ndarray, margin: float) -> Equivalence:
        bound = np.full(len(difference), margin)
        above = SignedRank("greater")(difference, -bound)
        below = SignedRank("less")(difference, bound)
        interval = replace(self.bootstrap, statistic="mean_of_units", level=1 - 2 * self.alpha)(difference)
        return Equivalence(
            margin=margin,
            p=max(above.p, below.p),
            min_attainable_p=max(above.min_attainable_p, below.min_attainable_p),
            interval=interval,
            inside=bool(-margin < interval.low and interval.high < margin),
        )
