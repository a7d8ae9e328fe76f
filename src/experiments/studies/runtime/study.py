"""Study ``runtime``: how long each stage from acquisition to registration takes, and how much memory, by phantom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from experiments.analysis.registration.phantom_jobs import phantom_jobs, rows_by_phantom
from experiments.errors import InputError
from experiments.inputs.surfaces import one_method
from experiments.outcome import JobResult, Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.runtime.chain import Chain
from experiments.studies.runtime.figure import stacked_bars
from experiments.studies.runtime.report import describe, metrics, tables
from registration.centerline.extractor import CenterlineExtractor
from registration.checks import require_count, require_positive
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

    from models.predictor import Predictor
    from registration.phantom.scan import SimulatedSweep

MASKS = ("model", "exact")


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
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    masks: str,
    model_path: PathSetting | None,
    repeats: int,
    frame_rate_hz: float | None,
) -> None:
    """Check that the settings fit each other.

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
    masks : str
        ``model`` for the masks of a network, ``exact`` for the true ones.
    model_path : PathSetting or None
        File of a model with ``masks=model``; None with ``masks=exact``.
    repeats : int
        Number of repeats, at least 1.
    frame_rate_hz : float or None
        Frame rate of the modelled acquisition in frames/s; None takes that of the sweep.

    Raises
    ------
    InputError
        If a setting is out of range or does not fit the others.
    """
    _settings(phantom, phantoms)
    one_method(rigid)
    one_method(deformable, "deformable")
    require_count("repeats", repeats, 1)
    if frame_rate_hz is not None:
        require_positive("frame_rate_hz", frame_rate_hz)
    if masks not in MASKS:
        raise InputError(f"masks: expected {' or '.join(MASKS)}, received {masks!r}")
    if masks == "exact" and model_path is not None:
        raise InputError(f"model_path: expected null with masks=exact, received {model_path!r}")
    if masks == "model" and (model_path is None or not Path(model_path).is_file()):
        raise InputError(
            "model_path: expected a model file or a network trained by study=segmentation (model.pt), or masks=exact "
            f"for times without segmentation, received {model_path!r}"
        )


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
    centerline: CenterlineExtractor,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    masks: str,
    model_path: PathSetting | None,
    device: Literal["cpu", "cuda"],
    sweep_index: int,
    repeats: int,
    frame_rate_hz: float | None,
    max_gap_s: float,
    fixed_points: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Simulate one sweep of a phantom and time every stage from acquisition to the displaced model, several times.

    The acquisition is modelled by the number of frames and the frame rate; all other stages are measured. The start
    of the process, the loading and preparation of the network and the model from CT precede an intervention and are
    not counted.

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
    centerline : CenterlineExtractor
        Extraction of the centerline.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    masks : str
        ``model`` for the masks of a network, ``exact`` for the true ones: then pre-processing and segmentation are
        left out, and every total says so.
    model_path : PathSetting or None
        File of a model with ``masks=model``; None with ``masks=exact``.
    device : {"cpu", "cuda"}
        Where the network runs.
    sweep_index : int
        Number of the simulated sweep, from 0.
    repeats : int
        Number of repeats of the whole chain on the same sweep.
    frame_rate_hz : float or None
        Frame rate of the modelled acquisition in frames/s; None takes that of the sweep.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    fixed_points : int
        Number of points drawn from the fixed model for the registration.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run; not used.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each stage of each repeat, tables, the figure and findings.

    Raises
    ------
    InputError
        If no frame shows a vessel.
    """
    del workspace
    settings = _settings(phantom, phantoms)
    (name, method), (second, displace) = one_method(rigid), one_method(deformable, "deformable")
    rebuild = Reconstruction(contours, filters, surface, smoothing, None, mask_outliers, pieces)
    progress.note(f"simulating {settings.motion.frames} frames of {settings.subset}")
    truth = simulate_sweep(settings, sweep_index, pictures=masks == "model")
    predictor = None if model_path is None else _prepared(model_path, device, truth)
    chain = Chain(
        predictor, rebuild, centerline, method, displace, frame_rate_hz, max_gap_s, fixed_points, seed
    )
    known = {"phantom": settings.subset, "rigid": name, "deformable": second, "masks": masks}
    rows = [
        known | {"repeat": repeat, "frames": len(truth.masks), "tre_mm": timed.tre_mm, **asdict(cost)}
        for repeat in progress.track(range(repeats), f"{settings.subset}: repeats", repeats)
        for timed in (chain(truth),)
        for cost in timed.costs
    ]
    import pandas as pd

    shown_here = shown(pd.DataFrame(rows).assign(simulated=True))
    return replace(shown_here, tags={**known, "simulated": "true"})


def summarise(results: list[JobResult]) -> Outcome:
    """Put all phantoms next to each other.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, rows, tables, the figure and findings over all jobs.
    """
    costs = rows_by_phantom(results)
    return Outcome(findings=("No job has times.",)) if costs is None else shown(costs)


def shown(costs: pd.DataFrame) -> Outcome:
    """Make the metrics, tables, figure and findings of any sweeps of this study.

    Parameters
    ----------
    costs : pandas.DataFrame
        A row for each stage of each repeat of each phantom.

    Returns
    -------
    Outcome
        Metrics, rows, tables, the figure and findings.
    """
    return Outcome(
        metrics=metrics(costs),
        cases=costs,
        tables=tables(costs),
        figures={"runtime": stacked_bars(costs)},
        findings=describe(costs),
    )


def _settings(phantom: PhantomSettings, phantoms: Sequence[str]) -> PhantomSettings:
    if len(phantoms) != 1 or phantom.mesh:
        raise InputError(
            f"phantoms: expected one phantom a job and no phantom.mesh, received {list(phantoms)} and "
            f"{phantom.mesh!r}"
        )
    return replace(phantom, subset=phantoms[0])


def _prepared(model_path: PathSetting, device: str, truth: SimulatedSweep) -> Predictor:
    """The model, ready to use: the first batch would pay for the engine's preparation."""
    from models.inference.frames import frames_of
    from models.predictor import Predictor

    predictor = Predictor.load(model_path, device=device, engine="auto")
    first = truth.sweep.images[: predictor.batch_size]
    for _ in predictor.stream(frames_of(first, truth.sweep.calibration.spacing_mm)):
        pass
    return predictor
