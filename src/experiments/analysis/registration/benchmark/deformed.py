"""Errors of material points before and after a displacement: of a method on a benchmark, paired over anatomies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.statistics import Bootstrap, Interval, SignedRank, by_unit

if TYPE_CHECKING:
    import pandas as pd

DEFORMED = "tre_deformed_mm"
# Of all targets, of those that were swept, and of the others: columns before and after the displacement.
PARTS = {
    "all": ("tre_mm", DEFORMED),
    "covered": ("tre_covered_mm", "tre_deformed_covered_mm"),
    "uncovered": ("tre_uncovered_mm", "tre_deformed_uncovered_mm"),
}
# A rigid pose as far off the true one is no start of a deformable method.
NO_START_MM = 5.0


@dataclass(frozen=True)
class PairedErrors:
    """Errors of the same cases before and after a displacement.

    Parameters
    ----------
    cases, better, worse : int
        Number of cases, and of those whose error the displacement lowers and raises.
    before_mm, after_mm : float
        Means over anatomies of each one's mean error in mm.
    change_mm : Interval
        Mean over anatomies of after less before, in mm.
    ratio : Interval
        Mean after over mean before.
    anatomies_better : int
        Number of anatomies whose mean error falls.
    p : float
        Signed-rank test over anatomies.
    """

    cases: int
    better: int
    worse: int
    before_mm: float
    after_mm: float
    change_mm: Interval
    ratio: Interval
    anatomies_better: int
    p: float


def paired_errors(cases: pd.DataFrame, before: str, after: str, unit: str = "anatomy") -> PairedErrors | None:
    """Compare two columns of errors case by case, the anatomy as the independent unit.

    Parameters
    ----------
    cases : pandas.DataFrame
        One row a case.
    before, after : str
        Columns of the errors in mm.
    unit : str, optional
        Column of the anatomy.

    Returns
    -------
    PairedErrors or None
        The comparison over the rows in which both are finite; None if there is none.
    """
    both = cases.loc[np.isfinite(cases[[before, after]].to_numpy(float)).all(axis=1)]
    if not len(both):
        return None
    first, second = (by_unit(both, column, unit) for column in (before, after))
    change = (second - first).to_numpy()
    return PairedErrors(
        len(both),
        int((both[after] < both[before]).sum()),
        int((both[after] > both[before]).sum()),
        float(first.mean()),
        float(second.mean()),
        Bootstrap()(change),
        Bootstrap().ratio(second, first),
        int((change < 0).sum()),
        float(SignedRank()(second, first).p),
    )


def started(cases: pd.DataFrame) -> pd.DataFrame:
    """Select the cases of the right vessel whose rigid pose is a start for a displacement.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of a method with the columns of ``DisplacementScore``.

    Returns
    -------
    pandas.DataFrame
        The rows with a result at most ``NO_START_MM`` off the true rigid pose.
    """
    own = cases["same_vessel"].astype(bool) & np.isfinite(cases[DEFORMED].astype(float))
    return cases[own & (cases["tre_rigid_mm"] <= NO_START_MM)]


def deformed_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Compute the metrics of a method's displacements.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method.

    Returns
    -------
    dict
        Scalars by name: numbers of cases compared, left out and folding; for the targets of each part means in mm
        before (``rigid_<part>_mm``) and after (``deformed_<part>_mm``), their difference with its bounds, and the
        share of cases that are better. Empty for a rigid method.
    """
    if DEFORMED not in cases:
        return {}
    compared = started(cases)
    found = {
        "deformed_cases": float(len(compared)),
        "deformed_left_out": float(len(cases) - len(compared)),
        "folding_cases": float(folding(cases).sum()),
    }
    for part, (before, after) in PARTS.items():
        pair = paired_errors(compared, before, after)
        if pair is None:
            continue
        found |= {
            f"rigid_{part}_mm": pair.before_mm,
            f"deformed_{part}_mm": pair.after_mm,
            f"deformed_{part}_change_mm": pair.change_mm.estimate,
            f"deformed_{part}_change_mm_low": pair.change_mm.low,
            f"deformed_{part}_change_mm_high": pair.change_mm.high,
            f"deformed_{part}_better_rate": pair.better / pair.cases,
        }
    return found


def folding(cases: pd.DataFrame) -> pd.Series:
    """Mark the cases whose displacement folds.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows with ``jacobian_min``.

    Returns
    -------
    pandas.Series
        Truth values by row.
    """
    return cases["jacobian_min"] <= 0


def deformed_table(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Tabulate errors before and after the displacement.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method.

    Returns
    -------
    dict
        One table with a row for each part of the targets; empty for a rigid method or without a case to compare.
    """
    import pandas as pd

    rows = [
        {"targets": part, **_row(pair)}
        for part, columns in PARTS.items()
        if DEFORMED in cases and (pair := paired_errors(started(cases), *columns)) is not None
    ]
    return {"rigid and deformed": pd.DataFrame(rows)} if rows else {}


def describe_deformed(cases: pd.DataFrame) -> tuple[str, ...]:
    """Say what the displacements bring.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method.

    Returns
    -------
    tuple of str
        Sentences; none for a rigid method.
    """
    if DEFORMED not in cases:
        return ()
    compared, folds = started(cases), folding(cases)
    said = []
    for part in ("covered", "uncovered"):
        pair = paired_errors(compared, *PARTS[part])
        if pair is None:
            continue
        bounds = ""
        if np.isfinite(pair.change_mm.low):
            bounds = (
                f" (difference {pair.change_mm.estimate:+.2f} mm, 95 % interval over {pair.change_mm.units} anatomies "
                f"{pair.change_mm.low:+.2f} to {pair.change_mm.high:+.2f})"
            )
        said.append(
            f"Material points, {part}: {pair.before_mm:.2f} mm after the rigid pose, {pair.after_mm:.2f} mm after "
            f"the displacement{bounds}; better in {pair.better} of {pair.cases} cases, worse in {pair.worse}."
        )
    if left_out := len(cases) - len(compared):
        said.append(
            f"{left_out} of {len(cases)} cases are not compared: no result, another vessel, or a rigid pose more than "
            f"{NO_START_MM:g} mm off the true one."
        )
    first = f" (first: {cases.loc[folds, 'case'].iloc[0]})" if folds.any() else ""
    said.append(
        f"{int(folds.sum())} of {int(cases['jacobian_min'].notna().sum())} displacements fold{first}."
    )
    return tuple(said)


def _row(pair: PairedErrors) -> dict[str, Any]:
    return {
        "cases": pair.cases,
        "rigid_mm": pair.before_mm,
        "deformed_mm": pair.after_mm,
        "ratio": pair.ratio.estimate,
        "ratio_low": pair.ratio.low,
        "ratio_high": pair.ratio.high,
        "cases_better": pair.better,
        "cases_worse": pair.worse,
        "anatomies": pair.change_mm.units,
        "anatomies_better": pair.anatomies_better,
        "change_mm": pair.change_mm.estimate,
        "change_mm_low": pair.change_mm.low,
        "change_mm_high": pair.change_mm.high,
        "p": pair.p,
    }
