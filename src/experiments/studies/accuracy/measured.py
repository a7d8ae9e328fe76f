"""What the accuracy study measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.errors import InputError
from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED, Measured, p_text
from experiments.reporting.published import published_values
from experiments.statistics import Bootstrap, PairedComparison
from experiments.studies.accuracy.report import pooled
from experiments.studies.accuracy.sweeps import DEFORMABLE, RIGID
from experiments.studies.accuracy.tables import below, by_method

if TYPE_CHECKING:
    import pandas as pd

PERCENT = 100.0


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the RMSE of each stage and by how much the deformable one lowers RMSE and HD95.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values for the published ones. Sweeps of one phantom share its tissue: intervals say how repeatable the value is
        on this vessel.
    """
    kept = [result for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return []
    cases, _ = pooled(kept)
    return [
        one for label, method, own, start in by_method(cases) for one in _of_method(label, method, own, start)
    ]


def _of_method(
    label: dict[str, object], method: str, own: pd.DataFrame, start: pd.DataFrame | None
) -> Iterator[Measured]:
    phantom, stage = str(label["phantom"]), RIGID if start is None else DEFORMABLE
    of = ", ".join([*map(str, label.values()), method])
    name = f"rmse_mm_{phantom}_{stage}"
    if name in published_values()["accuracy"]:
        median = Bootstrap("median_of_units")(own["rmse_mm"])
        said = f"true error at the targets {own['tre_mm'].median():.2f} mm (median)"
        bounds = (median.estimate, median.low, median.high)
        yield Measured(name, of, *bounds, median.units, "sweeps of one phantom", said, SIMULATED)
    if start is None:
        return
    for metric, known in (("rmse_mm", "rmse_reduction"), ("hd95_mm", "hd95_mm")):
        less = below(own, start, metric) / PERCENT
        if known == "hd95_mm" or phantom in published_values()["accuracy"][known].condition["phantom"]:
            text = f"{_tested(own, start, metric)}; {_true_error(own, start)}"
            yield Measured(
                known, of, less, np.nan, np.nan, len(own), "sweeps of one phantom", text, SIMULATED
            )


def _tested(own: pd.DataFrame, start: pd.DataFrame, metric: str) -> str:
    try:
        test = PairedComparison()(own[metric].to_numpy(), start[metric].to_numpy()).test
    except InputError:
        return "not tested"
    return p_text(test.p, test.min_attainable_p)


def _true_error(own: pd.DataFrame, start: pd.DataFrame) -> str:
    better = int((own["tre_mm"].to_numpy() < start["tre_mm"].to_numpy()).sum())
    return f"true error lower in {better} of {len(own)} sweeps"
