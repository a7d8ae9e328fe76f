"""Study ``pipeline``: one simulated sweep from its frames to the registered vessel, each stage timed and measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.reconstruction_faults import mask_record, surface_record
from experiments.analysis.registration.registered_sweep import RegistrationStages
from experiments.analysis.registration.slicer_result import require_slicer
from experiments.errors import InputError
from experiments.inputs.surfaces import one_method
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.pipeline.report import LeftOut, Registered, outcome, write
from registration.centerline.extractor import CenterlineExtractor
from registration.errors import InputError as RegistrationInputError
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import STAGES, CloudFilter, Gathered, Reconstructed, Reconstruction, timed
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    import pandas as pd

    from registration.phantom.scan import SimulatedSweep


# What the dashboard has columns for.
HEADLINE = (
    *(
        "dsc_mean",
        "hd95_mm_mean",
        "points",
        "rmse_mm",
        "surface_hd95_mm",
        "tre_mm",
        "tre_rigid_mm",
        "deformed_rmse_mm",
    ),
    *("deformed_tre_mm", "segmentation_s", "reconstruction_s", "registration_s", "deformable_s"),
)


def check(
    *, model_path: PathSetting, rigid: Mapping[str, Any], deformable: Mapping[str, Any], slicer: str
) -> None:
    """Check that the network exists, and that there is one method a stage.

    Parameters
    ----------
    model_path : PathSetting
        File of a model; its thresholds and morphology make the masks.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer: a scene, a bundle of all in one file beside it, or nothing.

    Raises
    ------
    InputError
        If ``model_path`` is no file, a stage has no method or several, or ``slicer`` is another.
    """
    require_slicer(slicer)
    one_method(rigid)
    one_method(deformable, "deformable")
    if not Path(model_path).is_file():
        raise InputError(
            f"model_path: expected a model file or a network trained by study=segmentation (model.pt), received "
            f"{model_path!r}"
        )


def run(
    *,
    phantom: PhantomSettings,
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    surface: SurfaceMethod,
    pieces: VesselPieces,
    smoothing: TaubinSmoothing,
    centerline: CenterlineExtractor,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    model_path: PathSetting,
    sweep_index: int,
    max_gap_s: float,
    fixed_points: int,
    slicer: str,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Simulate a sweep, segment it, reconstruct the vessel, register it to the phantom's model and deform the model.

    Leaves ``cloud.ply``, ``surface.ply`` and ``centerline.vtp`` (world, mm), ``moved.ply`` and ``model.ply``
    (ct, mm), ``fixed_T_moving.h5``, ``truth.json``, ``registration.json`` and, for 3D Slicer, ``scene.mrml`` in
    ``workspace``, and after a deformable stage
    ``model_deformed.ply``, ``moved_deformed.ply`` and the displacement. Points of which no surface can be made are
    registered all the same.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
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
    model_path : PathSetting
        File of a model; its thresholds and morphology make the masks.
    sweep_index : int
        Number of the simulated sweep, from 0.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    fixed_points : int
        Number of points drawn from the fixed model for the registration.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer: a scene, a bundle of all in one file beside it, or nothing.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each frame, tables, figures and findings.

    Raises
    ------
    InputError
        If the network finds no vessel in any frame.
    """
    from models.predictor import Predictor

    chain = Reconstruction(contours, filters, surface, smoothing, centerline, mask_outliers, pieces)
    seconds: dict[str, float] = {}
    progress.note("simulating the sweep")
    with timed(seconds, "simulation_s"):
        truth = simulate_sweep(phantom, sweep_index)
    predictor = Predictor.load(model_path, engine="auto")
    progress.note(f"segmenting {len(truth.sweep.images)} frames")
    with timed(seconds, "segmentation_s"):
        values = predictor.soft_masks(truth.sweep.images, truth.sweep.calibration.spacing_mm)
    posed = synchronise(truth.sweep, max_gap_s)
    shown = posed.select(values)
    if not (shown >= contours.level).any():
        raise InputError(f"model_path: expected a network that finds the vessel, {model_path} found none")
    gathered, built, refusal = _reconstructed(chain, shown, posed.world_A_pixel, seconds)
    left_out = LeftOut(
        mask_record(gathered, posed.kept), None if built is None else surface_record(built, posed.kept)
    )
    progress.note(f"registering {len(gathered.cloud)} points by {', '.join([*rigid, *deformable])}")
    stages = RegistrationStages(rigid, deformable, fixed_points, inlier_mm, keep, seed)
    placed = stages(truth, gathered.cloud, posed.kept, seconds)
    found = Registered(gathered.cloud.points_mm, built, refusal, left_out, placed)
    write(workspace, truth, found, slicer)
    masks = values >= 0.5
    dropped = sum(posed.dropped.values())
    name = f"Simulated sweep {sweep_index}, segmented by {Path(model_path).name}"
    return outcome(_score_frames(masks, truth), found, seconds, truth, masks, dropped, name)


def _reconstructed(
    chain: Reconstruction, values: np.ndarray, world_A_pixel: np.ndarray, seconds: dict[str, float]
) -> tuple[Gathered, Reconstructed | None, str]:
    """What there is to register, the surface and centerline through it, or why there are none; stages timed."""
    with timed(seconds, "reconstruction_s"):
        gathered = chain.gather(values, world_A_pixel)
        try:
            built, refusal = chain.build(gathered), ""
        except RegistrationInputError as refused:
            built, refusal = None, str(refused)
    stages = gathered.seconds if built is None else built.seconds
    seconds.update({f"{stage}_s": stages.get(stage, float("nan")) for stage in STAGES})
    return gathered, built, refusal


def _score_frames(masks: np.ndarray, truth: SimulatedSweep) -> pd.DataFrame:
    """A row a frame: DSC and HD95 against the exact mask."""
    import pandas as pd

    from models.metrics.scoring import score_case

    spacing_mm = truth.sweep.calibration.spacing_mm
    scores = [score_case(mask, exact, spacing_mm) for mask, exact in zip(masks, truth.masks, strict=True)]
    return pd.DataFrame([{"frame": index, **vars(score)} for index, score in enumerate(scores)])
