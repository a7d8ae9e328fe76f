"""Study ``reconstruct``: a tracked sweep and its masks become the vessel's surface and centerline."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.inputs.paths import SweepReader, describe_dropped, input_data, require_exists
from experiments.outcome import InputData, Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.reconstruct.masks import read_masks
from experiments.studies.reconstruct.report import cases, metrics, record, remarks, scene, table
from registration.centerline.extractor import CenterlineExtractor
from registration.io.centerlines import write_centerline
from registration.io.patient_space import write_model
from registration.io.point_clouds import write_cloud
from registration.pipeline import CloudFilter, Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    import pandas as pd

    from registration.pipeline import Reconstructed
    from registration.sweep import TrackedSweep

WHERE = "The files are in mm in the sweep's world frame; open scene.html in a browser to look at them."


def check(*, sweep: PathSetting, masks: PathSetting | None, model_path: PathSetting | None) -> None:
    """Check that the files exist and that either masks or a network is given.

    Parameters
    ----------
    sweep : PathSetting
        Path of the tracked sweep: a folder, ``.igs.mha``, ``.igs.nrrd`` or bag.
    masks : PathSetting or None
        Folder or .npy file of masks or probabilities; None to use a network.
    model_path : PathSetting or None
        File of a model; its thresholds and morphology make the masks. None with ``masks``.

    Raises
    ------
    InputError
        If a file does not exist, or not exactly one of ``masks`` and ``model_path`` is given.
    """
    require_exists(sweep, "sweep")
    if (masks is None) == (model_path is None):
        received = "neither" if masks is None else "both"
        raise InputError(f"masks and model_path: expected one of them, received {received}")
    if masks is not None:
        require_exists(masks, "masks")
    elif not Path(str(model_path)).is_file():
        raise InputError(
            f"model_path: expected a model file or a network trained by study=segmentation (model.pt), received "
            f"{model_path!r}"
        )


def run(
    *,
    sweep: PathSetting,
    acquisition: SweepReader,
    masks: PathSetting | None,
    model_path: PathSetting | None,
    mask_outliers: MaskOutliers,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    surface: SurfaceMethod,
    pieces: VesselPieces,
    smoothing: TaubinSmoothing,
    centerline: CenterlineExtractor,
    max_gap_s: float,
    offset_s: float,
    near_mm: float,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Reconstruct the vessel in the sweep's world frame, in mm.

    Leaves ``cloud.ply``, ``surface.ply``, ``surface.stl``, ``centerline.vtp``, ``centerline.csv``,
    ``centerline.mrk.json``, ``reconstruction.json`` and ``scene.html`` in ``workspace``. Frames without a
    pose are dropped and counted.

    Parameters
    ----------
    sweep : PathSetting
        Path of the tracked sweep: a folder, ``.igs.mha``, ``.igs.nrrd`` or bag.
    acquisition : SweepReader
        Reader of the sweep.
    masks : PathSetting or None
        Folder or .npy file of masks or probabilities; None to use a network.
    model_path : PathSetting or None
        File of a model; its thresholds and morphology make the masks. None with ``masks``.
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
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    offset_s : float
        Added to the times of the poses, in s.
    near_mm : float
        Distance in mm of a measured point within which the surface counts as measured.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each frame with a pose, the table and findings.

    Raises
    ------
    InputError
        If no frame has a pose, or the masks do not fit the frames or show no vessel.
    """
    check(sweep=sweep, masks=masks, model_path=model_path)
    chain = Reconstruction(contours, filters, surface, smoothing, centerline, mask_outliers, pieces)
    path = require_exists(sweep, "sweep")
    progress.note(f"reading {path}")
    recorded = acquisition(path)
    posed = synchronise(recorded, max_gap_s, offset_s)
    if not len(posed.kept):
        raise InputError(
            f"sweep: expected frames with a pose in {path}, received none; dropped: {describe_dropped(posed.dropped)}"
        )
    values, source = _masks(masks, model_path, path, recorded, progress)
    found = chain(posed.select(values), posed.world_A_pixel, progress.note)
    _write(workspace, found)
    report = record(found, posed, recorded, near_mm) | {
        "sweep": str(path),
        "masks": source.source,
        "notes": list(recorded.notes),
    }
    text = json.dumps(report, indent=2, allow_nan=False)
    files.write_text(workspace / "reconstruction.json", text + "\n")
    scene(found, report, path.name).write(workspace / "scene.html")
    return _outcome(found, report, cases(found, posed, recorded), (input_data(path), source))


def _masks(
    masks: PathSetting | None,
    model_path: PathSetting | None,
    sweep_path: Path,
    sweep: TrackedSweep,
    progress: Progress,
) -> tuple[np.ndarray, InputData]:
    """Masks or probabilities of all frames, and where they are from."""
    if masks is not None:
        progress.note(f"reading masks of {len(sweep.images)} frames")
        path = require_exists(masks, "masks")
        return read_masks(path, sweep_path, sweep), input_data(path)
    from models.predictor import Predictor

    progress.note(f"segmenting {len(sweep.images)} frames")
    predictor = Predictor.load(str(model_path), engine="auto")
    values = predictor.soft_masks(sweep.images, sweep.calibration.spacing_mm)
    return values, input_data(Path(str(model_path)))


def _write(workspace: Path, found: Reconstructed) -> None:
    write_cloud(workspace / "cloud.ply", found.cloud)
    for suffix in ("ply", "stl"):
        write_model(workspace / f"surface.{suffix}", found.surface)
    if found.centerline is not None:
        for suffix in ("vtp", "csv", "mrk.json"):
            write_centerline(workspace / f"centerline.{suffix}", found.centerline)


def _outcome(
    found: Reconstructed,
    report: Mapping[str, Any],
    table_of_frames: pd.DataFrame,
    inputs: tuple[InputData, ...],
) -> Outcome:
    return Outcome(
        metrics=metrics(report),
        cases=table_of_frames,
        tables={"reconstruction": table(report)},
        findings=(*report["notes"], *remarks(found, report), WHERE),
        inputs=inputs,
    )
