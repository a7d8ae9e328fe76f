"""What the study ``pipeline`` reports of one registered sweep: files, metrics, tables, figures and findings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.registration.pose_scores import plain
from experiments.analysis.registration.reconstruction_faults import numbers, sentences
from experiments.analysis.registration.simulated_truth import truth_record
from experiments.outcome import Outcome
from registration import transforms
from registration.io.centerlines import write_centerline
from registration.io.surfaces import write_surface
from registration.rigid.result import length_mm, predicted_sentence, verdict_sentence

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    import pandas as pd

    from registration.metrics.surface_distance import PoseError, SurfaceResiduals
    from registration.phantom.scan import SimulatedSweep
    from registration.pipeline import Reconstructed
    from registration.rigid.result import RigidResult

# Of the predicted interval.
LEVEL = 0.9
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
    result : RigidResult
        Result of the registration.
    residuals : SurfaceResiduals
        Residuals between the cloud and the model.
    error : PoseError
        Error of the pose against the truth.
    predicted_tre_mm : tuple of float
        Ends in mm of the interval that is predicted for the error, where it is measured; NaN where none is predicted.
    """

    cloud_mm: np.ndarray
    built: Reconstructed | None
    refusal: str
    left_out: LeftOut
    result: RigidResult
    residuals: SurfaceResiduals
    error: PoseError
    predicted_tre_mm: tuple[float, float]


def write(workspace: Path, truth: SimulatedSweep, found: Registered, name: str) -> None:
    """Write cloud, surface, centerline, registered cloud, model, truth and result as files.

    Parameters
    ----------
    workspace : Path
        Folder of the run.
    truth : SimulatedSweep
        Simulated sweep and its truth.
    found : Registered
        What the geometric half of the chain found.
    name : str
        Name of the registration method.
    """
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
        "predicted_tre_mm": {
            **dict(zip(("low", "high"), map(plain, found.predicted_tre_mm), strict=True)),
            "level": LEVEL,
        },
        "measured_tre_mm": float(found.error.tre_mm),
        "reconstruction": {"mask_check": found.left_out.masks, "surface": found.left_out.surface},
    }
    files.write_text(workspace / "registration.json", json.dumps(record))


def outcome(
    cases: pd.DataFrame,
    found: Registered,
    seconds: dict[str, float],
    truth: SimulatedSweep,
    masks: np.ndarray,
    name: str,
    dropped: int,
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
    name : str
        Name of the registration method.
    dropped : int
        Number of frames without a pose.

    Returns
    -------
    Outcome
        The result of the study.
    """
    import pandas as pd

    from experiments.studies.pipeline.figures import figures
    from models.metrics.scoring import summarise

    scores = summarise({key: cases[key] for key in ("dsc", "hd95_mm", "missed", "false_alarm")})
    measured = _measured(found)
    row = {
        "rigid": name,
        "dsc": scores["dsc_mean"],
        "rmse_mm": measured["rmse_mm"],
        "tre_mm": measured["tre_mm"],
        "verdict": found.result.verdict,
    }
    finding = (
        f"{name}: {row['rmse_mm']:.2f} mm RMSE to the model and {row['tre_mm']:.2f} mm TRE on a simulated "
        f"sweep whose frames were segmented with a mean DSC of {row['dsc']:.3f}."
    )
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
            "One unseen sweep, simulated": pd.DataFrame([row]),
            "Seconds by stage": pd.DataFrame([seconds]),
        },
        figures=figures(truth, masks, found.cloud_mm, found.result.fixed_T_moving),
        findings=(finding, verdict_sentence(found.result), *_predicted(found), *_gaps(found)),
        tags={"rigid": name, "simulated": "true", "verdict": found.result.verdict},
    )


def _predicted(found: Registered) -> tuple[str, ...]:
    """The predicted error in a sentence, and the measured one beside it."""
    sentence = predicted_sentence(*found.predicted_tre_mm, found.result.deformation)
    return (f"{sentence} Measured: {length_mm(float(found.error.tre_mm))}.",) if sentence else ()


def _measured(found: Registered) -> dict[str, float]:
    """Residuals and pose errors by the names of their metrics."""
    residuals = {key: float(getattr(found.residuals, key)) for key in RESIDUALS}
    # hd95_mm of a case is that of masks; the surfaces' own goes by its place in the chain.
    residuals["surface_hd95_mm"] = residuals.pop("hd95_mm")
    return residuals | {key: float(value) for key, value in vars(found.error).items()}


def _gaps(found: Registered) -> tuple[str, ...]:
    """What the reconstruction lacks, in sentences."""
    left_out = sentences(found.left_out.masks, found.left_out.surface)
    if found.built is None:
        return (*left_out, f"There is no surface: {found.refusal}.")
    if found.built.centerline is None:
        return (*left_out, f"There is no centerline: {found.built.refusal}.")
    return left_out
