"""Two methods on the same units: how far apart, how sure, and whether close enough to call them equal."""

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
    """Whether two methods differ by less than ``margin``, in the metric's unit.

    ``p`` is the larger of the two one-sided tests, ``least_p`` the smallest it could have been with as many units.
    ``interval`` is that of the mean difference at 1 - 2 alpha, ``inside`` whether it lies within the margin.
    """

    margin: float
    p: float
    least_p: float
    interval: Interval
    inside: bool


@dataclass(frozen=True)
class PairedResult:
    """Two methods over the same ``units``: each one's mean, their differences (first minus second), and the tests."""

    units: int
    first: Interval
    second: Interval
    mean_difference: Interval
    median_difference: Interval
    test: SignedRankResult
    equivalence: Equivalence | None


@dataclass(frozen=True)
class PairedComparison:
    """Compares two methods by one value a unit of each.

    Means and differences get bootstrap intervals over units, the difference an exact signed-rank test and the
    rank-biserial correlation. With ``margin`` the claim that the methods differ by less than that is tested by two
    one-sided tests (Schuirmann, J. Pharmacokinet. Biopharm. 15, 1987), as signed-rank tests of the differences
    shifted by the margin (Wellek, Testing Statistical Hypotheses of Equivalence and Noninferiority, 2010, chapter
    5): being exact they can't claim anything from too few units. They are blind to a few units that differ much, so
    the bootstrap interval of the mean difference at 1 - 2 ``alpha`` must lie within the margin as well.
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
        """Compare; a failure is infinite, on the worse side. Raises InputError for values that are not pairs or NaN."""
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
            least_p=max(above.least_p, below.least_p),
            interval=interval,
            inside=bool(-margin < interval.low and interval.high < margin),
        )
