"""Study ``consistency``: repeated sweeps of a phantom, reconstructed, compared with each other and with the truth."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.phantom_jobs import (
    masks_by,
    phantom_jobs,
    require_masks,
    rows_by_phantom,
    settings_of_job,
)
from experiments.errors import InputError, require_count
from experiments.outcome import JobResult, Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.consistency.repeats import common, pair, tried
from experiments.studies.consistency.report import PAIR, describe, figures, metrics, tables
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import CloudFilter, Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces

if TYPE_CHECKING:
    import pandas as pd

# What the dashboard has columns for.
HEADLINE = (
    *("msd_mm_median", "hd95_mm_median", "hd95_covered_mm_median", "hd95_tissue_mm_median", "common_mm"),
    *("truth_msd_covered_mm_median", "truth_hd95_covered_mm_median", "truth_bias_mm_mean"),
    *("truth_covered_second_mean", "sweeps_failed", "runtime_s_median"),
)


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each phantom.

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
        If ``phantoms`` is not a list of phantoms.
    """
    return phantom_jobs(config)


def check(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    sweeps: int,
    masks: str,
    model_path: PathSetting | None,
) -> None:
    """Check that the settings allow a comparison.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Name of the one phantom of the job.
    sweeps : int
        Number of sweeps, at least 2.
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
    require_count("sweeps", sweeps, 2)
    require_masks(masks, model_path)


def run(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    surface: SurfaceMethod,
    pieces: VesselPieces,
    smoothing: TaubinSmoothing,
    sweeps: int,
    masks: str,
    model_path: PathSetting | None,
    max_gap_s: float,
    samples: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Reconstruct simulated sweeps of one phantom and compare all pairs, and each with the anatomy.

    Pairs are compared as tracked, without any registration, as the sweeps share their world; and once more
    with the known deformation taken out. The truth is the undeformed anatomy, so each place of the tissue is
    compared with it. A sweep that cannot be reconstructed is infinitely far from all others.

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
    surface : SurfaceMethod
        Method that makes a surface of the point cloud.
    pieces : VesselPieces
        Rule for which pieces of the surface belong to the vessel.
    smoothing : TaubinSmoothing
        Smoothing of the surface.
    sweeps : int
        Number of sweeps, at least 2.
    masks : str
        ``exact`` for the true masks, ``model`` for those of a network.
    model_path : PathSetting or None
        File of a trained network (``model.pt``) with ``masks=model``; None with ``masks=exact``.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    samples : int
        Number of places on each surface where distances are measured.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run; not used.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each sweep and pair, tables, the figure and findings.

    Raises
    ------
    InputError
        If the settings allow no comparison, or no sweep can be reconstructed.
    """
    import pandas as pd

    del workspace
    check(phantom=phantom, phantoms=phantoms, sweeps=sweeps, masks=masks, model_path=model_path)
    settings = settings_of_job(phantom, phantoms)
    chain = Reconstruction(contours, filters, surface, smoothing, None, mask_outliers, pieces)
    drawn_masks = masks_by(model_path)
    repeats = []
    for number in progress.track(range(sweeps), f"{settings.subset}: sweeps", sweeps):
        truth = simulate_sweep(settings, number, pictures=model_path is not None)
        repeats.append(tried(truth, chain, drawn_masks(truth), max_gap_s, (samples, seed)))
    known = [repeat for repeat in repeats if repeat.row["error"] == ""]
    if not known:
        raise InputError(
            f"sweeps: expected some that can be reconstructed, received none ({repeats[0].row['error']})"
        )
    pairs = list(itertools.combinations(range(sweeps), 2))
    rows = [{**repeat.row, "first": number} for number, repeat in enumerate(repeats)]
    rows.append(common([repeat.offset_mm for repeat in known]))
    for first, second in progress.track(pairs, f"{settings.subset}: pairs", len(pairs)):
        numbers = {"kind": PAIR, "first": first, "second": second}
        rows.append(numbers | pair(repeats[first], repeats[second], (samples, seed)))
    cases = pd.DataFrame(rows).assign(phantom=settings.subset, masks=masks, simulated=True)
    return replace(shown(cases), tags={"phantom": settings.subset, "masks": masks, "simulated": "true"})


def parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Name the phantom of a job, for the dashboard's columns.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the job.

    Returns
    -------
    dict
        Values by name.
    """
    return {"phantom": config["phantoms"], "sweeps": config["sweeps"], "masks": config["masks"]}


def summarise(results: list[JobResult]) -> Outcome:
    """Compare all phantoms.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, cases, tables, the figure and findings over all jobs.
    """
    # Sweeps of one phantom that were made or reconstructed otherwise are not repeats of each other.
    cases = rows_by_phantom(results)
    return Outcome(findings=("No job has sweeps to compare.",)) if cases is None else shown(cases)


def shown(cases: pd.DataFrame) -> Outcome:
    """Make the metrics, tables, figure and findings of any sweeps of this study.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of pairs, of sweeps against the truth and of common errors.

    Returns
    -------
    Outcome
        Metrics, cases, tables, the figure and findings.
    """
    return Outcome(
        metrics=metrics(cases),
        cases=cases,
        tables=tables(cases),
        figures=figures(cases),
        findings=describe(cases),
    )
