"""Study ``pipeline``: one simulated sweep from its frames to the registered vessel, each stage timed and measured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import files
from experiments.analysis.registration.reconstruction_faults import (
    mask_record,
    numbers,
    sentences,
    surface_record,
)
from experiments.analysis.registration.simulated_truth import targets_of, truth_record
from experiments.errors import InputError
from experiments.inputs.surfaces import one_method
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from registration import transforms
from registration.centerline.extractor import CenterlineExtractor
from registration.errors import InputError as RegistrationInputError
from registration.io.centerlines import write_centerline
from registration.io.surfaces import write_surface
from registration.metrics.surface_distance import pose_error, surface_residuals
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import STAGES, CloudFilter, Gathered, Reconstructed, Reconstruction, timed
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces
from registration.rigid.result import verdict_sentence
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    import pandas as pd

    from registration.metrics.surface_distance import PoseError, SurfaceResiduals
    from registration.phantom.scan import SimulatedSweep
    from registration.rigid.result import RigidResult


@dataclass(frozen=True)
class LeftOut:
    """Records of what the reconstruction left out.

    Parameters
    ----------
    masks : dict
        What was left out of the masks.
    surface : dict or None
        What was left out of the surface; None where there is no surface.
    """

    masks: dict[str, Any]
    surface: dict[str, Any] | None


@dataclass(frozen=True)
class Registered:
    """What the geometric half of the chain found, with its error.

    Parameters
    ----------
    cloud_mm : ndarray, shape (p, 3)
        Point cloud in the world frame in mm.
    built : Reconstructed or None
        Surface and centerline; None where no surface can be made.
    refusal : str
        Why there is no surface; empty otherwise.
    left_out : LeftOut
        What the reconstruction left out.
    result : RigidResult
        Result of the registration.
    residuals : SurfaceResiduals
        Residuals between the cloud and the model.
    error : PoseError
        Error of the pose against the truth.
    """

    cloud_mm: np.ndarray
    built: Reconstructed | None
    refusal: str
    left_out: LeftOut
    result: RigidResult
    residuals: SurfaceResiduals
    error: PoseError


def check(*, model_path: PathSetting) -> None:
    """Check that the network exists.

    Parameters
    ----------
    model_path : PathSetting
        File of a model; its thresholds and morphology make the masks.

    Raises
    ------
    InputError
        If ``model_path`` is no file.
    """
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
    model_path: PathSetting,
    sweep_index: int,
    max_gap_s: float,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Simulate a sweep, segment it, reconstruct the vessel and register it to the phantom's model.

    Leaves ``cloud.ply``, ``surface.ply`` and ``centerline.vtp`` (world, mm), ``moved.ply`` and ``model.ply``
    (ct, mm), ``truth.json`` and ``registration.json`` in ``workspace``. Points of which no surface can be
    made are registered all the same.

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
    model_path : PathSetting
        File of a model; its thresholds and morphology make the masks.
    sweep_index : int
        Number of the simulated sweep, from 0.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    fixed_points : int
        Number of points drawn from the fixed model for the registration.
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

    name, method = one_method(rigid)
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
    if not (values[posed.kept] >= contours.level).any():
        raise InputError(f"model_path: expected a network that finds the vessel, {model_path} found none")
    gathered, built, refusal = _reconstructed(chain, values[posed.kept], posed.world_A_pixel, seconds)
    cloud, cloud_mm = gathered.cloud, gathered.cloud.points_mm
    progress.note(f"registering {len(cloud_mm)} points by {name}")
    fixed_mm = _drawn(truth, fixed_points, seed)
    with timed(seconds, "registration_s"):
        result: RigidResult = method(cloud_mm, fixed_mm, None, moving_frame=cloud.frame_index)
    residuals = surface_residuals(
        cloud_mm, truth.model, result.fixed_T_moving, inlier_mm=inlier_mm, keep=keep, seed=seed
    )
    error = pose_error(result.fixed_T_moving, truth.ct_T_world, targets_of(truth))
    left_out = LeftOut(
        mask_record(gathered, posed.kept), None if built is None else surface_record(built, posed.kept)
    )
    found = Registered(cloud_mm, built, refusal, left_out, result, residuals, error)
    _write(workspace, truth, found, name)
    masks = values >= 0.5
    return _outcome(
        _score_frames(masks, truth), found, seconds, truth, masks, name, sum(posed.dropped.values())
    )


def _drawn(truth: SimulatedSweep, count: int, seed: int) -> np.ndarray:
    """Points of the fixed model, uniformly by area, (count, 3), in mm in the ct frame."""
    return truth.model.sample(count, np.random.default_rng([seed, 1]))


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


def _write(workspace: Path, truth: SimulatedSweep, found: Registered, name: str) -> None:
    write_surface(workspace / "cloud.ply", found.cloud_mm)
    if found.built is not None:
        write_surface(workspace / "surface.ply", found.built.surface)
        if found.built.centerline is not None:
            write_centerline(workspace / "centerline.vtp", found.built.centerline)
    write_surface(workspace / "moved.ply", transforms.apply(found.result.fixed_T_moving, found.cloud_mm))
    write_surface(workspace / "model.ply", truth.model)
    # The cloud lies in the world and the model in the ct frame, so the truth is ct_T_world.
    files.write_text(workspace / "truth.json", json.dumps(truth_record(truth)))
    result = found.result
    record = {
        "rigid": name,
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        "verdict": result.verdict,
        "reason": result.reason,
        "reconstruction": {"mask_check": found.left_out.masks, "surface": found.left_out.surface},
    }
    files.write_text(workspace / "registration.json", json.dumps(record))


def _outcome(
    cases: pd.DataFrame,
    found: Registered,
    seconds: dict[str, float],
    truth: SimulatedSweep,
    masks: np.ndarray,
    name: str,
    dropped: int,
) -> Outcome:
    import pandas as pd

    from experiments.studies.pipeline.figures import figures
    from models.metrics.scoring import summarise

    scores = summarise({key: cases[key] for key in ("dsc", "hd95_mm", "missed", "false_alarm")})
    residuals = {
        key: float(getattr(found.residuals, key))
        for key in (
            "rmse_mm",
            "rmse_trimmed_mm",
            "rmse_bidirectional_mm",
            "hd95_mm",
            "inlier_share",
            "coverage",
        )
    }
    # hd95_mm of a case is that of masks; the surfaces' own goes by its place in the chain.
    residuals["surface_hd95_mm"] = residuals.pop("hd95_mm")
    error = {key: float(value) for key, value in vars(found.error).items()}
    metrics = {
        **scores,
        **residuals,
        **error,
        **seconds,
        "points": len(found.cloud_mm),
        "frames_dropped": dropped,
        **numbers(found.left_out.masks, found.left_out.surface),
    }
    row = {
        "rigid": name,
        "dsc": scores["dsc_mean"],
        "rmse_mm": residuals["rmse_mm"],
        "tre_mm": error["tre_mm"],
        "verdict": found.result.verdict,
    }
    finding = (
        f"{name}: {residuals['rmse_mm']:.2f} mm RMSE to the model and {error['tre_mm']:.2f} mm TRE on a simulated "
        f"sweep whose frames were segmented with a mean DSC of {scores['dsc_mean']:.3f}."
    )
    return Outcome(
        metrics=metrics,
        cases=cases.assign(simulated=True),
        tables={
            "One unseen sweep, simulated": pd.DataFrame([row]),
            "Seconds by stage": pd.DataFrame([seconds]),
        },
        figures=figures(truth, masks, found.cloud_mm, found.result.fixed_T_moving),
        findings=(finding, verdict_sentence(found.result), *_gaps(found)),
        tags={"rigid": name, "simulated": "true", "verdict": found.result.verdict},
    )


def _gaps(found: Registered) -> tuple[str, ...]:
    """What the reconstruction lacks, in sentences."""
    said = sentences(found.left_out.masks, found.left_out.surface)
    if found.built is None:
        return (*said, f"There is no surface: {found.refusal}.")
    if found.built.centerline is None:
        return (*said, f"There is no centerline: {found.built.refusal}.")
    return said
