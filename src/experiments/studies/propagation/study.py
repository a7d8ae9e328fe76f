"""Study ``propagation``: networks trained on configurations of a data set segment the same simulated sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.registered_sweep import RegistrationStages
from experiments.analysis.segmentation.configurations import configured
from experiments.analysis.segmentation.fold_run import FoldRun
from experiments.datasets.protocol import DataSet
from experiments.inputs.surfaces import one_method
from experiments.outcome import JobResult, Outcome, Progress
from experiments.paths import PathSetting
from experiments.splits.group_splits import GroupSplits
from experiments.studies.propagation import networks
from experiments.studies.propagation.networks import REFERENCE, MaskSource
from experiments.studies.propagation.report import metrics, pooled, shown
from experiments.studies.propagation.sweeps import Sweeps
from experiments.studies.propagation.trial import Trial
from registration.phantom.session_variation import SessionVariation
from registration.phantom.settings import PhantomSettings
from registration.pipeline import CloudFilter, Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings

# What the dashboard has columns for.
HEADLINE = (
    *("dsc_mean", "hd95_mm_mean", "missed_rate", "false_alarm_rate", "surface_rmse_mm_median"),
    *("surface_hd95_mm_median", "surfaces_failed", "rmse_mm_median", "tre_mm_median"),
    *("deformed_tre_mm_median", "success_tre_rate", "registrations_failed"),
)


def run(
    *,
    dataset: DataSet,
    configurations: Sequence[str],
    model_paths: Sequence[PathSetting] | None,
    split: GroupSplits,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    fold: int | None,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    sessions: SessionVariation | None,
    first_sweep: int,
    sweeps: int,
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    surface: SurfaceMethod,
    pieces: VesselPieces,
    smoothing: TaubinSmoothing,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    max_gap_s: float,
    samples: int,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    workers: int,
    cache: str,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Segment all sweeps by one network, reconstruct and register each, and measure what its masks leave.

    Parameters
    ----------
    dataset : DataSet
        San Raffaele; its own ``subset`` and ``subsample_to`` give way to the configuration's.
    configurations : sequence of str
        Name of the one configuration of the job; ``reference`` takes the simulator's own masks.
    model_paths : sequence of PathSetting or None
        Model file of the job, used as it is; None trains a network on the configuration.
    split : GroupSplits
        Division of the groups outside the test into training, validation and unseen.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    trainer : TrainerSettings
        Settings of the training; device and threads of a model file as well.
    augmentation : Augmentation
        Augmentation of the training images.
    loss : Loss
        Training loss.
    init : Initialisation
        Weights that all folds start from.
    fold : int or None
        Number of the fold; None where nothing is trained.
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Names of the phantoms. Each sweep of ``random`` is of another vessel.
    sessions : SessionVariation or None
        What differs between the sweeps besides the vessel; None for nothing.
    first_sweep : int
        Number of the first sweep, from 1000 on.
    sweeps : int
        Number of sweeps of each phantom.
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
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    samples : int
        Number of places on each surface where distances are measured.
    fixed_points : int
        Number of points drawn from the fixed model.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    workers : int
        Processes that simulate the pictures that are not in the cache.
    cache : str
        Folder that keeps the pictures.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each sweep, tables, the figure and findings.

    Raises
    ------
    InputError
        If the data set cannot be read or divided, or a file holds no model.
    """
    (name,) = configurations
    if name == REFERENCE:
        source = networks.reference()
    elif model_paths is not None:
        source = networks.of_file(Path(model_paths[0]), trainer)
    else:
        assert fold is not None
        one = FoldRun(model, preprocessing, trainer, augmentation, loss, init, seed, fold)
        source = networks.trained(one, configured(dataset, configurations), split, workspace, progress)
    plan = Sweeps(phantom, phantoms, first_sweep, sweeps, sessions, cache)
    chain = Reconstruction(contours, filters, surface, smoothing, None, mask_outliers, pieces)
    stages = RegistrationStages(rigid, deformable, fixed_points, inlier_mm, keep, seed)
    trained_in = fold if name != REFERENCE and model_paths is None else None
    rows = _rows(plan, Trial(chain, stages, max_gap_s, samples), source, workers, progress)
    about = {"configuration": name, "model": source.model, "seed": seed}
    return _outcome(rows, about, trained_in, source, rigid, deformable)


def _rows(
    plan: Sweeps, trial: Trial, source: MaskSource, workers: int, progress: Progress
) -> list[dict[str, Any]]:
    """A row for each sweep."""
    planned = plan.planned()
    if source.pictures:
        progress.note(f"simulating {len(planned)} sweeps, those in the cache left out")
        plan.prepare(workers)
    rows = []
    for each in progress.track(planned, "sweeps", len(planned)):
        truth = plan.simulated(each, source.pictures)
        place = {"phantom": each.phantom, "vessel": each.vessel, "sweep": each.number}
        rows.append({**place, **trial(truth, source.values_of(truth))})
    return rows


def _outcome(
    rows: Sequence[Mapping[str, Any]],
    about: Mapping[str, Any],
    fold: int | None,
    source: MaskSource,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
) -> Outcome:
    import pandas as pd

    names = {"rigid": one_method(rigid)[0], "deformable": one_method(deformable, "deformable")[0]}
    place = {"fold": networks.NO_FOLD if fold is None else fold}
    cases = pd.DataFrame(rows).assign(**about, **place, simulated=True, **names)
    tags = {"configuration": str(about["configuration"]), "simulated": "true", **names, **source.tags}
    found = shown(cases, notes=source.notes)
    return replace(
        found,
        metrics={**metrics(cases), **source.metrics},
        history=source.history,
        tags={**tags, **({"model": source.model} if source.model else {})},
        inputs=source.inputs,
    )


def over_repeats(results: list[JobResult]) -> dict[str, float]:
    """Summarise the sweeps of all networks of one configuration.

    Parameters
    ----------
    results : list of JobResult
        Results of its folds and seeds.

    Returns
    -------
    dict
        Metrics over all of their rows.
    """
    cases = pooled(results)
    return {} if cases is None else metrics(cases)


def summarise(results: list[JobResult]) -> Outcome:
    """Compare all configurations, and correlate the quality of masks with the errors that they leave.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Cases, tables, the figure and findings over all jobs; metrics of the correlations alone.
    """
    cases = pooled(results)
    if cases is None:
        return Outcome(findings=("No job has sweeps to compare.",))
    return shown(cases, results=results)
