"""What the study of variability measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.analysis.segmentation.levels import compare_levels, levels, plain_name
from experiments.analysis.segmentation.measured import measured_difference, measured_dsc
from experiments.outcome import JobResult
from experiments.reporting.measured import Measured
from experiments.reporting.published import name_of
from experiments.studies.dataset_variability.report import FACTOR, STUDY, common_test, own_cases, published_of

PUBLISHED_PAIRS = {"dsc": {"pruned", "full"}, "hd95": {"single_session", "full"}}


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the DSC of each configuration, and the differences that were published as sentences.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values on the common test subjects and on each configuration's own cases.
    """
    test = common_test(results)
    found = [
        measured_dsc(name_of(STUDY, value), f"{model} trained on {level[FACTOR]}, {place}", part)
        for place, cases in (("common test subjects", test), ("own unseen cases", own_cases(results)))
        for level, model, part in levels(cases, [FACTOR])
        for value in published_of({FACTOR: level[FACTOR], "model": plain_name(model)})
    ]
    compared = compare_levels(test, FACTOR, "common test subjects")
    for row in compared.to_dict("records"):
        score = str(row["metric"]).split("_")[0]
        if {row["first"], row["second"]} == PUBLISHED_PAIRS[score]:
            name = "dsc_pruned" if score == "dsc" else "hd95"
            where = str(row["dataset"])
            found.append(measured_difference(name, where, row, bool(test["simulated"].all())))
    return found
