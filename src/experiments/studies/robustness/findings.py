"""What the robustness study says in plain sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.pose_scores import judges
from experiments.reporting.labels import counted
from experiments.studies.robustness.design import CROSSED
from experiments.studies.robustness.grouping import by_condition, groups
from experiments.studies.robustness.metrics import CAPTURE_RATE, CAPTURE_TRIALS, inside, lies, share
from experiments.studies.robustness.tables import PIECE, capture_ranges
from registration.metrics.surface_distance import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """State the findings for each method on each piece, for each that judges itself, and what holds for all.

    Where the trials have conditions, each is stated on its own.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    tuple of str
        Sentences.
    """
    turned, varied = cases[cases["factor"] == CROSSED], cases[cases["factor"] != CROSSED]
    return (
        *(
            sentence
            for condition, part in by_condition(turned)
            for key, group in groups(part, PIECE)
            for sentence in _success(condition, key, group)
        ),
        *(
            _levels(condition, key, group)
            for condition, part in by_condition(varied)
            for key, group in groups(part, ("method", "factor"))
        ),
        *(sentence for condition, part in by_condition(cases) for sentence in _judged(condition, part)),
        *_captured(turned),
        *_caveats(cases),
    )


def _under(method: str, condition: str) -> str:
    return f"{method}, {condition}," if condition else method


def _success(condition: str, key: tuple[Any, ...], cases: pd.DataFrame) -> Iterator[str]:
    method, overlap, place = key
    where = f"{_under(method, condition)} at overlap {overlap:g}" + ("" if overlap == 1 else f" ({place})")
    right, small = share(cases["success_tre"]), share(cases["success"])
    assert right is not None and small is not None
    yield (
        f"{where}: {right.successes} of {counted(right.trials, 'trial')} within {SUCCESS_TRE_MM:g} mm of the truth "
        f"({right.rate:.0%}, Wilson 95 % interval {right.low:.0%} to {right.high:.0%}), {small.rate:.0%} with RMSE up "
        f"to {SUCCESS_RMSE_MM:g} mm, median {cases['runtime_s'].median():.2f} s a trial."
    )
    missing = cases.loc[cases["error"] != "", "error"]
    if len(missing):
        yield (
            f"{where} gave no result in {len(missing)} of {counted(len(cases), 'trial')}, which count as failed "
            f"(first: {missing.iloc[0]})."
        )


def _of(values: Any) -> str:
    """How many of how many, with the rate and its interval."""
    rate = share(values)
    assert rate is not None
    bounds = f"Wilson 95 % interval {rate.low:.1%} to {rate.high:.1%}"
    return f"{rate.successes} of {rate.trials} ({rate.rate:.1%}, {bounds})"


def _levels(condition: str, key: tuple[Any, ...], cases: pd.DataFrame) -> str:
    method, factor = key
    rates = [
        f"{level:g}: {group['success_tre'].sum()} of {len(group)}"
        for (level,), group in groups(cases, ("level",))
    ]
    return (
        f"{_under(method, condition)} by {factor}, trials within {SUCCESS_TRE_MM:g} mm: {', '.join(rates)}."
    )


def _judged(condition: str, cases: pd.DataFrame) -> Iterator[str]:
    """Acceptance and coverage of methods that judge their results; which ones do not."""
    for (method,), group in groups(cases, ("method",)):
        if not judges(group):
            yield f"{method}{', ' * bool(condition)}{condition}: its results are not judged."
            continue
        taken = group[group["accepted"]]
        said = f"{_under(method, condition)} accepted {len(taken)} of its {len(group)} results"
        if not len(taken):
            yield f"{said}."
            continue
        held = taken[taken["tre_high_mm"].notna()]
        yield (
            f"{said}, of which {_of(taken['success_tre'])} lie within {SUCCESS_TRE_MM:g} mm"
            + (
                f"; its predicted 90 % intervals hold the true error in {_of(inside(held))} of them."
                if len(held)
                else "."
            )
        )


def _captured(turned: pd.DataFrame) -> Iterator[str]:
    if not len(turned):
        return
    ranges = capture_ranges(turned[turned["rotation"] == "any"])
    if not len(ranges):
        return
    fewest = int(ranges["trials_a_bin"].min())
    known = ranges.dropna(subset="capture_range_deg")
    if len(known) < len(ranges):
        yield (
            f"No capture range: a bin of angles has {fewest} {'trial' if fewest == 1 else 'trials'}, at least "
            f"{CAPTURE_TRIALS} are needed for a rate of {CAPTURE_RATE:.0%}."
        )
    for condition, part in by_condition(known) if len(known) else ():
        for (method,), group in groups(part, ("method",)):
            ends = sorted(group["capture_range_deg"].unique())
            where = f"up to {ends[0]:g} degrees"
            if len(ends) > 1:
                where += f" on its worst piece and {ends[-1]:g} on its best"
            yield (
                f"{_under(method, condition)} captures rotations {where} (at least {CAPTURE_RATE:.0%} success in every "
                f"bin of angles up to there, in these trials; {group['trials_a_bin'].min()} trials a bin at least)."
            )


def _caveats(cases: pd.DataFrame) -> Iterator[str]:
    hidden = lies(cases)
    if hidden.any():
        yield (
            f"RMSE hides {hidden.sum()} of {counted(len(cases), 'trial')}: up to {SUCCESS_RMSE_MM:g} mm of "
            f"residual, more than {SUCCESS_TRE_MM:g} mm from the truth."
        )
    anatomies = len(cases["anatomy"].unique())
    if anatomies > 1:
        yield (
            f"Wilson intervals pool the trials of {anatomies} anatomies; intervals and tests with the anatomy as the "
            "unit are in the tables anatomies and comparison."
        )
    if anatomies == 1 and len(cases["method"].unique()) > 1:
        yield (
            "All trials are on one anatomy: tests across anatomies are not possible, and the comparison describes "
            "these trials alone."
        )
