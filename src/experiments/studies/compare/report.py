"""The comparison of two runs for a reader: names, a narrow table, and sentences that claim what its tests show."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.runs.paired_cases import PairedCases, cases_of, digests_of
from experiments.analysis.runs.paired_tests import ALPHA, BY_MEDIAN, MCNEMAR
from experiments.tracking.run_lookup import Family

if TYPE_CHECKING:
    import pandas as pd

SHORT = 8
DIGITS = {"dsc": 3, "success": 3, "success_tre": 3, "false_alarm": 3}


def names_of(first: Family, second: Family) -> tuple[str, str]:
    """Name two runs so that a reader can tell them apart.

    Parameters
    ----------
    first, second : Family
        The runs.

    Returns
    -------
    tuple of str, str
        Method or model of each where it has one alone and they differ, with the beginning of its id.
    """
    methods = [_only_method(family) for family in (first, second)]
    told = methods[0] != methods[1] and all(methods)
    ids = [family.run.run_id[:SHORT] for family in (first, second)]
    names = [f"{method} {key}" if told else key for method, key in zip(methods, ids, strict=True)]
    return names[0], names[1]


def _only_method(family: Family) -> str:
    cases = cases_of(family)
    for column in ("method", "model"):
        if column in cases and len(found := cases[column].dropna().unique()) == 1:
            return str(found[0])
    return ""


def tests_table(tested: pd.DataFrame, names: tuple[str, str]) -> pd.DataFrame:
    """Make a narrow table of text of the tests.

    Parameters
    ----------
    tested : pandas.DataFrame
        As ``compare_runs`` gives it.
    names : tuple of str, str
        Names of the runs.

    Returns
    -------
    pandas.DataFrame
        One row for each method and metric.
    """
    import pandas as pd

    rows = []
    for row in tested.to_dict("records"):
        digits = DIGITS.get(row["metric"], 2)
        rows.append(
            {
                **({"method": row["method"]} if row["method"] else {}),
                "metric": row["metric"],
                "units": row["units"],
                "cases": row["cases"],
                names[0]: f"{row['first']:.{digits}f}",
                names[1]: f"{row['second']:.{digits}f}",
                "mean_difference": _difference(row, "[{}, {}]"),
                "test": row["test"],
                **{name: _p(row[name]) for name in ("p", "p_holm", "min_attainable_p")},
                "verdict": _named(row["verdict"], names),
            }
        )
    return pd.DataFrame(rows)


def describe(
    paired: PairedCases, tested: pd.DataFrame, names: tuple[str, str], families: tuple[Family, Family]
) -> tuple[str, ...]:
    """Describe the comparison in sentences that claim what its tests show and nothing else.

    Parameters
    ----------
    paired : PairedCases
        The cases of both runs.
    tested : pandas.DataFrame
        As ``compare_runs`` gives it.
    names : tuple of str, str
        Names of the runs.
    families : tuple of Family, Family
        The runs.

    Returns
    -------
    tuple of str
        What was compared, a sentence for each method and metric, and what a reader has to know.
    """
    about = [
        f"{name}: {family.run.experiment}, {family.run.name}"
        for name, family in zip(names, families, strict=True)
    ]
    left = f"; {paired.alone[0]} and {paired.alone[1]} only one run has" if any(paired.alone) else ""
    units = paired.pairs[paired.unit].nunique()
    basis = (
        f"Compared on {len(paired.pairs)} cases that both have{left}; the unit is the {paired.unit}, of which there "
        f"{'is' if units == 1 else 'are'} {units}."
    )
    said = [f"{'; '.join(about)}.", basis]
    said += [_sentence(row, names, paired.unit) for row in tested.to_dict("records")]
    return (*said, *_notes(paired, tested, families))


def _notes(paired: PairedCases, tested: pd.DataFrame, families: tuple[Family, Family]) -> tuple[str, ...]:
    said = list(paired.notes)
    known = [digests_of(family) for family in families]
    if not {*known[0]} & {*known[1]}:
        said.append(
            "The contents of the data are not recorded for both runs: that cases of one name are the same "
            "in both rests on the names."
        )
    if len(tested) and (least := float(tested["family_least"].iloc[0])) > ALPHA:
        said.append(
            f"So few units can show no difference at {ALPHA:g}: the least p that any of these {len(tested)} tests can "
            f"give is {_p(least)} after adjustment."
        )
    if "simulated" in paired.pairs and paired.pairs["simulated"].astype(bool).any():
        said.append("Some or all of the cases are simulated.")
    return tuple(said)


def _sentence(row: Mapping[Hashable, Any], names: tuple[str, str], unit: str) -> str:
    method = f"{row['method']}: " if row["method"] else ""
    over = f"{row['units']} {unit}{'' if row['units'] == 1 else 's'}"
    each = f" (median over the cases of each {unit})" if row["metric"] in BY_MEDIAN else ""
    head = (
        f"{method}{row['metric']} of {names[0]} less that of {names[1]}: mean difference "
        f"{_difference(row, '(95 % interval {} to {})')} over {over}{each}"
    )
    if row["units"] == 1:
        return (
            f"{head}: with a single {unit} nothing can be said of others, and no test can show a difference."
        )
    test = f"exact {row['test']} test" if row["test"] != MCNEMAR else "McNemar's exact test"
    return (
        f"{head}; {_named(row['verdict'], names)} ({test}: p = {_p(row['p'])}, with Holm's adjustment "
        f"{_p(row['p_holm'])}, least attainable p {_p(row['min_attainable_p'])})."
    )


def _named(verdict: str, names: tuple[str, str]) -> str:
    for place, name in zip(("first", "second"), names, strict=True):
        if verdict.startswith(f"{place} "):
            return name + verdict.removeprefix(place)
    return verdict


def _difference(row: Mapping[Hashable, Any], bounds: str) -> str:
    digits = DIGITS.get(str(row["metric"]), 2)
    shown = [
        f"{row[name]:+.{digits}f}"
        for name in ("mean_difference", "mean_difference_ci_low", "mean_difference_ci_high")
    ]
    return shown[0] if np.isnan(row["mean_difference_ci_low"]) else f"{shown[0]} {bounds.format(*shown[1:])}"


def _p(value: float) -> str:
    if np.isnan(value):
        return ""
    return f"{value:.3f}" if value >= 0.001 else f"{value:.1e}"
