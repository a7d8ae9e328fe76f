"""Findings of segmentation: a sentence for each model and data set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from experiments.analysis.segmentation.case_table import distance, groups, seeds
from experiments.analysis.segmentation.summary import bounded_summary

if TYPE_CHECKING:
    import pandas as pd

# Below, an interval over groups is too narrow (see Bootstrap), and the sentence says so.
FEW_GROUPS = 5
FEW = f" From fewer than {FEW_GROUPS} groups, such intervals are too narrow."


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """Describe each model on each data set in a sentence.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    tuple of str
        One sentence for each model and data set: mean DSC and HD95 with 95 % intervals, missed vessels and
        false alarms.
    """
    sentences = []
    for model, label, group in groups(cases):
        folds = ", ".join(str(fold) for fold in sorted(group["fold"].unique()))
        repeated = f", {len(seeds(group))} seeds" if len(seeds(group)) > 1 else ""
        numbers, measure = bounded_summary(group), distance(group)
        shown, empty = group["missed"].notna().sum(), group["false_alarm"].notna().sum()
        where = f"{model} on {label}, fold {folds}{repeated}"
        if not shown:
            sentences.append(f"{where}: no case with a vessel{_alarms(group)}.")
            continue
        of = "predictions for unseen cases with a vessel" if repeated else "unseen cases with a vessel"
        sentences.append(
            f"{where}: mean DSC {numbers['dsc_mean']:.3f}{_bounds(numbers, 'dsc', 3)} and mean {measure} "
            f"{numbers[f'{measure}_mean']:.2f}{_bounds(numbers, measure, 2)} over {shown} {of} in "
            f"{group.loc[group['missed'].notna(), 'group'].nunique()} groups, "
            f"{int(group['missed'].sum())} of them missed{_alarms(group) if empty else ''}."
            f"{FEW if 'dsc_ci_low' in numbers and group['group'].nunique() < FEW_GROUPS else ''}"
        )
    return tuple(sentences)


def _alarms(cases: pd.DataFrame) -> str:
    return f"; {int(cases['false_alarm'].sum())} false alarms in {cases['false_alarm'].notna().sum()} without one"


def _bounds(numbers: Mapping[str, float], score: str, digits: int) -> str:
    low, high = numbers.get(f"{score}_ci_low"), numbers.get(f"{score}_ci_high")
    if low is None or high is None:
        return ""
    return f" (95 % interval {low:.{digits}f} to {high:.{digits}f})"
