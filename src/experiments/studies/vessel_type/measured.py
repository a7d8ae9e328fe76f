"""What the study of vessel types measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.analysis.segmentation.case_table import pool
from experiments.analysis.segmentation.levels import compare_levels, levels, plain_name, with_data_choices
from experiments.analysis.segmentation.measured import measured_difference, measured_dsc
from experiments.outcome import JobResult
from experiments.reporting.measured import Measured
from experiments.reporting.published import name_of
from experiments.studies.vessel_type.report import FACTORS, STUDY, by_condition, published_of


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the DSC of each vessel with districts aggregated, and what aggregation changed.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values for the published ones.
    """
    shown = by_condition(with_data_choices(pool(results, factors=("vessels", "districts"))))
    found = [
        measured_dsc(name_of(STUDY, value), f"{model}, {level['vessel']}, districts aggregated", part)
        for level, model, part in levels(shown, FACTORS)
        for value in published_of(level | {"model": plain_name(model)})
    ]
    for vessel in shown["vessel"].drop_duplicates():
        own = shown[shown["vessel"] == vessel]
        compared = compare_levels(own, "trained_on", "unseen cases", ("tested_on",))
        for row in compared[compared["metric"] == "dsc"].to_dict("records") if len(compared) else []:
            where, simulated = f"{vessel}, {row['dataset']}", bool(own["simulated"].all())
            found.append(measured_difference(f"aggregation_{vessel}", where, row, simulated))
    return found
