"""Statistics that every study reports: summaries, intervals, and comparisons over independent units.

The unit is the group, sweep or anatomy, never the frame or the pair of frames: ``by_unit`` makes one value of each
unit's cases, and every test and interval here takes such values.
"""

from experiments.statistics.bootstrap import Bootstrap
from experiments.statistics.comparison import Equivalence, PairedComparison, PairedResult
from experiments.statistics.correlation import Spearman
from experiments.statistics.intervals import (
    Interval,
    Proportion,
    summary,
    wilson_interval,
    wilson_of_rate,
)
from experiments.statistics.paired_tests import McNemar, SignedRank, SignedRankResult, holm, mcnemar
from experiments.statistics.units import by_unit

__all__ = [
    "Bootstrap",
    "Equivalence",
    "Interval",
    "McNemar",
    "PairedComparison",
    "PairedResult",
    "Proportion",
    "SignedRank",
    "SignedRankResult",
    "Spearman",
    "by_unit",
    "holm",
    "mcnemar",
    "summary",
    "wilson_interval",
    "wilson_of_rate",
]
