"""What the robustness study says in plain sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from experiments.studies.robustness_design import CROSSED
from experiments.studies.robustness_metrics import groups, lies, rate_metrics, share
from experiments.studies.robustness_tables import PIECE, capture_ranges
from registration.metrics import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """One sentence for each method on each piece, one for each that judges itself, and what holds for all."""
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
        f"{where}: {right.successes} of {right.trials} trials within {SUCCESS_TRE_MM:g} mm of the truth "
        f"({right.rate:.0%}, Wilson 95 % interval {right.low:.0%} to {right.high:.0%}), {small.rate:.0%} with RMSE up "
        f"to {SUCCESS_RMSE_MM:g} mm, median {cases['runtime_s'].median():.2f} s a trial."
    )
    unanswered = cases.loc[cases["error"] != "", "error"]
    if len(unanswered):
        yield (
            f"{where} gave no answer in {len(unanswered)} of {len(cases)} trials, which count as failed "
            f"(first: {unanswered.iloc[0]})."
        )


def _levels(key: tuple[Any, ...], cases: pd.DataFrame) -> str:
    method, factor = key
    rates = [
        f"{level:g}: {group['success_tre'].sum()} of {len(group)}"
        for (level,), group in groups(cases, ("level",))
    ]
    return f"{method} by {factor}, trials within {SUCCESS_TRE_MM:g} mm: {', '.join(rates)}."


def _judged(cases: pd.DataFrame) -> Iterator[str]:
    """Acceptance and coverage of methods that predict their error."""
    for (method,), group in groups(cases, ("method",)):
        if not group["tre_high_mm"].notna().any():
            continue
        rates = rate_metrics(group)
        yield (
            f"{method} accepted {rates['accepted_rate']:.1%} of its answers, of which "
            f"{rates['success_tre_accepted_rate']:.1%} lie within {SUCCESS_TRE_MM:g} mm; its predicted 90 % intervals "
            f"hold the true error in {rates['tre_interval_coverage']:.1%} of them."
        )


def _captured(turned: pd.DataFrame) -> Iterator[str]:
    if not len(turned):
        return
    ranges = capture_ranges(turned[turned["rotation"] == "any"])
    for (method,), group in groups(ranges, ("method",)) if len(ranges) else ():
        yield (
            f"{method} captures rotations up to {group['capture_range_deg'].min():g} degrees on its worst piece and "
            f"{group['capture_range_deg'].max():g} on its best (at least 95 % success in every bin of angles up to "
            f"there; {group['trials_a_bin'].min()} trials a bin at least)."
        )


def _caveats(cases: pd.DataFrame) -> Iterator[str]:
    hidden = lies(cases)
    if hidden.any():
        yield (
            f"RMSE hides {hidden.sum()} of {len(cases)} trials: up to {SUCCESS_RMSE_MM:g} mm of residual, more than "
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
