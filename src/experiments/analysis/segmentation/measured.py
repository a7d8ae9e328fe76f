"""Scores of masks that stand next to published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import groups, is_smoke, place_of, pool
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED, Measured, p_text
from experiments.reporting.published import published_values

if TYPE_CHECKING:
    import pandas as pd

STUDY = "segmentation"


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the mean DSC of each model on each published data set, and how models differ on any.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of ``study=segmentation``.

    Returns
    -------
    list of Measured
        Values for the published ones.
    """
    cases = pool(results)
    known = published_values()[STUDY]["dsc"].dataset
    found = [
        measured_dsc("dsc", f"{model} on {label}", part)
        for model, label, part in groups(cases)
        if place_of(label).split(" ")[0] in known
    ]
    compared = compare_models(cases)
    for row in compared[compared["metric"] == "dsc"].to_dict("records") if len(compared) else []:
        found.append(measured_difference("complexity", str(row["dataset"]), row, _is_simulated(cases, row)))
    return found


def measured_dsc(name: str, of: str, cases: pd.DataFrame, not_comparable: str = "") -> Measured:
    """Give the mean DSC of one model on one data set.

    Parameters
    ----------
    name : str
        Name of the published value.
    of : str
        Model and data.
    cases : pandas.DataFrame
        Per-case table of that model and data set.
    not_comparable : str, optional
        Why real data cannot be held against the published value; of simulated data this is known.

    Returns
    -------
    Measured
        The mean with its interval over groups.
    """
    numbers = bounded_summary(cases)
    return Measured(
        name,
        of,
        numbers.get("dsc_mean", np.nan),
        numbers.get("dsc_ci_low", np.nan),
        numbers.get("dsc_ci_high", np.nan),
        cases["group"].nunique(),
        "groups",
        f"{cases['case_id'].nunique()} cases",
        SIMULATED if cases["simulated"].all() else not_comparable,
        bool(is_smoke(cases).all()),
    )


def measured_difference(name: str, where: str, row: Mapping[Any, Any], simulated: bool) -> Measured:
    """Give how two models, or one model after two trainings, differ.

    Parameters
    ----------
    name : str
        Name of the published sentence.
    where : str
        What both were scored on.
    row : Mapping
        Row of ``compare_models``.
    simulated : bool
        Whether the data are simulated.

    Returns
    -------
    Measured
        The mean difference with its interval over groups, and the test.
    """
    test = p_text(row["p_holm"], row["min_attainable_p"], "signed-rank test, Holm")
    return Measured(
        name,
        f"{row['first']} minus {row['second']}, {where}",
        row["mean_difference"],
        row["mean_difference_ci_low"],
        row["mean_difference_ci_high"],
        int(row["units"]),
        "groups",
        f"{row['verdict']}; {test}",
        SIMULATED if simulated else "",
    )


def _is_simulated(cases: pd.DataFrame, row: Mapping[Any, Any]) -> bool:
    own = cases[cases["dataset"] == place_of(str(row["dataset"]))]
    return bool(own["simulated"].all())
