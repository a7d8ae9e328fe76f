"""Study ``accuracy``: rigid and deformable registration of repeated simulated sweeps, measured against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.analysis.registration.phantom_jobs import (
    masks_by,
    phantom_jobs,
    require_masks,
    settings_of_job,
)
from experiments.analysis.registration.registered_sweep import RegistrationStages
from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.outcome import JobResult, Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.accuracy.report import metrics, pooled, shown
from experiments.studies.accuracy.sweeps import CloudOfSweep, rows_of
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import CloudFilter
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers

# What the dashboard has columns for: of the last stage, and of the rigid one before it.
HEADLINE = (
    *(
        "rmse_mm_median",
        "hd95_mm_median",
        "tre_mm_median",
        "tre_covered_mm_median",
        "tre_uncovered_mm_median",
    ),
    *("interval_rate", "strain_p95_median", "jacobian_min_median", "sweeps_failed", "runtime_s_median"),
    *("rigid_rmse_mm_median", "rigid_tre_mm_median"),
)


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each phantom and deformable method.

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
        If ``phantoms`` is not a list of phantoms, or there is no deformable method.
    """
    methods = config.get("deformable")
    if not isinstance(methods, Mapping) or not methods:
        raise InputError(f"deformable: expected methods by name, or none, received {methods!r}")
    return [
        {**job, "deformable": {name: settings}}
        for job in phantom_jobs(config)
        for name, settings in methods.items()
    ]


def check(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    sweeps: int,
    first_sweep: int,
    coverage: float,
    masks: str,
    model_path: PathSetting | None,
) -> None:
    """Check that the settings allow a registration.

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
    sweeps : int
        Number of sweeps, at least 1.
    first_sweep : int
        Number of the first sweep, from 0.
    coverage : float
        Share of each sweep that is used, above 0 to 1.
    masks : str
        ``exact`` for the true masks, ``model`` for those of a network.
    model_path : PathSetting or None
        File of a trained network (``model.pt``) with ``masks=model``; None with ``masks=exact``.

    Raises
    ------
    InputError
        If a setting is out of range or does not fit the others.
    """
    settings_of_job(phantom, phantoms)
    one_method(rigid)
    one_method(deformable, "deformable")
    require_count("sweeps", sweeps, 1)
    require_count("first_sweep", first_sweep, 0)
    if not 0 < coverage <= 1:
        raise InputError(f"coverage: expected a share above 0 to 1, received {coverage}")
    require_masks(masks, model_path)


def run(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    sweeps: int,
    first_sweep: int,
    coverage: float,
    masks: str,
    model_path: PathSetting | None,
    max_gap_s: float,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Register simulated sweeps of one phantom to the model from its CT, rigidly and then deformably.

    A target's error is its distance in the model, as the stage leaves it, from where its tissue was swept. A sweep that
    cannot be registered is infinitely far off.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Name of the one phantom of the job.
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
        Number of sweeps, at least 1.
    first_sweep : int
        Number of the first sweep, from 0.
    coverage : float
        Share of each sweep that is used, from its middle.
    masks : str
        ``exact`` for the true masks, ``model`` for those of a network.
    model_path : PathSetting or None
        File of a trained network (``model.pt``) with ``masks=model``; None with ``masks=exact``.
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
        Metrics, a row for each sweep and stage, tables, figures and findings.
    """
    import pandas as pd

    del workspace
    settings = settings_of_job(phantom, phantoms)
    clouds = CloudOfSweep(contours, filters, mask_outliers, masks_by(model_path), max_gap_s, coverage)
    stages = RegistrationStages(rigid, deformable, fixed_points, inlier_mm, keep, seed)
    numbers, rows = range(first_sweep, first_sweep + sweeps), []
    for number in progress.track(numbers, f"{settings.subset}: sweeps", sweeps):
        sweep = simulate_sweep(settings, number, pictures=model_path is not None)
        rows += [{"sweep": number, **row} for row in rows_of(sweep, clouds, stages)]
    names = {"rigid": one_method(rigid)[0], "deformable": one_method(deformable, "deformable")[0]}
    cases = pd.DataFrame(rows).assign(
        phantom=settings.subset, masks=masks, share=coverage, simulated=True, **names
    )
    tags = {"phantom": settings.subset, "masks": masks, "simulated": "true", **names}
    return shown(cases, metrics(cases), tags)


def summarise(results: list[JobResult]) -> Outcome:
    """Compare all phantoms and methods.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Cases, tables, figures and findings over all jobs; no metrics, which would mix methods.
    """
    kept = [result for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return Outcome(findings=("No job has sweeps to compare.",))
    cases, parameters = pooled(kept)
    return shown(cases, parameters=parameters)
