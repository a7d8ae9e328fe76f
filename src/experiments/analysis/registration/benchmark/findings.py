"""What the scores of a benchmark say, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from experiments.analysis.registration.benchmark.metrics import (
    RIGHT,
    benchmark_metrics,
    doubted,
    each_method,
    over_cautious,
    own_vessel,
    success_interval,
)
from experiments.analysis.registration.benchmark.tables import compare_methods
from experiments.analysis.registration.pose_scores import judges
from registration.metrics.surface_distance import SUCCESS_TRE_MM
from registration.rigid.result import ACCEPTED, FAILED

if TYPE_CHECKING:
    import pandas as pd

NAMED_AT_MOST = 8


def describe_benchmark(cases: pd.DataFrame) -> tuple[str, ...]:
    """Describe the scores of a benchmark in sentences.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, as ``score_result`` gives them, with a column ``method``.

    Returns
    -------
    tuple of str
        Some sentences for each method, by block where there are several, then one for each pair with the most
        successful method.
    """
    methods = list(each_method(cases))
    blocks = cases["block"].drop_duplicates().tolist()
    said = [
        sentence if len(blocks) == 1 else f"{str(block).replace('_', ' ').capitalize()}: {sentence}"
        for block in blocks
        for name, own in each_method(cases[cases["block"] == block])
        for sentence in _describe(name, own)
    ]
    compared = compare_methods(cases)
    if compared is not None:
        best = max(methods, key=lambda one: int(one[1][RIGHT].sum()))[0]
        for row in compared[(compared["first"] == best) | (compared["second"] == best)].itertuples(
            index=False
        ):
            said.append(
                f"{row.first} is right alone in {row.first_only} cases, {row.second} in {row.second_only} "
                f"(McNemar's test by anatomy: p = {row.p:.2g}, at least {row.min_attainable_p:.2g} "
                f"with {row.anatomies} anatomies; Holm {row.p_holm:.2g})."
            )
    return tuple(said)


def _describe(name: str, cases: pd.DataFrame) -> Iterator[str]:
    if len(own := own_vessel(cases)):
        yield from _of_own_vessel(name, own)
    yield from _of_other_vessels(name, cases)
    missing = cases.loc[cases["error"] != "", "error"]
    if len(missing):
        yield (
            f"{name} gave no result for {len(missing)} of {len(cases)} cases, which count as failed (first: "
            f"{missing.iloc[0]})."
        )


def _of_other_vessels(name: str, cases: pd.DataFrame) -> Iterator[str]:
    others = cases[~cases["same_vessel"].astype(bool)]
    if not len(others):
        return
    if not judges(cases):
        yield f"{name} cannot refuse the {len(others)} models of other vessels: its results are not judged."
        return
    found, wrong = benchmark_metrics(cases), others[others["verdict"] == ACCEPTED]
    yield (
        f"{name} accepts {_percent(found, 'wrong_vessel_accepted')} of {len(others)} models of other vessels and "
        f"mirror images{_named(wrong)}."
    )
    own = own_vessel(cases)
    largest_mm = own.loc[own[RIGHT].astype(bool), "rmse_mm"].max()
    alike = wrong[wrong["rmse_mm"] <= largest_mm]
    if len(alike):  # a piece that is its own mirror image within the noise cannot be told from it
        yield (
            f"{len(alike)} of the {len(wrong)} that {name} accepts leave no larger residual than its right results do "
            f"(RMSE at most {largest_mm:.2f} mm){_named(alike)}."
        )


def _of_own_vessel(name: str, cases: pd.DataFrame) -> Iterator[str]:
    found, interval = benchmark_metrics(cases), success_interval(cases)
    symmetric = ", up to symmetry" if cases["symmetric"].any() else ""
    bounds = ""
    if interval.units > 1:  # one anatomy has no interval
        bounds = f", 95 % interval over {interval.units} anatomies {interval.low:.1%} to {interval.high:.1%}"
    yield (
        f"{name}: {int(cases[RIGHT].sum())} of {len(cases)} {'case' if len(cases) == 1 else 'cases'} within "
        f"{SUCCESS_TRE_MM:g} mm TRE{symmetric} "
        f"({interval.estimate:.1%}{bounds})."
    )
    if not judges(cases):
        yield f"{name}: its results are not judged."
    else:
        yield from _of_verdicts(name, cases, found)
    if "interval_coverage_rate" in found:
        yield (
            f"{name}: {_percent(found, 'interval_coverage')} of the predicted 90 % intervals hold the error"
            + (
                f", {_percent(found, 'interval_coverage_accepted')} of those of accepted results."
                if "interval_coverage_accepted_rate" in found
                else "."
            )
        )
    if "lowest_tre_mm_mean" in found and "tre_mm_mean" in found:
        yield (
            f"{name}: mean TRE {found['tre_mm_mean']:.2f} mm where the true rigid poses leave "
            f"{found['lowest_tre_mm_mean']:.2f} mm; against these {found['tre_rigid_mm_mean']:.2f} mm."
        )


def _of_verdicts(name: str, cases: pd.DataFrame, found: dict[str, float]) -> Iterator[str]:
    accepted = cases[cases["verdict"] == ACCEPTED]
    wrong = accepted[~accepted[RIGHT].astype(bool)]
    among = f"; of these {_percent(found, 'success_accepted')} are right" if len(accepted) else ""
    yield f"{name} accepts {_percent(found, 'acceptance')} of its results{among}{_named(wrong, 'wrong')}."
    symmetric = accepted[accepted["symmetric"]]
    if len(symmetric):
        yield f"{name} is sure of {len(symmetric)} shapes that have more than one right pose{_named(symmetric)}."
    unsure = cases[doubted(cases)]
    if not len(unsure):
        return
    judged, failed = unsure["ambiguous_rightly"].notna(), int((unsure["verdict"] == FAILED).sum())
    rightly = int((unsure["ambiguous_rightly"] == 1).sum())
    yield (
        f"{name} does not accept {len(unsure)} of {len(cases)} results (declared failed: {failed}; right all the same: "
        f"{int(unsure[RIGHT].sum())})"
        + (
            f"; in {rightly} of {int(judged.sum())} a second pose explains the clouds within their noise, and "
            f"right results not accepted without one: {len(over_cautious(cases))}{_named(over_cautious(cases))}."
            if judged.any()
            else "."
        )
    )


def _percent(found: dict[str, float], name: str) -> str:
    rate, low, high = (100 * found[f"{name}_rate{end}"] for end in ("", "_low", "_high"))
    return f"{rate:.1f} % (Wilson 95 % interval {low:.1f} to {high:.1f})"


def _named(cases: pd.DataFrame, what: str = "") -> str:
    names = cases["case"].tolist()
    if not names:
        return ""
    more = f" and {len(names) - NAMED_AT_MOST} more" if len(names) > NAMED_AT_MOST else ""
    return f" ({what}{': ' if what else ''}{', '.join(names[:NAMED_AT_MOST])}{more})"
