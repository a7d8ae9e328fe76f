"""What the robustness study measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from experiments.outcome import JobResult
from experiments.reporting.measured import OTHER_DATA, Measured, p_text
from experiments.statistics import Bootstrap, Interval, by_unit, wilson_interval
from experiments.studies.robustness.comparison import REFERENCE, comparison
from experiments.studies.robustness.grouping import by_condition, groups, with_condition
from experiments.studies.robustness.pooling import pooled

if TYPE_CHECKING:
    import pandas as pd


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the RMSE and the success rates of multi-start registration, beside the other methods.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values for the published ones, by overlap; with several anatomies they are the units, else the trials of one.
    """
    kept = [result for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return []
    cases = pooled(kept)
    return [
        one for key, part in groups(cases, with_condition(cases, ("overlap",))) for one in _of_part(part, key)
    ]


def _of_part(cases: pd.DataFrame, key: tuple[Any, ...]) -> Iterator[Measured]:
    own = cases[cases["method"] == REFERENCE]
    if not len(own):
        return
    where = ", ".join([*map(str, key[:-1]), f"overlap {key[-1]:g}"])
    rmse, units = _interval(own, "rmse_mm")
    share = f"success_rate {own['success'].mean():.0%} of {len(own)} trials; median over trials"
    yield Measured("rmse_mm", f"{REFERENCE}, {where}", *_bounds(rmse), rmse.units, units, share, OTHER_DATA)
    rate, units = _interval(own.astype({"success_tre": float}), "success_tre")
    yield Measured(
        "success_rate", f"{REFERENCE}, {where}", *_bounds(rate), rate.units, units, _beside(cases), OTHER_DATA
    )


def _interval(cases: pd.DataFrame, column: str) -> tuple[Interval, str]:
    """Median of errors or rate of successes, with anatomies as the units where there are several."""
    rate = column == "success_tre"
    if len(cases["anatomy"].unique()) > 1:
        values = by_unit(cases, column, "anatomy", statistic="mean" if rate else "median")
        return Bootstrap("mean_of_units" if rate else "median_of_units")(values), "anatomies"
    if rate:
        one = wilson_interval(int(cases[column].sum()), len(cases))
        return Interval(one.rate, one.low, one.high, 0.95, len(cases)), "trials of one anatomy"
    return Bootstrap("median_of_units")(cases[column]), "trials of one anatomy"


def _bounds(interval: Interval) -> tuple[float, float, float]:
    return interval.estimate, interval.low, interval.high


def _beside(cases: pd.DataFrame) -> str:
    """Success (TRE) of the other methods on the same problems, with McNemar's test."""
    rates = cases.astype({"success_tre": float}).groupby("method", sort=False)["success_tre"].mean()
    rows = {
        str(row["second"]): row
        for _, part in by_condition(cases)
        for row in comparison(part).to_dict("records")
    }
    return "; ".join(
        f"{name} {rate:.0%}"
        + (
            f" ({p_text(rows[name]['mcnemar_p'], rows[name]['mcnemar_min_attainable_p'], 'McNemar')})"
            if name in rows and rows[name]["unit"] == "anatomy"
            else ""
        )
        for name, rate in rates.items()
        if name != REFERENCE
    )
