"""What the robustness study says in plain sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.pose_scores import judges
from experiments.studies.robustness.design import CROSSED
from experiments.studies.robustness.metrics import (
    CAPTURE_RATE,
    CAPTURE_TRIALS,
    groups,
    inside,
    lies,
    share,
)
from experiments.studies.robustness.tables import PIECE, capture_ranges
from registration.metrics.surface_distance import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """State the findings for each method on each piece, for each that judges itself, and what holds for all.

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
        *(sentence for key, group in groups(turned, PIECE) for sentence in _success(key, group)),
        *(_levels(key, group) for key, group in groups(varied, ("method", "factor"))),
        *_judged(cases),
        *_captured(turned),
        *_caveats(cases),
    )


def _success(key: tuple[Any, ...], cases: pd.DataFrame) -> Iterator[str]:
    method, overlap, place = key
    where = f"{method} at overlap {overlap:g}" + ("" if overlap == 1 else f" ({place})")
    right, small = share(cases["success_tre"]), share(cases["success"])
    assert right is not None and small is not None
    yield (
        f"{where}: {right.successes} of {_trials(right.trials)} within {SUCCESS_TRE_MM:g} mm of the truth "
        f"({right.rate:.0%}, Wilson 95 % interval {right.low:.0%} to {right.high:.0%}), {small.rate:.0%} with RMSE up "
        f"to {SUCCESS_RMSE_MM:g} mm, median {cases['runtime_s'].median():.2f} s a trial."
    )
    missing = cases.loc[cases["error"] != "", "error"]
    if len(missing):
        yield (
            f"{where} gave no result in {len(missing)} of {_trials(len(cases))}, which count as failed "
            f"(first: {missing.iloc[0]})."
        )


def _trials(count: int) -> str:
    return f"{count} trial" if count == 1 else f"{count} trials"


def _of(values: Any) -> str:
    """How many of how many, with the rate and its interval."""
    rate = share(values)
    assert rate is not None
    bounds = f"Wilson 95 % interval {rate.low:.1%} to {rate.high:.1%}"
    return f"{rate.successes} of {rate.trials} ({rate.rate:.1%}, {bounds})"


def _levels(key: tuple[Any, ...], cases: pd.DataFrame) -> str:
    method, factor = key
    rates = [
        f"{level:g}: {group['success_tre'].sum()} of {len(group)}"
        for (level,), group in groups(cases, ("level",))
    ]
    return f"{method} by {factor}, trials within {SUCCESS_TRE_MM:g} mm: {', '.join(rates)}."


def _judged(cases: pd.DataFrame) -> Iterator[str]:
    """Acceptance and coverage of methods that judge their results; which ones do not."""
    for (method,), group in groups(cases, ("method",)):
        if not judges(group):
            yield f"{method}: its results are not judged."
            continue
        taken = group[group["accepted"]]
        said = f"{method} accepted {len(taken)} of its {len(group)} results"
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
    for (method,), group in groups(known, ("method",)) if len(known) else ():
        ends = sorted(group["capture_range_deg"].unique())
        where = f"up to {ends[0]:g} degrees"
        if len(ends) > 1:
            where += f" on its worst piece and {ends[-1]:g} on its best"
        yield (
            f"{method} captures rotations {where} (at least {CAPTURE_RATE:.0%} success in every bin of angles up to "
            f"there, in these trials; {group['trials_a_bin'].min()} trials a bin at least)."
        )


def _caveats(cases: pd.DataFrame) -> Iterator[str]:
    hidden = lies(cases)
    if hidden.any():
        yield (
            f"RMSE hides {hidden.sum()} of {_trials(len(cases))}: up to {SUCCESS_RMSE_MM:g} mm of residual, more than "
            f"{SUCCESS_TRE_MM:g} mm from the truth."
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
