"""The cases that two runs have in common, each with both scores: what a paired comparison of the runs rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError
from experiments.tracking.run_lookup import Family
from experiments.tracking.run_record import config_of

if TYPE_CHECKING:
    import pandas as pd

# Metrics that runs are compared by, and whether more of it is better. Unpenalised distances are shown, never tested.
TESTED = {
    "dsc": True,
    "hd95_mm": False,
    "hd95_px": False,
    "false_alarm": False,
    "success_tre": True,
    "tre_mm": False,
    "success": True,
    "rmse_mm": False,
    "hd95_covered_mm": False,
    "msd_mm": False,
}
# Columns that say which case a row is; those in both tables are taken.
KEYS = (
    *(
        "part",
        "kind",
        "train_dataset",
        "dataset",
        "simulated",
        "outer_fold",
        "group",
        "case_id",
        "case",
        "anatomy",
    ),
    *("block", "factor", "level", "rotation", "overlap", "place", "trial", "missing", "condition", "phantom"),
    *("first", "second", "sweep"),
)
# Columns of what a run itself compares: within each value, runs that have several are compared.
METHODS = ("method", "model", "network", "step")
# The independent unit, the first of these in the cases.
UNITS = ("anatomy", "group", "phantom", "sweep", "case_id", "case")
_SIDES = ("_first", "_second")


@dataclass(frozen=True)
class PairedCases:
    """Cases of two runs.

    Parameters
    ----------
    pairs : pandas.DataFrame
        One row a case and method that both runs have, with ``<metric>_first`` and ``<metric>_second``.
    unit : str
        Column of the independent unit.
    strata : tuple of str
        Columns of the methods within which the runs are compared.
    metrics : tuple of str
        Metrics that both have.
    alone : tuple of int, int
        Number of cases that only the first and only the second has.
    notes : tuple of str
        What a reader has to know.
    """

    pairs: pd.DataFrame
    unit: str
    strata: tuple[str, ...]
    metrics: tuple[str, ...]
    alone: tuple[int, int]
    notes: tuple[str, ...]


def pair_cases(first: Family, second: Family, unit: str | None = None) -> PairedCases:
    """Pair the cases of two runs.

    A case that a run has scored several times (seeds, folds) counts with its mean; where both have some seeds in
    common, only these count.

    Parameters
    ----------
    first, second : Family
        The runs.
    unit : str or None, optional
        Column of the independent unit; None for the first of anatomy, group, phantom, sweep and case.

    Returns
    -------
    PairedCases
        The cases that both have.

    Raises
    ------
    InputError
        If a run has no cases, the data differ, or there is no metric, method or case in common.
    """
    _require_same_data(first, second)
    tables, notes = _same_seeds([cases_of(first), cases_of(second)])
    metrics = tuple(name for name in TESTED if all(name in table for table in tables))
    if not metrics:
        raise InputError(
            f"runs: expected cases with one of {', '.join(TESTED)} in both, received the columns "
            f"{', '.join(map(str, tables[0]))} and {', '.join(map(str, tables[1]))}"
        )
    strata, more = _strata(tables)
    keys = [name for name in (*KEYS, "seed of the run") if all(name in table for table in tables)]
    columns = [*keys, *strata]
    scored = [_once_each(table, columns, metrics) for table in tables]
    pairs = scored[0].merge(scored[1], on=columns, suffixes=_SIDES)
    if not len(pairs):
        raise InputError(f"runs: expected cases in common, found none{_why(scored, columns)}")
    chosen = unit or next((name for name in UNITS if name in keys), None)
    if chosen not in keys:
        raise InputError(
            f"unit: expected a column that says which case a row is ({', '.join(keys)}), received {unit!r}"
        )
    alone = (len(scored[0]) - len(pairs), len(scored[1]) - len(pairs))
    return PairedCases(pairs, str(chosen), strata, metrics, alone, (*notes, *more))


def cases_of(family: Family) -> pd.DataFrame:
    """Pool the cases of all finished jobs of a run.

    Parameters
    ----------
    family : Family
        The run.

    Returns
    -------
    pandas.DataFrame
        Its cases; those that say nothing of a seed have that of their job under ``seed of the run``.

    Raises
    ------
    InputError
        If no job has cases.
    """
    import pandas as pd

    tables = []
    for job in family.jobs:
        if job.status != "FINISHED" or job.cases is None or not len(job.cases):
            continue
        cases = job.cases
        if "kind" in cases and (cases["kind"] == "case").any():
            cases = cases[cases["kind"] == "case"]
        seed = config_of(job.config).get("seed")
        # Trials of another seed are other trials, even where they have the same numbers.
        tables.append(cases if "seed" in cases or seed is None else cases.assign(**{"seed of the run": seed}))
    if not tables:
        raise InputError(
            f"run {family.run.run_id[:12]}: expected finished jobs with a table of cases, found none"
        )
    return pd.concat(tables, ignore_index=True)


def _same_seeds(tables: list[pd.DataFrame]) -> tuple[list[pd.DataFrame], tuple[str, ...]]:
    """The rows of the seeds that both have; all rows where they have none in common."""
    if not all("seed" in table for table in tables):
        return tables, ()
    seeds = [{*table["seed"].dropna().tolist()} for table in tables]
    common = sorted(seeds[0] & seeds[1])
    if seeds[0] == seeds[1]:
        return tables, ()
    said = " and ".join(", ".join(str(seed) for seed in sorted(each)) for each in seeds)
    if not common:
        return tables, (
            f"The runs have no seed in common ({said}): a case counts with the mean over those of each.",
        )
    kept = [table[table["seed"].isin(common)] for table in tables]
    return kept, (f"Seeds {said}: only {', '.join(map(str, common))} count, which both have.",)


def _strata(tables: Sequence[pd.DataFrame]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The columns of methods within which the runs are compared; a method that only one run has is said."""
    strata, notes = [], []
    for column in METHODS:
        if not all(column in table for table in tables):
            continue
        values = [{*table[column].dropna().astype(str)} for table in tables]
        if all(len(each) <= 1 for each in values):
            continue
        if not values[0] & values[1]:
            named = " and ".join(", ".join(sorted(each)) for each in values)
            raise InputError(
                f"runs: expected a {column} in common, or one alone in each run, received {named}; name the runs "
                f"of one {column} each"
            )
        strata.append(column)
        if others := sorted(values[0] ^ values[1]):
            notes.append(f"Only one of the runs has the {column} {', '.join(others)}: left out.")
    return tuple(strata), tuple(notes)


def _once_each(table: pd.DataFrame, columns: Sequence[str], metrics: Sequence[str]) -> pd.DataFrame:
    numbers = table[[*columns, *metrics]].astype(dict.fromkeys(metrics, float))
    return numbers.groupby(list(columns), sort=False, dropna=False, as_index=False)[list(metrics)].mean()


def _why(tables: Sequence[pd.DataFrame], columns: Sequence[str]) -> str:
    """The first column in which two tables have no value in common, as the end of a message."""
    for column in columns:
        values = [list(dict.fromkeys(table[column].astype(str))) for table in tables]
        if not {*values[0]} & {*values[1]}:
            named = " and ".join(", ".join(each[:3]) + (", ..." if len(each) > 3 else "") for each in values)
            return f": {column} is {named}"
    return ""


def _require_same_data(first: Family, second: Family) -> None:
    """Refuse runs of which both say what data they used, and it was not the same."""
    found = [digests_of(family) for family in (first, second)]
    for name in sorted({*found[0]} & {*found[1]}):
        shorter = min(len(each[name]) for each in found)
        if found[0][name][:shorter] != found[1][name][:shorter]:
            raise InputError(
                f"runs: expected the same data in both, received {name} with the digests {found[0][name][:12]} and "
                f"{found[1][name][:12]}: their cases are not the same"
            )


def digests_of(family: Family) -> dict[str, str]:
    """Collect the digests of the data sets of a run.

    Parameters
    ----------
    family : Family
        The run.

    Returns
    -------
    dict of str to str
        Digest by the name of the data set, from the tracker and from the column ``data_digest`` of the cases.
    """
    found: dict[str, str] = {}
    for job in family.jobs:
        if job.cases is not None and {"dataset", "data_digest"} <= {*job.cases}:
            known = job.cases[["dataset", "data_digest"]].dropna().drop_duplicates()
            found |= dict(zip(known["dataset"].astype(str), known["data_digest"].astype(str), strict=True))
        found |= dict(family.digests.get(job.run_id, {}))
    return found


def settings_that_differ(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[str]:
    """List the keys whose values are not the same.

    Parameters
    ----------
    first, second : Mapping[str, Any]
        Values by key.

    Returns
    -------
    list of str
        Keys, sorted; one that only one of them has differs.
    """
    absent = object()
    return sorted(key for key in {*first, *second} if first.get(key, absent) != second.get(key, absent))
