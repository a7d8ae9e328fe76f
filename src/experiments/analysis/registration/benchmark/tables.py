"""What the scores of a benchmark say: rates with intervals, what was accepted wrongly, and whether doubt was right."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.pose_scores import judges
from experiments.analysis.registration.risk_coverage import risk_coverage
from experiments.statistics import Bootstrap, Interval, holm, mcnemar, summary, wilson_interval
from registration.rigid.result import ACCEPTED, NOT_JUDGED

if TYPE_CHECKING:
    import pandas as pd

SUMMARISED = ("rmse_mm", "tre_mm", "tre_max_mm", "rotation_error_deg", "translation_error_mm")
RIGHT = "success_tre_symmetric"
# The orders in which results are accepted: the larger of these two, the greater the doubt.
DOUBTS = {"tre_high_mm": 1.0, "ambiguity_gap": -1.0}
LISTED = ("case", "kind", "verdict", "tre_mm", "tre_symmetric_mm", "rmse_mm", "ambiguity_gap", "tre_high_mm")
QUOTED = (
    "acceptance_rate",
    "success_accepted_rate",
    "interval_coverage_rate",
    "rmse_mm_median",
    "tre_mm_median",
    "tre_mm_p95",
    "runtime_s_median",
)


def benchmark_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Compute one method's rates with Wilson 95 % bounds, summaries of its errors, and its areas of risk.

    ``success_tre`` is over all cases, ``success_accepted`` over those that the method accepted,
    ``acceptance`` their share; a method that does not judge its results has neither of the last two.
    ``interval_coverage`` is the share of predicted 90 % intervals that hold the error, up to symmetry.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method, as ``score_result`` gives them.

    Returns
    -------
    dict
        Scalars by the name of the metric; errors in mm and deg, run time in s. Metrics that are not defined
        are absent.
    """
    judging = judges(cases)
    accepted = cases[cases["verdict"] == ACCEPTED] if judging else cases.iloc[:0]
    found = {"cases": float(len(cases)), "cases_without_result": float((cases["error"] != "").sum())}
    for name, values in (
        ("success_tre", cases["success_tre"]),
        ("success_tre_symmetric", cases[RIGHT]),
        ("success", cases.loc[cases["rmse_mm"].notna(), "success"]),
        ("acceptance", cases["verdict"] == ACCEPTED if judging else accepted[RIGHT]),
        ("success_accepted", accepted[RIGHT]),
        ("interval_coverage", cases["covered_by_interval"].dropna()),
        ("interval_coverage_accepted", accepted["covered_by_interval"].dropna()),
        ("ambiguous_rightly", cases["ambiguous_rightly"].dropna()),
    ):
        found |= _rate(name, values)
    for name in SUMMARISED:
        if cases[name].notna().all():
            found |= summary(name, cases[name].tolist())
    if cases["runtime_s"].notna().all():
        found |= summary("runtime_s", cases["runtime_s"].tolist())
    for name, sign in DOUBTS.items():
        if cases[name].notna().any():
            curve = risk_coverage(~cases[RIGHT].to_numpy(bool), sign * cases[name].to_numpy(float))
            found[f"risk_area_{name}"] = curve.area
    if judging:
        found["accepted_failures"] = float((~accepted[RIGHT].astype(bool)).sum())
        found["over_cautious"] = float(len(over_cautious(cases)))
    return found


def over_cautious(cases: pd.DataFrame) -> pd.DataFrame:
    """Select results that were right and not accepted, although no second pose explains their case.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one or several methods.

    Returns
    -------
    pandas.DataFrame
        The rows among ``cases``.
    """
    return cases[doubted(cases) & cases[RIGHT] & (cases["ambiguous_rightly"] == 0)]


def doubted(cases: pd.DataFrame) -> pd.Series:
    """Mark the results that their own method did not accept.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one or several methods.

    Returns
    -------
    pd.Series
        Truth values by row of ``cases``; False where the method does not judge its results.
    """
    return ~cases["verdict"].isin([ACCEPTED, NOT_JUDGED])


def success_interval(cases: pd.DataFrame) -> Interval:
    """Compute the share of right results with its interval by the bootstrap over anatomies.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method.

    Returns
    -------
    Interval
        The share (0 to 1) and its 95 % interval; the bounds are NaN for a single anatomy.
    """
    return Bootstrap("mean_of_cases")(cases[RIGHT].astype(float), cases["anatomy"].tolist())


def benchmark_tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Make the tables of a benchmark.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, as ``score_result`` gives them, with a column ``method``.

    Returns
    -------
    dict
        Tables by title: all methods, each method by kind of case, results accepted wrongly, results not
        accepted, and the paired comparison of methods. Tables that would be empty are absent.
    """
    import pandas as pd

    tables = {"methods": pd.DataFrame([_method_row(name, own) for name, own in each_method(cases)])}
    kinds = [
        {"method": name, "kind": kind, **_kind_row(own[own["kind"] == kind])}
        for name, own in each_method(cases)
        for kind in own["kind"].drop_duplicates()
    ]
    if len(cases["kind"].drop_duplicates()) > 1:
        tables["by kind"] = pd.DataFrame(kinds)
    wrong = cases[(cases["verdict"] == ACCEPTED) & ~cases[RIGHT].astype(bool)]
    if len(wrong):
        tables["accepted wrongly"] = wrong[["method", *LISTED, "second_pose_gap", "second_tre_mm"]]
    if len(unsure := cases[doubted(cases)]):
        columns = ["method", *LISTED, "second_pose_gap", "second_tre_mm", "ambiguous_rightly"]
        tables["not accepted"] = unsure[columns]
    if (compared := compare_methods(cases)) is not None:
        tables["comparison of methods"] = compared
    return {f"{name}{_note(cases)}": table for name, table in tables.items()}


def each_method(cases: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Split the cases by method.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, with a column ``method``.

    Yields
    ------
    tuple[str, pandas.DataFrame]
        Name and rows of each method, in the order they first occur.
    """
    for name in cases["method"].drop_duplicates():
        yield str(name), cases[cases["method"] == name]


def _rate(name: str, values: pd.Series) -> dict[str, float]:
    """A rate and its bounds, or nothing where there is nothing to count."""
    if not len(values):
        return {}
    share = wilson_interval(int(values.sum()), len(values))
    return {f"{name}_rate": share.rate, f"{name}_rate_low": share.low, f"{name}_rate_high": share.high}


def _method_row(name: str, cases: pd.DataFrame) -> dict[str, Any]:
    found, interval = benchmark_metrics(cases), success_interval(cases)
    return {
        "method": name,
        "cases": len(cases),
        _right(cases): found[f"{RIGHT}_rate"],
        "low": interval.low,
        "high": interval.high,
        **{key: found.get(key, float("nan")) for key in QUOTED},
    }


def _kind_row(cases: pd.DataFrame) -> dict[str, Any]:
    found = benchmark_metrics(cases)
    return {
        "cases": len(cases),
        _right(cases): found[f"{RIGHT}_rate"],
        "low": found[f"{RIGHT}_rate_low"],
        "high": found[f"{RIGHT}_rate_high"],
        **{key: found.get(key, float("nan")) for key in QUOTED if key != "runtime_s_median"},
    }


def _right(cases: pd.DataFrame) -> str:
    """What the rate of right results is called: the two are one where no vessel is symmetric."""
    return f"{RIGHT}_rate" if cases["symmetric"].any() else "success_tre_rate"


def compare_methods(cases: pd.DataFrame) -> pd.DataFrame | None:
    """Compare each pair of methods by McNemar's test on the cases that both have.

    The anatomy is the independent unit of the test.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, with a column ``method``.

    Returns
    -------
    pandas.DataFrame or None
        One row for each pair, with p-values before and after Holm's adjustment; None if no pair shares a
        case.
    """
    import pandas as pd

    own = {name: part.set_index("case") for name, part in each_method(cases)}
    rows = []
    for first, second in combinations(own, 2):
        shared = own[first].index.intersection(own[second].index)
        if not len(shared):
            continue
        one, other = own[first].loc[shared], own[second].loc[shared]
        test = mcnemar(one[RIGHT].tolist(), other[RIGHT].tolist(), one["anatomy"].tolist())
        rows.append({"first": first, "second": second, **vars(test)})
    if not rows:
        return None
    table = pd.DataFrame(rows).rename(columns={"units": "anatomies", "rows": "cases"})
    return table.assign(p_holm=holm(table["p"].to_numpy()))


def _note(cases: pd.DataFrame) -> str:
    return ", simulated" if "simulated" in cases and bool(np.all(cases["simulated"])) else ""
