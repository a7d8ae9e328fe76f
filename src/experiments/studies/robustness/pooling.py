"""The trials of all jobs of a robustness study: nothing under one name that is not the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from experiments.analysis.variants import distinct_names, names_of_files, varying_choices, with_choices
from experiments.outcome import JobResult
from experiments.studies.robustness.design import CONDITION
from experiments.studies.robustness.grouping import PROBLEM, with_condition

if TYPE_CHECKING:
    import pandas as pd

METHOD, PERTURBATION, TARGET_LINE = "rigid", "perturbation", "target_centerline"
# Settings that a row has a column for, or, as the seed, that only make more trials of the same kind.
SETTINGS_IN_COLUMNS = (
    "target",
    TARGET_LINE,
    "overlaps",
    "places",
    "rotations",
    f"{PERTURBATION}.rotation",
    "factors",
    "seed",
)


def pooled(results: Sequence[JobResult]) -> pd.DataFrame:
    """Pool the rows of all jobs, with anatomies, methods, conditions and trials under distinct names.

    Surfaces whose files have one name are named with their folders, one method with two settings by what was
    chosen. What was chosen for the trials, such as their perturbation, is no part of a method: it has the
    column ``condition``, which is left out where all jobs agree. Trials of a second seed are numbered after
    those of the first, and a trial that two jobs share counts once.

    Parameters
    ----------
    results : sequence of JobResult
        Results of jobs that have cases.

    Returns
    -------
    pandas.DataFrame
        Rows of the trials of all jobs.
    """
    import pandas as pd

    tables = [result.cases for result in results if result.cases is not None]
    targets = [str(result.config.get("target")) for result in results]
    known = list(dict.fromkeys(targets))
    anatomies = dict(zip(known, names_of_files(known), strict=True)) if len(known) > 1 else {}
    of_method = [_restricted(result, lambda name: name == METHOD) for result in results]
    methods = distinct_names(
        of_method, [str(table["method"].iloc[0]) for table in tables], SETTINGS_IN_COLUMNS
    )
    seeds = list(dict.fromkeys(result.config.get("seed") for result in results))
    most = max(int(table["trial"].max()) for table in tables) + 1
    named = [
        table.assign(
            anatomy=anatomies.get(target, table["anatomy"].iloc[0]),
            method=method,
            trial=table["trial"] + most * seeds.index(result.config.get("seed")),
            **condition,
        )
        for table, target, method, condition, result in zip(
            tables, targets, methods, _conditions(results, targets), results, strict=True
        )
    ]
    rows = pd.concat(named, ignore_index=True)
    return rows.drop_duplicates([*with_condition(rows, PROBLEM), "method"], ignore_index=True)


def _conditions(results: Sequence[JobResult], targets: Sequence[str]) -> list[dict[str, str]]:
    """The condition of each job as a column, ``angle_max_deg=45``; no column where the jobs do not differ."""
    of_trials = [_restricted(result, lambda name: name != METHOD) for result in results]
    # A target has a centerline of its own; only a second one of the same target makes another condition.
    of_lines = [_restricted(result, lambda name: name == TARGET_LINE) for result in results]
    found = [
        varying | line
        for varying, line in zip(
            varying_choices(of_trials, [""] * len(results), SETTINGS_IN_COLUMNS),
            varying_choices(of_lines, targets),
            strict=True,
        )
    ]
    if not any(found):
        return [{} for _ in results]
    return [
        {CONDITION: with_choices("", {_short(name): value for name, value in each.items()}).strip()}
        for each in found
    ]


def _short(name: str) -> str:
    return name.removeprefix(f"{PERTURBATION}.")


def _restricted(result: JobResult, wanted: Callable[[str], bool]) -> JobResult:
    """The result with some of its settings alone."""
    # The command line adds a setting with a plus sign.
    choices = {name.lstrip("+"): value for name, value in result.choices.items()}
    return dataclasses.replace(
        result,
        config={name: value for name, value in result.config.items() if wanted(name)},
        choices={name: value for name, value in choices.items() if wanted(name.split(".")[0])},
    )
