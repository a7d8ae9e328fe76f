"""The comparison of models for a reader: a narrow table, metrics of a run, sentences that claim what a test shows."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import place_of
from experiments.analysis.segmentation.comparison import ALPHA

if TYPE_CHECKING:
    import pandas as pd

DIGITS = {"dsc": 3, "hd95_mm": 2, "hd95_px": 2}
# Comparisons whose p-values are adjusted together.
FAMILY = ("trained_on", "dataset", "metric")
TRACKED = (
    *("mean_difference", "mean_difference_ci_low", "mean_difference_ci_high"),
    *("p", "p_holm", "min_attainable_p", "rank_biserial", "equivalence_p_holm"),
)


def comparison_table(compared: pd.DataFrame) -> pd.DataFrame:
    """Make a narrow table of text of the comparison: differences with intervals, p-values, verdicts.

    Parameters
    ----------
    compared : pandas.DataFrame
        As ``compare_models`` gives it.

    Returns
    -------
    pandas.DataFrame
        One row for each pair, data set and metric.
    """
    import pandas as pd

    rows = []
    for row in compared.to_dict("records"):
        kept = {name: row[name] for name in (*FAMILY, "units") if name in row}
        rows.append(
            {
                **kept,
                "models": f"{row['first']} - {row['second']}",
                "mean_difference": _difference(row, "[{}, {}]"),
                "rank_biserial": f"{row['rank_biserial']:+.2f}" if row["units"] else "",
                **{name: _p(row[name]) for name in ("p_holm", "min_attainable_p")},
                "verdict": row["verdict"],
            }
        )
    return pd.DataFrame(rows)


def comparison_metrics(compared: pd.DataFrame) -> dict[str, float]:
    """Make metrics of a run from the comparison.

    Parameters
    ----------
    compared : pandas.DataFrame
        As ``compare_models`` gives it.

    Returns
    -------
    dict
        Scalars under ``<first> - <second>/<dataset>/<metric>_<number>``; numbers that are NaN are absent.
    """
    metrics: dict[str, float] = {}
    for row in compared.to_dict("records"):
        trained = f"{row['trained_on']}/" if "trained_on" in row else ""
        place = f"{row['first']} - {row['second']}/{trained}{place_of(row['dataset'])}/{row['metric']}"
        metrics |= {f"{place}_{name}": row[name] for name in TRACKED if not np.isnan(row[name])}
    return metrics


def describe_comparison(compared: pd.DataFrame) -> tuple[str, ...]:
    """Describe the comparison in sentences that claim what its tests show and nothing else.

    Parameters
    ----------
    compared : pandas.DataFrame
        As ``compare_models`` gives it.

    Returns
    -------
    tuple of str
        One sentence for each pair, data set and metric.
    """
    if not len(compared):
        return ()
    families = compared.groupby([name for name in FAMILY if name in compared])["min_attainable_p"]
    # The smallest p of a family is multiplied by the number of its tests: above the level, none can be significant.
    least = (families.transform("min") * families.transform("count")).clip(upper=1)
    rows = compared.assign(family_least=least).to_dict("records")
    return tuple(_sentence(row) for row in rows)


def _sentence(row: Mapping[Hashable, Any]) -> str:
    trained = f"Trained on {row['trained_on']}, tested on" if "trained_on" in row else "On"
    place = f"{trained} {row['dataset']}, {row['metric']} of {row['first']} less that of {row['second']}"
    left_out = f" ({row['left_out']} cases not scored by all models left out)" if row["left_out"] else ""
    if not row["units"]:
        return f"{place}: no case was scored by all models."
    said = (
        f"{place}: mean difference {_difference(row, '(95 % interval {} to {})')} over {row['units']} groups"
        f"{left_out}; "
        f"{row['verdict']} (exact signed-rank p = {_p(row['p'])}, with Holm's adjustment {_p(row['p_holm'])}; "
        f"rank-biserial correlation {row['rank_biserial']:+.2f})"
    )
    if row["family_least"] > ALPHA:
        said += (
            f"; so few groups can show none: the least p they can give is {_p(row['min_attainable_p'])}, "
            f"{_p(row['family_least'])} after adjustment"
        )
    if row["equivalent"]:
        said += f"; equivalence p = {_p(row['equivalence_p_holm'])} after adjustment"
    return f"{said}."


def _difference(row: Mapping[Hashable, Any], bounds: str) -> str:
    """The mean difference and, where there is one, its interval in the words of ``bounds``."""
    if not row["units"]:
        return ""
    digits = DIGITS[row["metric"]]
    shown = [
        f"{row[name]:+.{digits}f}"
        for name in ("mean_difference", "mean_difference_ci_low", "mean_difference_ci_high")
    ]
    return shown[0] if np.isnan(row["mean_difference_ci_low"]) else f"{shown[0]} {bounds.format(*shown[1:])}"


def _p(value: float) -> str:
    if np.isnan(value):
        return ""
    return f"{value:.3f}" if value >= 0.001 else f"{value:.1e}"
