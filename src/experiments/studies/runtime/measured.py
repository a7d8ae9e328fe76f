"""What the runtime study measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.analysis.registration.phantom_jobs import rows_by_phantom
from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED, Measured
from experiments.studies.runtime.chain import ACQUISITION, PREPROCESSING, SEGMENTATION
from experiments.studies.runtime.report import WITHOUT, has_segmentation, phantoms, totals

FIRST = (ACQUISITION, PREPROCESSING, SEGMENTATION)


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the time of the whole workflow of each phantom, and the share of acquisition and pre-processing.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values for the published ones; the lowest and the highest repeat stand in words, for repeats of one computation
        are no sample of others.
    """
    costs = rows_by_phantom(results)
    found = []
    for name, part in phantoms(costs) if costs is not None else ():
        total_s = totals(part)["total_s"]
        middle, repeats = float(np.median(total_s)), len(total_s)
        spread = f"{total_s.min():.1f} to {total_s.max():.1f} s over {repeats} repeats"
        said = f"{spread if repeats > 1 else 'one repeat'}; acquisition modelled"
        said += "" if has_segmentation(part) else f"; {WITHOUT}"
        found.append(
            Measured("total_s", name, middle, n=repeats, units="repeats", said=said, not_comparable=SIMULATED)
        )
        stages = part.groupby("stage", sort=False)["seconds"].median()
        spent = {stage: stages.get(stage, 0.0) / middle for stage in FIRST}
        words = ", ".join(f"{stage} {share:.0%}" for stage, share in spent.items() if share)
        found.append(
            Measured(
                "share",
                name,
                sum(spent.values()),
                n=repeats,
                units="repeats",
                said=words,
                not_comparable=SIMULATED,
            )
        )
    return found
