"""Study ``error_budget``: Shapley shares of the sources of error in the true error, and DSC against true error."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.analysis.registration.phantom_jobs import phantom_jobs, settings_of_job
from experiments.analysis.registration.registered_sweep import RegistrationStages
from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.outcome import JobResult, Outcome, Progress
from experiments.statistics.shapley import coalitions
from experiments.studies.error_budget.report import metrics, shown
from experiments.studies.error_budget.trial import Trials
from registration.phantom.error_sources import SOURCES, ErrorSources
from registration.phantom.settings import PhantomSettings
from registration.pipeline import CloudFilter
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each phantom and sweep.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.

    Raises
    ------
    InputError
        If ``phantoms`` is not a list of phantoms, or there is no sweep.
    """
    first, count = config.get("first_sweep"), config.get("sweeps")
    require_count("first_sweep", first, 0)
    require_count("sweeps", count, 1)
    assert isinstance(first, int)
    assert isinstance(count, int)
    return [
        {**job, "first_sweep": number, "sweeps": 1}
        for job in phantom_jobs(config)
        for number in range(first, first + count)
    ]


def check(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    sources: Sequence[str],
    mask_biases_mm: Sequence[float],
    mask_deviations_mm: Sequence[float],
) -> None:
    """Check that the settings make sense.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Name of the one phantom of the job.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    sources : sequence of str
        Sources of error that are switched.
    mask_biases_mm : sequence of float
        Shifts in mm of the masks' borders.
    mask_deviations_mm : sequence of float
        Standard deviations in mm of shifts that vary along the borders.

    Raises
    ------
    InputError
        If a setting is out of range.
    """
    settings_of_job(phantom, phantoms)
    one_method(rigid)
    one_method(deformable, "deformable")
    if (
        isinstance(sources, str)
        or not sources
        or len(set(sources)) != len(sources)
        or set(sources) - set(SOURCES)
    ):
        raise InputError(f"sources: expected of {', '.join(SOURCES)}, each once, received {sources!r}")
    for name, values, least in (
        ("mask_biases_mm", mask_biases_mm, -np.inf),
        ("mask_deviations_mm", mask_deviations_mm, 0.0),
    ):
        if isinstance(values, str) or not all(np.isfinite(value) and value >= least for value in values):
            raise InputError(f"{name}: expected a list of lengths, received {values!r}")


def run(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    error_sources: ErrorSources,
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    sweeps: int,
    first_sweep: int,
    sources: Sequence[str],
    mask_biases_mm: Sequence[float],
    mask_deviations_mm: Sequence[float],
    max_gap_s: float,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Register one sweep of a phantom with every subset of the sources on, and with masks of every quality.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Name of the one phantom of the job.
    error_sources : ErrorSources
        Size of each source.
    mask_outliers : MaskOutliers
        Test that rejects masks that disagree with their neighbours.
    contours : ContourExtractor
        Extraction of contours from the masks.
    filters : Mapping[str, CloudFilter]
        Filters of the point cloud by name, in order of use.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    sweeps : int
        Number of sweeps.
    first_sweep : int
        Number of the first sweep, from 0.
    sources : sequence of str
        Sources of error that are switched.
    mask_biases_mm : sequence of float
        Shifts in mm of the masks' borders, without any other error.
    mask_deviations_mm : sequence of float
        Standard deviations in mm of shifts that vary along the borders, likewise.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    fixed_points : int
        Number of points drawn from the fixed model.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run; not used.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each registration, tables, the figure and findings.
    """
    import pandas as pd

    del workspace
    settings = settings_of_job(phantom, phantoms)
    stages = RegistrationStages(rigid, deformable, fixed_points, inlier_mm, keep, seed)
    levels = [(bias, 0.0) for bias in mask_biases_mm] + [(0.0, deviation) for deviation in mask_deviations_mm]
    rows: list[dict[str, Any]] = []
    for number in range(first_sweep, first_sweep + sweeps):
        trials = Trials(
            settings, number, error_sources, contours, filters, mask_outliers, stages, max_gap_s, seed
        )
        subsets, steps = coalitions(sources), f"{settings.subset}, sweep {number}: registrations"
        made: list[Callable[[], dict[str, Any]]] = [
            partial(trials.with_sources, on, sources) for on in subsets
        ]
        made += [partial(trials.with_masks, *level) for level in levels]
        rows += [{"sweep": number, **make()} for make in progress.track(made, steps, len(made))]
    names = {"rigid": one_method(rigid)[0], "deformable": one_method(deformable, "deformable")[0]}
    cases = pd.DataFrame(rows).assign(phantom=settings.subset, simulated=True, **names)
    tags = {"phantom": settings.subset, "simulated": "true", **names}
    return shown(cases, metrics(cases), tags)


def summarise(results: list[JobResult]) -> Outcome:
    """Put all sweeps together.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Cases, tables, the figure and findings over all jobs.
    """
    import pandas as pd

    kept = [result.cases for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return Outcome(findings=("No job has registrations to share.",))
    return shown(pd.concat(kept, ignore_index=True))
