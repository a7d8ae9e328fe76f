"""The tables of the segmentation study: by fold, with intervals over groups, and in words for a page."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import (
    DISTANCES,
    dataset_label,
    distance,
    distances,
    groups,
    seeds,
)
from experiments.analysis.segmentation.comparison_findings import comparison_table
from experiments.analysis.segmentation.summary import RATES, bounded_summary, plain_summary, unpenalised

if TYPE_CHECKING:
    import pandas as pd


def table(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate DSC and HD95 by model, data set, seed (if there are several) and fold, and over all of them.

    The HD95 of the cases in which both masks show a vessel follows the penalised one, with their number.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    pandas.DataFrame
        Numbers, one row for each fold of each model and data set, then one over all folds.
    """
    import pandas as pd

    rows = []
    for model, label, group in groups(cases):
        for place, part in _parts(group, len(seeds(group)) > 1):
            numbers = plain_summary(part)
            row: dict[str, object] = {"model": model, "dataset": label, **place}
            row["cases"] = part["case_id"].nunique()
            for score in ("dsc", *distances(cases)):
                row |= {
                    f"{score}_{kind}": numbers.get(f"{score}_{kind}", np.nan)
                    for kind in ("mean", "std", "median")
                }
            for name in unpenalised(cases):
                row |= {f"{name}_{kind}": numbers.get(f"{name}_{kind}", np.nan) for kind in ("mean", "n")}
            rows.append(row | {f"{name}_rate": numbers.get(f"{name}_rate", np.nan) for name in RATES})
    return _whole(pd.DataFrame(rows))


def intervals(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate every model on every data set with 95 % intervals: DSC, HD95, missed vessels, false alarms.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    pandas.DataFrame
        Numbers, one row for each model and data set.

    Notes
    -----
    Means are over cases, each once; their intervals resample whole groups (see ``Bootstrap``). Wilson's
    intervals of the rates count cases as independent, which cases of one group are not: they are too narrow
    for that reason. The HD95 without penalty is shown with its number of cases and has no interval, because
    it leaves out different cases for each model.
    """
    import pandas as pd

    rows = []
    for model, label, group in groups(cases):
        numbers = bounded_summary(group)
        shown = [
            *(f"dsc_{kind}" for kind in ("mean", "ci_low", "ci_high")),
            *(["dsc_seed_std"] if "dsc_seed_std" in numbers else []),
            *(f"{name}_{kind}" for name in distances(cases) for kind in ("mean", "ci_low", "ci_high")),
            *(f"{name}_{kind}" for name in unpenalised(cases) for kind in ("mean", "n")),
            *(f"{name}_{kind}" for name in RATES for kind in ("rate", "rate_low", "rate_high", "n")),
        ]
        row: dict[str, object] = {"model": model, "dataset": label, "groups": group["group"].nunique()}
        rows.append(row | {name: numbers.get(name, np.nan) for name in shown})
    return _whole(pd.DataFrame(rows))


def tables(cases: pd.DataFrame, compared: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Make the tables that a study prints.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.
    compared : pandas.DataFrame
        As ``compare_models`` gives it; may be empty.

    Returns
    -------
    dict
        Tables by title: all models with intervals, their comparison if there is one, and each data set by
        fold.
    """
    shown = {"segmentation": in_words(intervals(cases))}
    if len(compared):
        shown["comparison"] = comparison_table(compared)
    for label in dict.fromkeys(label for _, label, _ in groups(cases)):
        part = cases[
            [dataset_label(*of) == label for of in zip(cases["dataset"], cases["simulated"], strict=True)]
        ]
        shown[f"folds of {label}"] = table(_in_one_unit(part)).drop(columns="dataset")
    return shown


def _in_one_unit(cases: pd.DataFrame) -> pd.DataFrame:
    """Without the distances that the cases do not have, and without those in px where all have them in mm."""
    kept = cases.dropna(axis="columns", how="all")
    measure = distance(cases)
    if measure == DISTANCES[0] and kept[measure].notna().equals(kept["dsc"].notna()):
        kept = kept[[name for name in kept if not str(name).endswith("_px")]]
    return kept


def _parts(cases: pd.DataFrame, several_seeds: bool) -> list[tuple[dict[str, object], pd.DataFrame]]:
    """The rows that each line of the table sums up: every fold of every seed, each seed, all."""
    parts: list[tuple[dict[str, object], pd.DataFrame]] = []
    by_seed: list[tuple[dict[str, object], pd.DataFrame]] = [({}, cases)]
    if several_seeds:
        by_seed = [({"seed": str(seed)}, part) for seed, part in cases.groupby("seed")]
    for place, part in by_seed:
        folds = [({**place, "fold": str(fold)}, rows) for fold, rows in part.groupby("fold")]
        parts += [*folds, ({**place, "fold": "all"}, part)] if len(folds) > 1 else folds
    return [*parts, ({"seed": "all", "fold": "all"}, cases)] if several_seeds else parts


def in_words(numbers: pd.DataFrame, names: Sequence[str] = ("model", "dataset", "groups")) -> pd.DataFrame:
    """Write the table of intervals with a text in each field, for a page or a terminal's width.

    Parameters
    ----------
    numbers : pandas.DataFrame
        As ``intervals`` gives it, with any further columns.
    names : sequence of str, optional
        Columns that are kept as they are.

    Returns
    -------
    pandas.DataFrame
        One row for each of ``numbers``.
    """
    import pandas as pd

    rows = []
    for row in numbers.to_dict("records"):
        measure = next((name for name in DISTANCES if not np.isnan(row.get(f"{name}_mean", np.nan))), None)
        words = {name: row[name] for name in names} | {"dsc": _interval(row, "dsc", 3)}
        words |= {"hd95": "", "hd95_unpenalised": ""}
        if measure is not None:
            unit = measure.removeprefix("hd95_")
            free = f"hd95_unpenalised_{unit}"
            words["hd95"] = f"{_interval(row, measure, 2)} {unit}"
            if row.get(f"{free}_n"):
                words["hd95_unpenalised"] = f"{row[f'{free}_mean']:.2f} (n {row[f'{free}_n']})"
        rows.append(words | {f"{name}_rate": _rate(row, name) for name in RATES})
    return pd.DataFrame(rows)


def _interval(row: Mapping[Hashable, Any], score: str, digits: int) -> str:
    mean, low, high = (row.get(f"{score}_{kind}", np.nan) for kind in ("mean", "ci_low", "ci_high"))
    if np.isnan(mean):
        return ""
    return f"{mean:.{digits}f}" + ("" if np.isnan(low) else f" [{low:.{digits}f}, {high:.{digits}f}]")


def _rate(row: Mapping[Hashable, Any], name: str) -> str:
    """A rate in percent with its interval."""
    if not row[f"{name}_n"]:
        return ""
    rate, low, high = (100 * row[f"{name}_{kind}"] for kind in ("rate", "rate_low", "rate_high"))
    return f"{rate:.1f} [{low:.1f}, {high:.1f}] %"


def _whole(shown: pd.DataFrame) -> pd.DataFrame:
    """Numbers of cases as whole numbers; none where there are none."""
    counts = [name for name in shown if str(name).endswith("_n")]
    return shown.assign(**{str(name): shown[name].fillna(0).astype(int) for name in counts})
