"""What the study of variability shows: configurations on common test subjects, each on its own cases, and published."""

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
    plain_name,
    with_data_choices,
)
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.outcome import JobResult, Outcome
from experiments.reporting.published import Published, matching, published_values

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

STUDY, FACTOR = "dataset_variability", "configuration"
TEST = "held_out"
ON_TEST, ON_OWN = "Common test subjects", "Each configuration's own unseen cases"
LABELS = {
    "single_session": "Single\nsession",
    "full": "Full",
    "pruned": "Pruned",
    "full_as_single_session": "Full, as many\nas single session",
    "full_as_pruned": "Full, as many\nas pruned",
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
        The summary; its cases are those of the common test subjects and of the configurations' folds.
    """
    import pandas as pd

    test, own = common_test(results), own_cases(results)
    compared = compare_levels(test, FACTOR, "the common test subjects")
    tables = {
        "common test subjects": _with_sizes(levels_table(test, [FACTOR], published_of), results),
        "own unseen cases": levels_table(own, [FACTOR], published_of),
    }
    if len(compared):
        tables["comparison on the common test subjects"] = comparison_table(compared)
    return Outcome(
        metrics={
            **levels_metrics(test, [FACTOR]),
            **{f"own/{name}": value for name, value in levels_metrics(own, [FACTOR]).items()},
            **comparison_metrics(compared),
        },
        cases=pd.concat([test, own], ignore_index=True),
        tables=tables,
        figures={"variability": figure(test, own)},
        findings=(
            *_describe(test, own),
            *describe_comparison(compared),
            *smoke_note(test),
            *_published_sentences(test),
            *notes_once(results),
        ),
    )


def common_test(results: Sequence[JobResult]) -> pd.DataFrame:
    """Pool the scores on the test subjects that all configurations share.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    pandas.DataFrame
        Per-case table with a column ``configuration``, in the order of the configurations.
    """
    return _in_order(pool(results, factors=("configurations",), part=TEST))


def own_cases(results: Sequence[JobResult]) -> pd.DataFrame:
    """Pool the scores of each configuration on unseen cases of its own.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    pandas.DataFrame
        Per-case table with a column ``configuration``, in the order of the configurations.
    """
    return _in_order(pool(results, factors=("configurations",)))


def published_of(of: Mapping[str, str]) -> tuple[Published, ...]:
    """List the published DSC of a configuration and model.

    Parameters
    ----------
    of : Mapping[str, str]
        ``configuration`` and ``model``.

    Returns
    -------
    tuple of Published
        The values; none where none was published.
    """
    return matching(STUDY, "dsc", model=of["model"], configuration=of[FACTOR])


def figure(test: pd.DataFrame, own: pd.DataFrame) -> Figure:
    """Draw DSC and HD95 by configuration, for the common test subjects and for the configurations' own cases.

    Parameters
    ----------
    test, own : pandas.DataFrame
        Per-case tables with a column ``configuration``.

    Returns
    -------
    Figure
        The figure.
    """
    return level_boxes(
        {ON_TEST: test, ON_OWN: own},
        FACTOR,
        LABELS,
        published_of,
        f"San Raffaele: variety and size of the training data{data_label(test)}",
    )


def _in_order(cases: pd.DataFrame) -> pd.DataFrame:
    """Rows in the order of the configurations, so that tables, pairs and figures have one order."""
    places, named = list(LABELS), with_data_choices(cases)
    return named.sort_values(
        FACTOR, key=lambda names: names.map(places.index), kind="stable", ignore_index=True
    )


def _with_sizes(table: pd.DataFrame, results: Sequence[JobResult]) -> pd.DataFrame:
    """The table with the number of frames that a fold trained with, on average over folds and models."""
    sizes: dict[str, list[float]] = {}
    for result in results:
        sizes.setdefault(str(result.config["configurations"][0]), []).append(
            result.metrics.get("train_cases", float("nan"))
        )
    means = {name: sum(found) / len(found) for name, found in sizes.items()}
    places = list(table.columns)
    counted = table.assign(train_cases=[round(means[name], 1) for name in table[FACTOR]])
    return counted[[FACTOR, "train_cases", *(name for name in places if name != FACTOR)]]


def _describe(test: pd.DataFrame, own: pd.DataFrame) -> tuple[str, ...]:
    """A sentence for each configuration and model: its DSC on the common test and on its own unseen cases."""
    at_home = {
        (level[FACTOR], model): bounded_summary(part)["dsc_mean"]
        for level, model, part in levels(own, [FACTOR])
    }
    simulated = data_label(test)
    return tuple(
        f"{model} trained on {level[FACTOR]}{simulated}: mean DSC {bounded_summary(part)['dsc_mean']:.3f} on "
        f"{part['case_id'].nunique()} cases of {part['group'].nunique()} common test subjects, "
        f"{at_home.get((level[FACTOR], model), float('nan')):.3f} on unseen cases of its own."
        for level, model, part in levels(test, [FACTOR])
    )


def _published_sentences(cases: pd.DataFrame) -> tuple[str, ...]:
    """What the summary of the thesis states, and what it leaves open."""
    asked = {plain_name(str(model)) for model in cases["model"]}
    shown = [
        f"{value.data}: {value.text_with_unit} ({value.metric})"
        for value in published_values()[STUDY].values()
        if not asked.isdisjoint(value.condition.get("model", asked))
    ]
    return (
        f"Published (section 4.2, Figure 4): {'; '.join(shown)}. The summary does not say on which cases the "
        "configurations were scored, so the values stand beside both.",
        "A configuration chooses which recordings a network learns from and changes no image; full_as_single_session "
        "and full_as_pruned are full at the size of the other two, which tells variety from size.",
    )
