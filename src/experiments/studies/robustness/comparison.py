"""Methods against each other on the same problems, with the anatomy as the unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments.statistics import Bootstrap, SignedRank, by_unit, holm, mcnemar
from experiments.studies.robustness.design import CONDITION
from experiments.studies.robustness.grouping import PROBLEM, by_condition, methods

if TYPE_CHECKING:
    import pandas as pd

# What the others are set against where it was run, else the first method.
REFERENCE = "multistart"


def comparison(cases: pd.DataFrame) -> pd.DataFrame:
    """Compare each method with the reference: success on the same problems of one condition, and the tests.

    With several anatomies McNemar's test counts each anatomy's surplus of problems won, and the signed-rank
    test compares success rates by anatomy; both adjusted by Holm. With a single anatomy nothing can be said
    about others: ``unit`` is then the trial, McNemar's p describes the trials alone, and no other test is
    made.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    pandas.DataFrame
        One row per condition and method other than the reference.
    """
    import pandas as pd

    names = methods(cases)
    reference = REFERENCE if REFERENCE in names else names[0]
    anatomies = cases["anatomy"].nunique()
    rows = [
        _told(condition) | row
        for condition, part in by_condition(cases)
        for other in names
        if other != reference and (row := _compared(part, reference, other, alone=anatomies == 1)) is not None
    ]
    found = pd.DataFrame(rows)
    for name in ("mcnemar_p", "signed_rank_p"):
        if name in found and anatomies > 1:
            found[f"{name}_holm"] = holm(found[name])
    return found


def by_anatomy(cases: pd.DataFrame) -> pd.DataFrame:
    """Summarise the success of each method over anatomies.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    pandas.DataFrame
        One row per condition and method: mean, its bootstrap interval with the anatomy as the unit, and the
        worst anatomy; no rows for a single anatomy, which says nothing about others.
    """
    import pandas as pd

    if len(cases["anatomy"].unique()) < 2:
        return pd.DataFrame()
    rows = [
        _told(condition) | _over_anatomies(name, part[part["method"] == name])
        for condition, part in by_condition(cases)
        for name in methods(part)
    ]
    return pd.DataFrame(rows)


def _told(condition: str) -> dict[str, object]:
    return {CONDITION: condition} if condition else {}


def _over_anatomies(name: str, cases: pd.DataFrame) -> dict[str, object]:
    rates = by_unit(cases.astype({"success_tre": float}), "success_tre", "anatomy")
    interval = Bootstrap()(rates)
    return {
        "method": name,
        "anatomies": interval.units,
        "trials": len(cases),
        "success_tre_rate": interval.estimate,
        "success_tre_rate_low": interval.low,
        "success_tre_rate_high": interval.high,
        "worst_anatomy": str(rates.idxmin()),
        "worst_rate": float(rates.min()),
    }


def _compared(cases: pd.DataFrame, reference: str, other: str, *, alone: bool) -> dict[str, object] | None:
    pairs = cases[cases["method"] == reference].merge(
        cases[cases["method"] == other], on=list(PROBLEM), suffixes=("_first", "_second")
    )
    if not len(pairs):
        return None
    units = list(range(len(pairs))) if alone else pairs["anatomy"].tolist()
    won = mcnemar(pairs["success_tre_first"], pairs["success_tre_second"], units)
    row: dict[str, object] = {
        "first": reference,
        "second": other,
        "unit": "trial (one anatomy: description only)" if alone else "anatomy",
        "units": won.units,
        "problems": won.rows,
        "first_only": won.first_only,
        "second_only": won.second_only,
        "mcnemar_p": won.p,
        "mcnemar_min_attainable_p": won.min_attainable_p,
    }
    if alone:
        return row
    rates = [
        by_unit(pairs.astype({name: float}), name, "anatomy")
        for name in ("success_tre_first", "success_tre_second")
    ]
    test = SignedRank()(*rates)
    return row | {
        "signed_rank_p": test.p,
        "signed_rank_min_attainable_p": test.min_attainable_p,
        "rank_biserial": test.rank_biserial,
    }
