"""What the study ``pipeline`` reports of one registered sweep: files, metrics, tables, figures and findings."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.registration.deformed_model import (
    deformed_record,
    deformed_sentences,
    write_deformed,
)
from experiments.analysis.registration.pose_scores import plain
from experiments.analysis.registration.reconstruction_faults import numbers, sentences
from experiments.analysis.registration.registered_sweep import LEVEL, RegisteredSweep, StageError
from experiments.analysis.registration.simulated_truth import truth_record
from experiments.analysis.registration.slicer_result import write_slicer_result
from experiments.outcome import Outcome
from experiments.studies.pipeline.scene import pipeline_scene, pipeline_slicer_result
from registration import transforms
from registration.io.centerlines import write_centerline
from registration.io.surfaces import write_surface
from registration.io.transforms import write_transform
from registration.rigid.result import length_mm, predicted_sentence, verdict_sentence

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    import pandas as pd

    from registration.metrics.surface_distance import SurfaceResiduals
    from registration.phantom.scan import SimulatedSweep
    from registration.pipeline import Reconstructed

RESIDUALS = ("rmse_mm", "rmse_trimmed_mm", "rmse_bidirectional_mm", "hd95_mm", "inlier_share", "coverage")


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
    registered : RegisteredSweep
        Results of the registration's stages, with their errors.
    """

    cloud_mm: np.ndarray
    built: Reconstructed | None
    refusal: str
    left_out: LeftOut
    registered: RegisteredSweep


def write(workspace: Path, truth: SimulatedSweep, found: Registered, slicer: str) -> None:
    """Write cloud, surface, centerline, registered cloud, model, deformed model, truth and result as files.

    Parameters
    ----------
    workspace : Path
        Folder of the run.
    truth : SimulatedSweep
        Simulated sweep and its truth.
    found : Registered
        What the geometric half of the chain found.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer.
    """
    write_surface(workspace / "cloud.ply", found.cloud_mm)
    if found.built is not None:
        write_surface(workspace / "surface.ply", found.built.surface)
        if found.built.centerline is not None:
            write_centerline(workspace / "centerline.vtp", found.built.centerline)
    registered, result = found.registered, found.registered.result
    write_surface(workspace / "moved.ply", transforms.apply(result.fixed_T_moving, found.cloud_mm))
    write_transform(workspace / "fixed_T_moving.h5", result.fixed_T_moving)
    write_surface(workspace / "model.ply", truth.model)
    if registered.deformed is not None:
        write_deformed(registered.deformed, workspace)
    # The cloud lies in the world and the model in the ct frame, so the truth is ct_T_world.
    files.write_text(workspace / "truth.json", json.dumps(truth_record(truth)))
    deformed = deformed_record(registered.deformed, RESIDUALS)
    record = {
        "rigid": registered.rigid,
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        "verdict": result.verdict,
        "reason": result.reason,
        "predicted_tre_mm": _bounds(registered.error),
        "measured_tre_mm": plain(registered.error.tre_mm),
        "deformable": deformed
        and deformed
        | {
            "measured_tre_mm": plain(_after(registered).tre_mm),
            # Where it was measured; that of the method itself is over the whole model.
            "predicted_tre_at_targets_mm": _bounds(_after(registered)),
        },
        "deformable_refused": registered.refusal,
        "reconstruction": {"mask_check": found.left_out.masks, "surface": found.left_out.surface},
    }
    files.write_text(workspace / "registration.json", json.dumps(record))
    shown = pipeline_slicer_result(truth, found.cloud_mm, found.built, registered)
    write_slicer_result(workspace, shown, slicer)


def outcome(
    cases: pd.DataFrame,
    found: Registered,
    seconds: dict[str, float],
    truth: SimulatedSweep,
    masks: np.ndarray,
    dropped: int,
    name: str,
) -> Outcome:
    """Collect metrics, tables, figures and findings of one registered sweep.

    Parameters
    ----------
    cases : pandas.DataFrame
        A row for each frame: its DSC and HD95 in mm against the exact mask.
    found : Registered
        What the geometric half of the chain found.
    seconds : dict of str to float
        Seconds of each stage.
    truth : SimulatedSweep
        Simulated sweep and its truth.
    masks : ndarray of bool, shape (n, h, w)
        Masks that the network found.
    dropped : int
        Number of frames without a pose.
    name : str
        Name of the sweep and of the network in the title of the page.

    Returns
    -------
    Outcome
        The result of the study.
    """
    import pandas as pd

    from experiments.studies.pipeline.figures import figures
    from models.metrics.scoring import summarise

    scores = summarise({key: cases[key] for key in ("dsc", "hd95_mm", "missed", "false_alarm")})
    measured, registered = _measured(found.registered), found.registered
    said = (_finding(registered, scores["dsc_mean"]), *_sentences(registered), *_gaps(found))
    notes = (said[1], said[0], *said[2:])
    scene = pipeline_scene(truth, found.cloud_mm, found.built, registered, notes, name)
    return Outcome(
        metrics={
            **scores,
            **measured,
            **seconds,
            "points": len(found.cloud_mm),
            "frames_dropped": dropped,
            **numbers(found.left_out.masks, found.left_out.surface),
        },
        cases=cases.assign(simulated=True),
        tables={
            "One unseen sweep, simulated": pd.DataFrame(_rows(registered, scores["dsc_mean"])),
            "Seconds by stage": pd.DataFrame([seconds]),
        },
        figures=figures(truth, masks, found.cloud_mm, registered),
        findings=(*said, "scene.html is the page to look at: contours on the model, by their distance."),
        files={"scene.html": scene.write},
        tags={
            "rigid": registered.rigid,
            "deformable": registered.deformed.name if registered.deformed else "none",
            "simulated": "true",
            "verdict": registered.result.verdict,
        },
    )


def _rows(registered: RegisteredSweep, dsc: float) -> list[dict[str, Any]]:
    """A row a stage: residual, error, and the error that was predicted."""
    stages = [(registered.rigid, registered.residuals, registered.error, registered.result.verdict)]
    if registered.deformed is not None:
        deformed = registered.deformed
        stages.append((deformed.name, deformed.residuals, _after(registered), deformed.result.verdict))
    return [
        {
            "stage": name,
            "dsc": dsc,
            "rmse_mm": residuals.rmse_mm,
            "tre_mm": error.tre_mm,
            "predicted_low_mm": error.predicted_mm[0],
            "predicted_high_mm": error.predicted_mm[1],
            "verdict": verdict,
        }
        for name, residuals, error, verdict in stages
    ]


def _bounds(error: StageError) -> dict[str, float | None]:
    return {
        **dict(zip(("low", "high"), map(plain, error.predicted_mm), strict=True)),
        "level": LEVEL,
    }


def _after(registered: RegisteredSweep) -> StageError:
    """The error after the last stage."""
    return registered.deformed_error or registered.error


def _finding(registered: RegisteredSweep, dsc: float) -> str:
    """The chain in a sentence: how well the frames were segmented, and how far the model is off in the end."""
    last = registered.deformed.name if registered.deformed else registered.rigid
    after = ""
    if registered.deformed_error is not None:
        after = f", {length_mm(registered.deformed_error.tre_mm)} after {last}"
    return (
        f"{registered.rigid}: {registered.residuals.rmse_mm:.2f} mm RMSE to the model and "
        f"{length_mm(registered.error.tre_mm)} TRE{after}, on a simulated sweep whose frames were segmented with a "
        f"mean DSC of {dsc:.3f}. The TRE is to where tissue was swept; against the best rigid pose "
        f"it is {length_mm(registered.pose.tre_mm)}."
    )


def _sentences(registered: RegisteredSweep) -> tuple[str, ...]:
    """Verdicts, and the predicted errors with the measured ones."""
    said = [verdict_sentence(registered.result)]
    sentence = predicted_sentence(*registered.error.predicted_mm, registered.result.deformation)
    if sentence:
        said.append(f"{sentence} Measured: {length_mm(registered.error.tre_mm)}.")
    if registered.refusal:
        said.append(f"No deformable registration: {registered.refusal}.")
    if registered.deformed is not None:
        said += deformed_sentences(registered.deformed, registered.residuals.rmse_mm)
    if registered.deformed_error is not None:
        low_mm, high_mm = registered.deformed_error.predicted_mm
        predicted = (
            f"predicted {length_mm(low_mm)} to {length_mm(high_mm)}; " if math.isfinite(high_mm) else ""
        )
        said.append(
            f"At the targets after it: {predicted}measured {length_mm(registered.deformed_error.tre_mm)}, "
            f"{length_mm(registered.error.tre_mm)} before."
        )
    return tuple(said)


def _measured(registered: RegisteredSweep) -> dict[str, float]:
    """Residuals and errors by the names of their metrics."""
    found = _stage_metrics(registered.residuals, registered.error)
    # Against the best rigid pose: what no rigid pose undoes is left out.
    found |= {key: float(value) for key, value in vars(registered.pose).items() if not key.startswith("tre")}
    found["tre_rigid_mm"] = registered.pose.tre_mm
    if registered.deformed is not None:
        deformed = registered.deformed
        after = _stage_metrics(deformed.residuals, _after(registered))
        found |= {f"deformed_{key}": value for key, value in after.items()}
        found |= {key: float(value) for key, value in vars(deformed.result.plausibility).items()}
    return found


def _stage_metrics(residuals: SurfaceResiduals, error: StageError) -> dict[str, float]:
    found = {key: float(getattr(residuals, key)) for key in RESIDUALS}
    # hd95_mm of a case is that of masks; the surfaces' own goes by its place in the chain.
    found["surface_hd95_mm"] = found.pop("hd95_mm")
    names = ("tre_mm", "tre_max_mm", "tre_covered_mm", "tre_uncovered_mm")
    # What is not defined, such as the uncovered part of a vessel that was swept whole, is no failure.
    return found | {key: value for key in names if math.isfinite(value := getattr(error, key))}


def _gaps(found: Registered) -> tuple[str, ...]:
    """What the reconstruction lacks, in sentences."""
    left_out = sentences(found.left_out.masks, found.left_out.surface)
    if found.built is None:
        return (*left_out, f"There is no surface: {found.refusal}.")
    if found.built.centerline is None:
        return (*left_out, f"There is no centerline: {found.built.refusal}.")
    return left_out
