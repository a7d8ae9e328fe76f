"""What the accuracy study shows: residual and true error by phantom and stage, and whether predictions hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.variants import varying_choices, with_choices
from experiments.outcome import JobResult, Outcome
from experiments.statistics import summary
from experiments.studies.accuracy.figures import stage_figure
from experiments.studies.accuracy.parameter_study import least, setting_figure, setting_means
from experiments.studies.accuracy.sweeps import (
    DEFORMABLE,
    ERRORS,
    METHOD,
    PARTS,
    PLAUSIBILITY,
    RESIDUALS,
    RIGID,
    column_of,
)
from experiments.studies.accuracy.tables import describe, tables

if TYPE_CHECKING:
    import pandas as pd

# Columns that rows are known by, besides the name of the method.
PAIR = ("phantom", "share", "sweep")
WORTH = (
    "Sweeps of one phantom share its tissue and its bend: they tell how repeatable the result is on this vessel, and "
    "nothing of others. All data are simulated; a residual is no accuracy."
)


def metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise the sweeps of one job: the last stage by plain names, and the one before it by ``rigid_``.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one phantom and one method.

    Returns
    -------
    dict
        Scalars by name.
    """
    found: dict[str, float] = {}
    stages = list(dict.fromkeys(cases["stage"]))
    for stage in stages:
        prefix = "" if stage == stages[-1] else f"{RIGID}_"
        own = cases[cases["stage"] == stage]
        for name in (*RESIDUALS, *ERRORS, "runtime_s", *(PLAUSIBILITY if stage == DEFORMABLE else ())):
            values = column_of(own, name).dropna()
            if len(values):
                found |= summary(f"{prefix}{name}", values.tolist())
        for part in PARTS:
            holds = column_of(own, f"holds{part}").dropna()
            if len(holds):
                found[f"{prefix}interval{part}_rate"] = float(holds.mean())
        found[f"{prefix}sweeps_failed"] = float((own["error"] != "").sum())
    return found


def pooled(results: Sequence[JobResult]) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Put the rows of several jobs together, each method under a name of its own.

    Rigid stages that several deformable methods start from are the same and are kept once.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs with rows.

    Returns
    -------
    cases : pandas.DataFrame
        All rows, with the column ``method`` and a column for each number that varies among deformable methods.
    parameters : tuple of str
        Names of these numbers.
    """
    import pandas as pd

    rows = [result.cases for result in results if result.cases is not None]
    names = [
        (table["phantom"].iloc[0], table["rigid"].iloc[0], table["deformable"].iloc[0]) for table in rows
    ]
    varying = varying_choices(results, names, ("phantoms", "coverage"))
    parts: list[pd.DataFrame] = []
    parameters: dict[str, float] = {}
    for table, choices in zip(rows, varying, strict=True):
        own = {key: value for key, value in choices.items() if key.startswith("deformable.")}
        before = {key: value for key, value in choices.items() if key not in own}
        methods = {
            RIGID: with_choices(str(table["rigid"].iloc[0]), before),
            DEFORMABLE: with_choices(str(table["deformable"].iloc[0]), choices),
        }
        numbers = {key.rsplit(".", 1)[-1]: float(value) for key, value in own.items() if _is_number(value)}
        parameters |= numbers
        parts.append(table.assign(**{METHOD: table["stage"].map(methods)}, **numbers))
    cases = pd.concat(parts, ignore_index=True).drop_duplicates([*PAIR, METHOD], ignore_index=True)
    return cases, tuple(parameters)


def _is_number(value: str) -> bool:
    try:
        return bool(np.isfinite(float(value)))
    except ValueError:
        return False


def shown(
    cases: pd.DataFrame,
    scalars: Mapping[str, float] | None = None,
    tags: Mapping[str, str] | None = None,
    parameters: Sequence[str] = (),
) -> Outcome:
    """Make tables, figures and findings of any rows of this study.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages.
    scalars : Mapping[str, float] or None, optional
        Metrics to hand on.
    tags : Mapping[str, str] or None, optional
        Tags to hand on.
    parameters : sequence of str, optional
        Columns with numbers that vary among deformable methods.

    Returns
    -------
    Outcome
        Metrics, cases, tables, figures and findings.
    """
    if METHOD not in cases:
        cases = cases.assign(**{METHOD: cases["rigid"].where(cases["stage"] == RIGID, cases["deformable"])})
    if len(parameters) == 2:
        means = setting_means(cases, parameters)
        return Outcome(
            metrics=dict(scalars or {}),
            cases=cases,
            tables={"means by setting, simulated": means},
            figures={"accuracy_settings": setting_figure(means, parameters)},
            findings=(*least(means, parameters), WORTH),
        )
    return Outcome(
        metrics=dict(scalars or {}),
        cases=cases,
        tables=tables(cases),
        figures={} if np.isinf(cases["tre_mm"]).all() else {"accuracy": stage_figure(cases, METHOD)},
        findings=(*describe(cases), WORTH),
        tags=dict(tags or {}),
    )
