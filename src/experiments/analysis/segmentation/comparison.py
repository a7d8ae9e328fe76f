"""Which network segments better: every pair on the same cases, by independent groups, and never more than is shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import dataset_label, distance, is_smoke, once_each
from experiments.statistics import PairedComparison, PairedResult, by_unit, holm

if TYPE_CHECKING:
    import pandas as pd

ALPHA = 0.05
# One DSC point.
DSC_MARGIN = 0.01
HIGHER_IS_BETTER = {"dsc": True, "hd95_mm": False, "hd95_px": False}
INTERVALS = ("first_mean", "second_mean", "mean_difference", "median_difference")
NUMBERS = (
    *(name for interval in INTERVALS for name in (interval, f"{interval}_ci_low", f"{interval}_ci_high")),
    *("p", "min_attainable_p", "rank_biserial", "equivalence_p"),
)


@dataclass(frozen=True)
class _SharedCases:
    """The cases of a data set that all its ``models`` scored by a metric, and how many they did not all score."""

    place: dict[str, Any]
    metric: str
    models: tuple[str, ...]
    cases: pd.DataFrame
    left_out: int


def compare_models(cases: pd.DataFrame) -> pd.DataFrame:
    """Compare every pair of models on every data set, by DSC and by HD95 (both penalised).

    HD95 is in mm if a data set has it, else in px. Only cases that all models of the data set scored, with
    the same seeds, are compared. A case is averaged over its seeds first, then a group over its cases: means
    are over groups. Networks that ``trainer=smoke`` trained are compared with nothing.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    pandas.DataFrame
        One row for each pair, data set and metric; no row without a pair. ``units`` counts groups,
        ``left_out`` the cases that not all models scored. Where no case was scored by all, a row has 0 units
        and no numbers.

    Notes
    -----
    Differences are the first model minus the second, with bootstrap 95 % intervals. ``p`` is that of the
    exact signed-rank test, ``p_holm`` adjusted for all pairs of models on that data set and metric,
    ``min_attainable_p`` the smallest that so many groups can give.

    ``equivalent`` says that the DSC differs by less than 0.01: ``equivalence_p_holm`` is of the two one-sided
    tests, adjusted alike, and the 90 % interval of the mean difference must lie within as well (see
    ``PairedComparison``). HD95 has no agreed margin.

    A model is ``better`` if the adjusted test and the interval of the mean agree on it, ``better in rank
    only`` if that interval holds 0.
    """
    import pandas as pd

    cases = cases[~is_smoke(cases)]
    found: list[dict[str, Any]] = []
    for shared in _shared_cases(cases):
        rows = list(_pairs(shared))
        for name in ("p", "equivalence_p"):
            adjusted = holm([row[name] for row in rows])
            for row, value in zip(rows, adjusted.tolist(), strict=True):
                row[f"{name}_holm"] = value
        found += [row | _judged(row) for row in rows]
    return pd.DataFrame(found)


def _pairs(shared: _SharedCases) -> Iterator[dict[str, Any]]:
    """The comparison of every pair of models."""
    compare = PairedComparison(DSC_MARGIN if shared.metric == "dsc" else None, ALPHA)
    scores = {
        model: by_unit(shared.cases[shared.cases["model"] == model], shared.metric) for model in shared.models
    }
    for first, second in combinations(shared.models, 2):
        row = {**shared.place, "metric": shared.metric, "first": first, "second": second, "units": 0}
        row |= {"left_out": shared.left_out, "inside_margin": False, **dict.fromkeys(NUMBERS, np.nan)}
        if len(scores[first]):
            row |= _numbers(compare(scores[first], scores[second]))
        yield row


def _numbers(result: PairedResult) -> dict[str, Any]:
    row: dict[str, Any] = {"units": result.units}
    found = (result.first, result.second, result.mean_difference, result.median_difference)
    for name, interval in zip(INTERVALS, found, strict=True):
        row |= {name: interval.estimate, f"{name}_ci_low": interval.low, f"{name}_ci_high": interval.high}
    row |= {name: getattr(result.test, name) for name in ("p", "min_attainable_p", "rank_biserial")}
    if result.equivalence is not None:
        row |= {"equivalence_p": result.equivalence.p, "inside_margin": result.equivalence.inside}
    return row


def _judged(row: Mapping[str, Any]) -> dict[str, Any]:
    """Whether the two are equivalent, and the comparison in words."""
    if not row["units"]:
        return {"equivalent": False, "verdict": "nothing to compare"}
    equivalent = bool(row["inside_margin"] and row["equivalence_p_holm"] <= ALPHA)
    close = f"within {DSC_MARGIN:g} DSC"
    if row["p_holm"] > ALPHA:
        verdict = f"equivalent {close}" if equivalent else "no difference shown"
        return {"equivalent": equivalent, "verdict": verdict}
    gain = 1 if HIGHER_IS_BETTER[row["metric"]] else -1
    ahead = gain * row["rank_biserial"] > 0
    verdict = f"{row['first' if ahead else 'second']} better"
    # The test is of ranks: a few groups may pull the mean to the other side, or make it uncertain.
    bound = row["mean_difference_ci_low" if row["rank_biserial"] > 0 else "mean_difference_ci_high"]
    if not bound * row["rank_biserial"] > 0:
        verdict += " in rank only"
    return {"equivalent": equivalent, "verdict": f"{verdict}, {close}" if equivalent else verdict}


def _shared_cases(cases: pd.DataFrame) -> Iterator[_SharedCases]:
    """The shared cases of each data set and metric, averaged over their seeds."""
    keys = [name for name in ("train_dataset", "dataset", "simulated") if name in cases]
    for key, part in cases.groupby(keys, sort=False):
        of = dict(zip(keys, key, strict=True))
        place = {"trained_on": str(of["train_dataset"])} if "train_dataset" in of else {}
        place["dataset"] = dataset_label(str(of["dataset"]), bool(of["simulated"]))
        models = tuple(str(model) for model in part["model"].unique())
        same = [name for name in ("seed", "case_id") if name in part]
        for metric in ("dsc", distance(part)):
            scored = part.dropna(subset=metric)
            by_all = scored.groupby(same)["model"].transform("nunique") == len(models)
            left_out = int(scored.loc[~by_all, "case_id"].nunique())
            yield _SharedCases(place, metric, models, once_each(scored[by_all]), left_out)
