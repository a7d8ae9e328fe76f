"""Methods against each other on the same problems, with the anatomy as the unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments.statistics import Bootstrap, SignedRank, by_unit, holm, mcnemar
from experiments.studies.robustness.metrics import PROBLEM, methods

if TYPE_CHECKING:
    import pandas as pd

# What the others are set against where it was run, else the first method.
REFERENCE = "multistart"


def comparison(cases: pd.DataFrame) -> pd.DataFrame:
    """Compare each method with the reference: success on the same problems, and the tests.

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
        One row per method other than the reference.
    """
    import pandas as pd

    names = methods(cases)
    reference = REFERENCE if REFERENCE in names else names[0]
    anatomies = cases["anatomy"].nunique()
    rows = [_compared(cases, reference, other, alone=anatomies == 1) for other in names if other != reference]
    found = pd.DataFrame([row for row in rows if row is not None])
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
        One row per method: mean, its bootstrap interval with the anatomy as the unit, and the worst anatomy;
        no rows for a single anatomy, which says nothing about others.
    """
    import pandas as pd

    if len(cases["anatomy"].unique()) < 2:
        return pd.DataFrame()
    rows = []
    for name in methods(cases):
        own = cases[cases["method"] == name].astype({"success_tre": float})
        rates = by_unit(own, "success_tre", "anatomy")
        interval = Bootstrap()(rates)
        rows.append(
            {
                "method": name,
                "anatomies": interval.units,
                "trials": len(own),
                "success_tre_rate": interval.estimate,
                "success_tre_rate_low": interval.low,
                "success_tre_rate_high": interval.high,
                "worst_anatomy": str(rates.idxmin()),
                "worst_rate": float(rates.min()),
            }
        )
    return pd.DataFrame(rows)


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
