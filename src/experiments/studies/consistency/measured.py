"""What the consistency study measured of each published value, for the report."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.analysis.registration.phantom_jobs import rows_by_phantom
from experiments.outcome import JobResult
from experiments.reporting.measured import OTHER_DATA, SIMULATED, Measured
from experiments.studies.consistency.report import PAIR, median_of_pairs

ARTERY = "artery"


def measured(results: Sequence[JobResult]) -> list[Measured]:
    """Give the median HD95 between sweeps of each phantom, and the artery's against the others'.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs of the study.

    Returns
    -------
    list of Measured
        Values for the published ones.
    """
    cases = rows_by_phantom(results)
    if cases is None:
        return []
    reason = SIMULATED if cases["simulated"].all() else OTHER_DATA
    medians, found = {}, []
    for name in cases["phantom"].drop_duplicates():
        own = cases[cases["phantom"] == name]
        interval = median_of_pairs(own, "hd95_mm")
        medians[str(name)] = interval
        pairs = f"{int((own['kind'] == PAIR).sum())} pairs"
        bounds = (interval.estimate, interval.low, interval.high)
        found.append(Measured("hd95_mm_median", str(name), *bounds, interval.units, "sweeps", pairs, reason))
    others = [one for name, one in medians.items() if name != ARTERY]
    if ARTERY in medians and others:
        said = ", ".join(f"{name} {one.estimate:.2f}" for name, one in medians.items())
        said += " mm; one phantom of each kind, no test"
        more = medians[ARTERY].estimate - max(one.estimate for one in others)
        of = "artery minus the largest other"
        found.append(
            Measured(
                "hd95_mm_artery", of, more, n=len(medians), units="phantoms", said=said, not_comparable=reason
            )
        )
    return found
