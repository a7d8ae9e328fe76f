"""The trials of all jobs of a robustness study: nothing under one name that is not the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from experiments.analysis.variants import names_of_files, told_apart
from experiments.outcome import JobResult

if TYPE_CHECKING:
    import pandas as pd

# Settings that a row has a column for, or, as the seed, that only make more trials of the same kind.
COLUMNS = ("target", "target_centerline", "overlaps", "places", "rotations", "factors", "seed")


def pooled(results: Sequence[JobResult]) -> pd.DataFrame:
    """Pool the rows of all jobs, with anatomies, methods and trials under distinct names.

    Surfaces whose files have one name are told apart by their folders, one method with two settings by what
    was chosen, and the trials of two seeds by their numbers: those of a second seed follow those of the
    first.

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
    methods = told_apart(results, [str(table["method"].iloc[0]) for table in tables], COLUMNS)
    seeds = list(dict.fromkeys(result.config.get("seed") for result in results))
    most = max(int(table["trial"].max()) for table in tables) + 1
    named = [
        table.assign(
            anatomy=anatomies.get(target, table["anatomy"].iloc[0]),
            method=method,
            trial=table["trial"] + most * seeds.index(result.config.get("seed")),
        )
        for table, target, method, result in zip(tables, targets, methods, results, strict=True)
    ]
    return pd.concat(named, ignore_index=True)
