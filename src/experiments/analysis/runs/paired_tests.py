"""Two runs tested on the cases that both have, with the independent unit of the cases as that of the tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.analysis.runs.paired_cases import TESTED, PairedCases
from experiments.statistics import PairedComparison, by_unit, holm, mcnemar

if TYPE_CHECKING:
    import pandas as pd

ALPHA = 0.05
# One DSC point.
DSC_MARGIN = 0.01
# A failed registration is infinitely far off: over trials of a unit the median says more than a mean.
BY_MEDIAN = frozenset({"tre_mm", "rmse_mm", "msd_mm", "hd95_covered_mm"})
SIGNED_RANK, MCNEMAR = "signed-rank", "McNemar"


def unit_values(paired: PairedCases, metric: str, cases: pd.DataFrame) -> pd.DataFrame:
    """One value a unit of each run.

    Parameters
    ----------
    paired : PairedCases
        The cases of both runs.
    metric : str
        Metric to take.
    cases : pandas.DataFrame
        Rows of ``paired.pairs``.

    Returns
    -------
    pandas.DataFrame
        Columns ``first`` and ``second``, indexed by unit; only cases for which both have a value count.
    """
    import pandas as pd

    columns = [f"{metric}_first", f"{metric}_second"]
    scored = cases.dropna(subset=columns)
    statistic: Literal["mean", "median"] = "median" if metric in BY_MEDIAN else "mean"
    values = [by_unit(scored, column, paired.unit, statistic=statistic) for column in columns]
    return pd.DataFrame({"first": values[0], "second": values[1]})


def strata_of(paired: PairedCases) -> Iterator[tuple[str, pd.DataFrame]]:
    """The methods within which two runs are compared, each with its cases.

    Parameters
    ----------
    paired : PairedCases
        The cases of both runs.

    Yields
    ------
    str
        Name of the method, empty where each run has one alone.
    pandas.DataFrame
        Its rows of ``paired.pairs``.
    """
    if not paired.strata:
        yield "", paired.pairs
        return
    for values, cases in paired.pairs.groupby(list(paired.strata), sort=False, dropna=False):
        yield ", ".join(str(value) for value in values), cases


def compare_runs(paired: PairedCases) -> pd.DataFrame:
    """Test each metric within each method.

    Parameters
    ----------
    paired : PairedCases
        The cases of both runs.

    Returns
    -------
    pandas.DataFrame
        One row for each method and metric: means over units, mean and median difference (first less second) with
        bootstrap 95 % intervals, and the exact test: McNemar's for a success of single trials, else signed rank.
        ``p_holm`` is adjusted for all rows, ``family_least`` the least adjusted p that any of them could give.
    """
    import pandas as pd

    rows = []
    for name, cases in strata_of(paired):
        for metric in paired.metrics:
            values = unit_values(paired, metric, cases)
            if len(values):
                rows.append({"method": name, "metric": metric, **_row(paired, metric, cases, values)})
    adjusted = holm([row["p"] for row in rows]).tolist()
    least = min((row["min_attainable_p"] for row in rows), default=1.0) * len(rows)
    for row, p in zip(rows, adjusted, strict=True):
        row |= {"p_holm": p, "family_least": min(least, 1.0)}
        row["verdict"] = _verdict(row)
    return pd.DataFrame(rows)


def _row(paired: PairedCases, metric: str, cases: pd.DataFrame, values: pd.DataFrame) -> dict[str, Any]:
    columns = [f"{metric}_first", f"{metric}_second"]
    scored = cases.dropna(subset=columns)
    found = PairedComparison(DSC_MARGIN if metric == "dsc" else None, ALPHA)(
        values["first"].to_numpy(), values["second"].to_numpy()
    )
    row: dict[str, Any] = {
        "units": found.units,
        "cases": len(scored),
        "first": found.first.estimate,
        "second": found.second.estimate,
    }
    for name in ("mean_difference", "median_difference"):
        interval = getattr(found, name)
        row |= {name: interval.estimate, f"{name}_ci_low": interval.low, f"{name}_ci_high": interval.high}
    row |= {"test": SIGNED_RANK, "rank_biserial": found.test.rank_biserial}
    row |= {"p": found.test.p, "min_attainable_p": found.test.min_attainable_p}
    if metric.startswith("success") and scored[columns].isin((0.0, 1.0)).all(axis=None):
        won = mcnemar(scored[columns[0]], scored[columns[1]], scored[paired.unit].tolist())
        row |= {"test": MCNEMAR, "p": won.p, "min_attainable_p": won.min_attainable_p}
        row |= {"first_only": won.first_only, "second_only": won.second_only}
    row["equivalent"] = bool(
        found.equivalence is not None and found.equivalence.inside and found.equivalence.p <= ALPHA
    )
    return row


def _verdict(row: dict[str, Any]) -> str:
    """The comparison in words, which claim no more than the test and the interval show."""
    if row["p_holm"] > ALPHA:
        return f"equivalent within {DSC_MARGIN:g} DSC" if row["equivalent"] else "no difference shown"
    sign = np.sign(row["rank_biserial"]) or np.sign(row["mean_difference"])
    ahead = (sign > 0) == TESTED[row["metric"]]
    verdict = f"{'first' if ahead else 'second'} better"
    # The test is of ranks: a few units may pull the mean to the other side, or make it uncertain.
    bound = row["mean_difference_ci_low" if sign > 0 else "mean_difference_ci_high"]
    return verdict if bound * sign > 0 else f"{verdict} in rank only"
