"""What the study of propagation shows: masks, surface and registration by configuration, and how they go together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.segmentation.levels import notes_once
from experiments.analysis.variants import varying_choices, with_choices
from experiments.files import write_text
from experiments.outcome import JobResult, Outcome
from experiments.statistics import summary
from experiments.studies.propagation.comparison import correlations, pairs
from experiments.studies.propagation.figures import figures
from experiments.studies.propagation.findings import describe
from experiments.studies.propagation.networks import REFERENCE
from experiments.studies.propagation.tables import last_error, tables, things
from experiments.studies.propagation.trial import MASKS, REGISTRATION, SURFACE
from registration.metrics.surface_distance import SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd

# Settings that rows have columns for, and those that do not change the reference masks.
COLUMNS = ("configurations", "fold", "seed", "model_paths")
OF_TRAINING = ("dataset", "split", "model", "preprocessing", "trainer", "augmentation", "loss", "init")
# What a row is.
KEY = ("configuration", "model", "seed", "fold", "phantom", "sweep")


def metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise the sweeps of one configuration.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.

    Returns
    -------
    dict
        Scalars by name. ``missed_rate`` is over all frames that show the vessel, ``false_alarm_rate`` over those that
        do not, where there are any.
    """
    found: dict[str, float] = {}
    for name in (*MASKS, *SURFACE, "surface_coverage", *REGISTRATION):
        values = cases[name].astype(float).dropna()
        if len(values):
            found |= summary(name, values.tolist())
    for rate, wrong, of in (("missed", "missed", "frames"), ("false_alarm", "false_alarms", "frames_empty")):
        if count := int(cases[of].sum()):
            found |= {f"{rate}_rate": float(cases[wrong].sum()) / count, f"{rate}_n": float(count)}
    return found | {
        "success_tre_rate": float((cases[last_error(cases)] <= SUCCESS_TRE_MM).mean()),
        "surfaces_failed": float((cases["surface_error"] != "").sum()),
        "registrations_failed": float((cases["error"] != "").sum()),
    }


def pooled(results: Sequence[JobResult]) -> pd.DataFrame | None:
    """Put the rows of all jobs together, networks that were made otherwise under a name of their own.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    pandas.DataFrame or None
        All rows, those of the reference masks once; None where no job has any.
    """
    import pandas as pd

    kept = [(result, result.cases) for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return None
    names = [(str(rows["configuration"].iloc[0]), str(rows["model"].iloc[0])) for _, rows in kept]
    varying = varying_choices([result for result, _ in kept], names, COLUMNS)
    parts = []
    for (_, rows), (configuration, model), choices in zip(kept, names, varying, strict=True):
        if configuration == REFERENCE:
            choices = {key: value for key, value in choices.items() if key.split(".")[0] not in OF_TRAINING}
        parts.append(rows.assign(model=with_choices(model, choices).strip()))
    return pd.concat(parts, ignore_index=True).drop_duplicates(list(KEY), ignore_index=True)


def shown(cases: pd.DataFrame, results: Sequence[JobResult] = (), notes: Sequence[str] = ()) -> Outcome:
    """Make tables, the figure and findings of any rows of this study.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.
    results : sequence of JobResult, optional
        Jobs whose data sets have notes.
    notes : sequence of str, optional
        Notes of a single job's data set.

    Returns
    -------
    Outcome
        Metrics by configuration and of the correlations, cases, tables, the figure and findings.
    """
    correlated, compared = correlations(cases), pairs(cases)
    return Outcome(
        metrics=dict(_scalars(cases, correlated)),
        cases=cases,
        tables=tables(cases, correlated, compared),
        figures=figures(cases, correlated),
        findings=(*notes, *notes_once(results), *describe(cases, correlated, compared)),
        files={"correlations.csv": lambda path: write_text(path, correlated.to_csv(index=False))},
    )


def _scalars(cases: pd.DataFrame, correlated: pd.DataFrame) -> Iterator[tuple[str, float]]:
    """Metrics of each configuration and the correlations over all networks, each where it is defined."""
    for thing, own in things(cases):
        for name, value in metrics(own).items():
            yield f"{thing.name}/{name}", value
    for row in correlated.to_dict("records"):
        if row["over"] == "all" and np.isfinite(row["rho"]):
            place = f"spearman_{row['masks']}_{row['error']}"
            yield place, row["rho"]
            if np.isfinite(row["low"]):
                yield f"{place}_ci_low", row["low"]
                yield f"{place}_ci_high", row["high"]
