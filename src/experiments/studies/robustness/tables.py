"""The tables of the robustness study: success and errors, what methods know of themselves, capture range, factors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.pose_scores import judges
from experiments.statistics import summary
from experiments.studies.robustness.comparison import by_anatomy, comparison
from experiments.studies.robustness.design import CROSSED
from experiments.studies.robustness.grouping import crossed, groups, with_condition
from experiments.studies.robustness.metrics import by_bin, capture_range_deg, rate_metrics

if TYPE_CHECKING:
    import pandas as pd

PIECE = ("method", "overlap", "place")


def tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Make all tables for which there are trials, each with rows of its own for every condition.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    dict
        Tables by title.
    """
    import pandas as pd

    turned, varied = crossed(cases), cases[cases["factor"] != CROSSED]
    piece = with_condition(cases, PIECE)
    found: dict[str, pd.DataFrame] = {}
    if len(turned):
        found["robustness"] = pd.DataFrame(
            [_errors(group, piece, key) for key, group in groups(turned, piece)]
        )
        judged = [(key, group) for key, group in groups(turned, piece) if judges(group)]
        if judged:
            found["verdicts"] = pd.DataFrame([_verdicts(group, piece, key) for key, group in judged])
        predicted = turned.groupby("method")["tre_high_mm"].transform("count") > 0
        if predicted.any():
            found["tre_intervals"] = pd.DataFrame(
                [_intervals(group, piece, key) for key, group in groups(turned[predicted], piece)]
            )
        rotation = with_condition(cases, ("method", "rotation"))
        if len(turned["rotation"].unique()) > 1:
            found["rotations"] = pd.DataFrame(
                [_errors(group, rotation, key) for key, group in groups(turned, rotation)]
            )
        if len(ranges := capture_ranges(turned)):
            found["capture_range"] = ranges
    if len(varied):
        level = with_condition(cases, ("method", "factor", "level"))
        found["factors"] = pd.DataFrame([_levels(group, level, key) for key, group in groups(varied, level)])
    if len(units := by_anatomy(cases)):
        found["anatomies"] = units
    if len(compared := comparison(cases)):
        found["comparison"] = compared
    return found


def capture_ranges(turned: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the capture range of each method on each piece, by kind of rotation.

    Parameters
    ----------
    turned : pandas.DataFrame
        Rows of the trials in which rotation and overlap are crossed.

    Returns
    -------
    pandas.DataFrame
        One row per condition, method, piece and kind of rotation, with the fewest trials that a bin had.
    """
    import pandas as pd

    columns = with_condition(turned, (*PIECE, "rotation"))
    rows = []
    for key, group in groups(turned.dropna(subset="angle_from_deg"), columns):
        bins = by_bin(group)
        rows.append(
            {
                **dict(zip(columns, key, strict=True)),
                "capture_range_deg": capture_range_deg(group),
                "bins": len(bins),
                "trials_a_bin": int(bins["trials"].min()),
                "lowest_rate": float((bins["successes"] / bins["trials"]).min()),
            }
        )
    return pd.DataFrame(rows)


def _errors(cases: pd.DataFrame, columns: tuple[str, ...], key: tuple[Any, ...]) -> dict[str, object]:
    rates = rate_metrics(cases)
    errors = _summaries(cases, "rmse_mm", "tre_mm")
    return {
        **dict(zip(columns, key, strict=True)),
        "trials": len(cases),
        **{name: rates[name] for name in _bounded("success_tre_rate")},
        "success_rate": rates["success_rate"],
        **{name: errors[name] for name in ("rmse_mm_median", "rmse_mm_p95", "tre_mm_median", "tre_mm_p95")},
        "low_rmse_wrong": int(rates["trials_low_rmse_wrong"]),
        "runtime_s_median": float(cases["runtime_s"].median()),
    }


def _verdicts(cases: pd.DataFrame, columns: tuple[str, ...], key: tuple[Any, ...]) -> dict[str, object]:
    rates = rate_metrics(cases)
    return {
        **dict(zip(columns, key, strict=True)),
        "trials": len(cases),
        "acceptance_rate": rates["acceptance_rate"],
        **{name: rates[name] for name in _bounded("success_tre_accepted_rate")},
        "accepted_failures": int((cases["accepted"] & ~cases["success_tre"]).sum()),
        "right_not_accepted": int((~cases["accepted"] & cases["success_tre"]).sum()),
        "no_result": int(rates["trials_failed"]),
    }


def _intervals(cases: pd.DataFrame, columns: tuple[str, ...], key: tuple[Any, ...]) -> dict[str, object]:
    rates, taken = rate_metrics(cases), cases[cases["accepted"]]
    return {
        **dict(zip(columns, key, strict=True)),
        "accepted": len(taken),
        **{name: rates[name] for name in _bounded("interval_coverage_accepted_rate")},
        "tre_low_mm_median": float(taken["tre_low_mm"].median()),
        "tre_high_mm_median": float(taken["tre_high_mm"].median()),
    }


def _levels(cases: pd.DataFrame, columns: tuple[str, ...], key: tuple[Any, ...]) -> dict[str, object]:
    rates = rate_metrics(cases)
    errors = _summaries(cases, "tre_mm")
    return {
        **dict(zip(columns, key, strict=True)),
        "trials": len(cases),
        **{name: rates[name] for name in _bounded("success_tre_rate")},
        "acceptance_rate": rates["acceptance_rate"],
        **{name: rates[name] for name in _bounded("success_tre_accepted_rate")},
        **{name: errors[name] for name in ("tre_mm_median", "tre_mm_p95")},
    }


def _bounded(name: str) -> tuple[str, str, str]:
    return name, f"{name}_low", f"{name}_high"


def _summaries(cases: pd.DataFrame, *names: str) -> Mapping[str, float]:
    return {key: value for name in names for key, value in summary(name, cases[name].tolist()).items()}
