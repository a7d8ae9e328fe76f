"""What the scores of a benchmark say: rates with intervals, what was accepted wrongly, and whether doubt was right."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.benchmark.metrics import (
    RIGHT,
    benchmark_metrics,
    doubted,
    each_method,
    own_vessel,
    success_interval,
)
from experiments.statistics import holm, mcnemar
from registration.benchmark.cases import UNDEFORMED
from registration.rigid.result import ACCEPTED

if TYPE_CHECKING:
    import pandas as pd

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
# What the blocks are compared by: first errors, then judgements.
BLOCK_ERRORS = (
    "tre_mm_mean",
    "tre_mm_median",
    "tre_rigid_mm_mean",
    "lowest_tre_mm_mean",
    "interval_coverage_rate",
    "interval_coverage_rate_low",
    "interval_coverage_rate_high",
    "high_over_error_median",
    "runtime_s_median",
)
BLOCK_JUDGEMENTS = (
    "acceptance_rate",
    "right_accepted_rate",
    "accepted_wrong_rate",
    "accepted_wrong_rate_low",
    "accepted_wrong_rate_high",
    "wrong_vessel_accepted_rate",
    "wrong_vessel_accepted_rate_low",
    "wrong_vessel_accepted_rate_high",
    "risk_area_tre_high_mm",
)


def benchmark_tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Make the tables of a benchmark.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, as ``score_result`` gives them, with a column ``method``.

    Returns
    -------
    dict
        Tables by title: all methods, each method by block and by kind of case, results accepted wrongly, results
        not accepted, and the paired comparison of methods. Tables that would be empty are absent.
    """
    import pandas as pd

    tables = {}
    if own_vessel(cases).shape[0]:
        tables["methods"] = pd.DataFrame([_method_row(name, own) for name, own in each_method(cases)])
    tables |= _by_block(cases)
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
    own_cases = own_vessel(cases)
    if len(unsure := own_cases[doubted(own_cases)]):
        columns = ["method", *LISTED, "second_pose_gap", "second_tre_mm", "ambiguous_rightly"]
        tables["not accepted"] = unsure[columns]
    if (compared := compare_methods(cases)) is not None:
        tables["comparison of methods"] = compared
    return {f"{name}{_note(cases)}": table for name, table in tables.items()}


def _by_block(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Errors and judgements of each method in each block; none of rigid sweeps of the right vessel alone."""
    import pandas as pd

    if not ((cases["block"] != UNDEFORMED) & (cases["block"] != "")).any():
        return {}
    errors, judgements = [], []
    for name, own in each_method(cases):
        for block in own["block"].drop_duplicates():
            part = own[own["block"] == block]
            found, place = benchmark_metrics(part), {"method": name, "block": block}
            shares = {f"{RIGHT}_rate{end}": np.nan for end in ("", "_low", "_high")} | found
            right = {
                "cases": len(own_vessel(part)),
                "success_tre_rate": shares[f"{RIGHT}_rate"],
                "low": shares[f"{RIGHT}_rate_low"],
                "high": shares[f"{RIGHT}_rate_high"],
            }
            errors.append(place | right | {key: found.get(key, np.nan) for key in BLOCK_ERRORS})
            counts = {"cases": len(part), "wrong_vessels": len(part) - len(own_vessel(part))}
            judgements.append(place | counts | {key: found.get(key, np.nan) for key in BLOCK_JUDGEMENTS})
    return {
        "errors by block": pd.DataFrame(errors),
        "judgements by block": pd.DataFrame(judgements).dropna(axis="columns", how="all"),
    }


def _method_row(name: str, cases: pd.DataFrame) -> dict[str, Any]:
    found, interval = benchmark_metrics(cases), success_interval(cases)
    return {
        "method": name,
        "cases": len(cases),
        _right(cases): found.get(f"{RIGHT}_rate", np.nan),
        "low": interval.low,
        "high": interval.high,
        **{key: found.get(key, float("nan")) for key in QUOTED},
    }


def _kind_row(cases: pd.DataFrame) -> dict[str, Any]:
    found = benchmark_metrics(cases)
    keys = QUOTED if len(own_vessel(cases)) else (*QUOTED, "wrong_vessel_accepted_rate")
    return {
        "cases": len(cases),
        _right(cases): found.get(f"{RIGHT}_rate", np.nan),
        "low": found.get(f"{RIGHT}_rate_low", np.nan),
        "high": found.get(f"{RIGHT}_rate_high", np.nan),
        **{key: found.get(key, float("nan")) for key in keys if key != "runtime_s_median"},
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

    own = {name: part.set_index("case") for name, part in each_method(own_vessel(cases))}
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
