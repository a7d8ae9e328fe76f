"""Study ``pipeline``: one simulated sweep from its frames to the registered vessel, each stage timed and measured."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.outcome import Outcome, Progress
from experiments.studies.registration_inputs import one_method
from experiments.studies.robustness_problem import MOST_TARGETS
from registration import frames
from registration.contours import ContourExtractor
from registration.geometry_io import write_surface
from registration.metrics import pose_error, surface_residuals
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    import pandas as pd

    from registration.metrics import PoseError, SurfaceResiduals
    from registration.phantom.scan import SimulatedSweep
    from registration.results import RigidResult


@dataclass(frozen=True)
class Registered:
    """What the geometric half of the chain found, beside the truth."""

    cloud_mm: np.ndarray
    result: RigidResult
    residuals: SurfaceResiduals
    error: PoseError


def check(*, model_path: str) -> None:
    """Raise InputError unless there is a file at ``model_path``."""
    if not Path(model_path).is_file():
        raise InputError(
            f"model_path: expected a network trained by study=segmentation (model.pt), received {model_path!r}"
        )


def run(
    *,
    phantom: PhantomSettings,
    contours: ContourExtractor,
    rigid: Mapping[str, Any],
    model_path: str,
    sweep_index: int,
    max_gap_s: float,
    voxel_mm: float,
    fixed_points: int,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Simulate a sweep, segment it, place the contours in the world and register them to the phantom's model.

    Leaves ``cloud.ply`` (world, mm), ``moved.ply`` and ``model.ply`` (ct, mm), ``truth.json`` and
    ``registration.json`` in ``workspace``. Raises InputError when the network finds no vessel in any frame.
    """
    from models.predictor import Predictor

    name, method = one_method(rigid)
    seconds: dict[str, float] = {}
    progress.note("simulating the sweep")
    with _timed(seconds, "simulation_s"):
        truth = simulate_sweep(phantom, sweep_index)
    predictor = Predictor.load(model_path)
    progress.note(f"segmenting {len(truth.sweep.images)} frames")
    with _timed(seconds, "segmentation_s"):
        probability = predictor.probability(truth.sweep.images)
    with _timed(seconds, "reconstruction_s"):
        posed = synchronise(truth.sweep, max_gap_s)
        cloud = contours(probability[posed.kept], posed.world_A_pixel)
        if not len(cloud.points_mm):
            raise InputError(f"model_path: expected a network that finds the vessel, {model_path} found none")
        cloud_mm = _thinned(cloud.points_mm, voxel_mm)
    progress.note(f"registering {len(cloud_mm)} points by {name}")
    fixed_mm = _drawn(truth, fixed_points, seed)
    with _timed(seconds, "registration_s"):
        result: RigidResult = method(cloud_mm, fixed_mm, None)
    residuals = surface_residuals(
        cloud_mm, truth.model, result.fixed_T_moving, inlier_mm=inlier_mm, keep=keep, seed=seed
    )
    error = pose_error(result.fixed_T_moving, truth.ct_T_world, _targets(truth))
    found = Registered(cloud_mm, result, residuals, error)
    _write(workspace, truth, found, name)
    masks = probability >= predictor.threshold
    return _outcome(
        _score_frames(masks, truth), found, seconds, truth, masks, name, sum(posed.dropped.values())
    )


def _drawn(truth: SimulatedSweep, count: int, seed: int) -> np.ndarray:
    """Points of the fixed model, uniformly by area, (count, 3), in mm in the ct frame."""
    return truth.model.sample(count, np.random.default_rng([seed, 1]))


def _targets(truth: SimulatedSweep) -> np.ndarray:
    """Where the error is measured, (t, 3) in mm in the ct frame: the centerline, or the surface where there is none."""
    if truth.centerline is not None:
        return truth.centerline.even_points(MOST_TARGETS)
    return truth.anatomy.sample(MOST_TARGETS, np.random.default_rng(0))


def _thinned(points_mm: np.ndarray, voxel_mm: float) -> np.ndarray:
    """One point, the mean, for each cube of side ``voxel_mm`` that holds any."""
    import open3d

    if not voxel_mm > 0:
        raise InputError(f"voxel_mm: expected a positive number of mm, received {voxel_mm!r}")
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_mm))
    return np.asarray(cloud.voxel_down_sample(voxel_mm).points)


def _score_frames(masks: np.ndarray, truth: SimulatedSweep) -> pd.DataFrame:
    """A row a frame: DSC and HD95 against the exact mask."""
    import pandas as pd

    from models.scoring import score_case

    spacing_mm = truth.sweep.calibration.spacing_mm
    scores = [score_case(mask, exact, spacing_mm) for mask, exact in zip(masks, truth.masks, strict=True)]
    return pd.DataFrame([{"frame": index, **vars(score)} for index, score in enumerate(scores)])


def _write(workspace: Path, truth: SimulatedSweep, found: Registered, name: str) -> None:
    write_surface(workspace / "cloud.ply", found.cloud_mm)
    write_surface(workspace / "moved.ply", frames.apply(found.result.fixed_T_moving, found.cloud_mm))
    write_surface(workspace / "model.ply", truth.model)
    # The cloud lies in the world and the model in the ct frame, so the truth is ct_T_world.
    files.write_text(workspace / "truth.json", json.dumps({"fixed_T_moving": truth.ct_T_world.tolist()}))
    answer = {"rigid": name, "fixed_T_moving": found.result.fixed_T_moving.tolist()}
    files.write_text(workspace / "registration.json", json.dumps(answer))


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

    from experiments.studies.pipeline_report import figures
    from models.scoring import summarise

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
    }
    row = {
        "rigid": name,
        "dsc": scores["dsc_mean"],
        "rmse_mm": residuals["rmse_mm"],
        "tre_mm": error["tre_mm"],
    }
    finding = (
        f"{name}: {residuals['rmse_mm']:.2f} mm RMSE to the model and {error['tre_mm']:.2f} mm TRE on a simulated "
        f"sweep whose frames were segmented with a mean DSC of {scores['dsc_mean']:.3f}."
    )
    return Outcome(
        metrics=metrics,
        cases=cases.assign(simulated=True),
        tables={"One unseen sweep, simulated": pd.DataFrame([{**row, **seconds}])},
        figures=figures(truth, masks, found.cloud_mm, found.result.fixed_T_moving),
        findings=(finding,),
        tags={"rigid": name, "simulated": "true"},
    )


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    begin_s = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin_s
