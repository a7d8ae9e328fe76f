"""What the study of vessel types shows: each vessel by what was trained on and tested on, in pairs, and published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from experiments.analysis.segmentation.case_table import pool, smoke_note
from experiments.analysis.segmentation.comparison_findings import (
    comparison_metrics,
    comparison_table,
    describe_comparison,
)
from experiments.analysis.segmentation.level_figures import level_boxes
from experiments.analysis.segmentation.levels import (
    compare_levels,
    data_label,
    levels,
    levels_metrics,
    levels_table,
    notes_once,
    with_data_choices,
)
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.datasets.musv_subjects import DISTRICTS
from experiments.outcome import JobResult, Outcome
from experiments.reporting.published import Published, matching, published_values

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

STUDY, AGGREGATED, OWN, BOTH = "vessel_type", "aggregated", "own district", "both districts"
LEAKAGE = "subject leakage possible"
FACTORS = ("vessel", "trained_on", "tested_on")
LABELS = {
    f"{tested}, {trained}": f"{tested.capitalize()},\n{words}"
    for tested in (*DISTRICTS, BOTH)
    for trained, words in ((OWN, "own district"), (AGGREGATED, "aggregated"))
}


def summary_of(results: Sequence[JobResult]) -> Outcome:
    """Make the metrics, tables, figure and findings over all jobs.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        The summary.
    """
    import pandas as pd

    cases = with_data_choices(pool(results, factors=("vessels", "districts")))
    shown = by_condition(cases)
    data = str(cases["data"].iloc[0])
    compared = pd.concat(
        [
            compare_levels(shown, "trained_on", "unseen cases", ("vessel", "tested_on")),
            compare_levels(shown, "vessel", "unseen cases", ("tested_on", "trained_on")),
        ],
        ignore_index=True,
    )
    tables = {"vessel types": levels_table(shown, FACTORS, published_of, data)}
    if len(compared):
        tables["comparison of training and of vessels"] = comparison_table(compared)
    return Outcome(
        metrics={**levels_metrics(shown, FACTORS), **comparison_metrics(compared)},
        cases=cases,
        tables=tables,
        figures={"vessel_types": figure(shown)},
        findings=(
            *_describe(shown, data),
            *describe_comparison(compared),
            *smoke_note(cases),
            _published_sentence(),
            *notes_once(results),
        ),
    )


def by_condition(cases: pd.DataFrame) -> pd.DataFrame:
    """Sort the cases by what they were trained and tested on; those of both districts together come once more.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table with columns ``vessel``, ``trained_on`` (a district or ``aggregated``) and ``district`` (of the
        case; empty where it is not known).

    Returns
    -------
    pandas.DataFrame
        Rows with ``trained_on`` (``own district`` or ``aggregated``) and ``tested_on`` (a district or ``both
        districts``). Networks of their own district count for both where there are some of each.
    """
    import pandas as pd

    own = cases[cases["trained_on"] != AGGREGATED].assign(trained_on=OWN)
    every = cases[cases["trained_on"] == AGGREGATED]
    parts = []
    for vessel in cases["vessel"].drop_duplicates():
        of_own, of_every = (part[part["vessel"] == vessel] for part in (own, every))
        for district in DISTRICTS:
            parts += [
                part[part["district"] == district].assign(tested_on=district) for part in (of_own, of_every)
            ]
        if set(of_own["district"]) == set(DISTRICTS):
            parts.append(of_own.assign(tested_on=BOTH))
        parts.append(of_every.assign(tested_on=BOTH))
    joined = pd.concat([part for part in parts if len(part)], ignore_index=True)
    return joined.assign(condition=joined["tested_on"] + ", " + joined["trained_on"])


def published_of(of: Mapping[str, str]) -> tuple[Published, ...]:
    """List the published DSC of a vessel, of what was trained and tested on and of a model.

    Parameters
    ----------
    of : Mapping[str, str]
        ``vessel``, ``trained_on``, ``tested_on`` and ``model``.

    Returns
    -------
    tuple of Published
        The values; none where none was published.
    """
    if (of["trained_on"], of["tested_on"]) != (AGGREGATED, BOTH):
        return ()
    return matching(STUDY, "dsc", vessel=of["vessel"], district=AGGREGATED, model=of["model"])


def figure(shown: pd.DataFrame) -> Figure:
    """Draw DSC and HD95 by what was trained and tested on, one row of axes for each vessel.

    Parameters
    ----------
    shown : pandas.DataFrame
        As ``by_condition`` gives it.

    Returns
    -------
    Figure
        The figure.
    """

    def known(of: Mapping[str, str]) -> tuple[Published, ...]:
        tested, trained = of["condition"].split(", ")
        return published_of(
            {"vessel": of["panel"].lower(), "tested_on": tested, "trained_on": trained, "model": of["model"]}
        )

    vessels = shown["vessel"].drop_duplicates()
    panels = {str(vessel).capitalize(): shown[shown["vessel"] == vessel] for vessel in vessels}
    title = f"Mus-V: unseen cases by district and by what was trained on{data_label(shown)}"
    return level_boxes(panels, "condition", LABELS, known, title)


def _describe(shown: pd.DataFrame, data: str) -> tuple[str, ...]:
    sentences = []
    for level, model, part in levels(shown, FACTORS):
        numbers = bounded_summary(part)
        if "dsc_mean" not in numbers:
            continue
        known = data_label(part) or (f" ({data})" if data else "")
        sentences.append(
            f"{level['vessel']}, {model} trained on {level['trained_on']}, tested on {level['tested_on']}{known}: mean "
            f"DSC {numbers['dsc_mean']:.3f} over {part['case_id'].nunique()} unseen cases of "
            f"{part['group'].nunique()} groups."
        )
    return tuple(sentences)


def _published_sentence() -> str:
    shown = [f"{value.data}: {value.text_with_unit}" for value in published_values()[STUDY].values()]
    return f"Published (section 4.2): {'; '.join(shown)}."
