"""What a registration of two files leaves behind: files, metrics, and sentences that say what was found."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from experiments import files
from experiments.analysis.registration.deformed_model import Deformed, deformed_sentences, write_deformed
from experiments.analysis.registration.slicer_result import BUNDLE, FILES, NONE, write_slicer_result
from experiments.outcome import Outcome
from experiments.studies.register.carried import landmark_errors_mm, write_carried
from experiments.studies.register.doubts import doubts
from experiments.studies.register.record import LENGTHS, SHARES, Registered, record
from experiments.studies.register.scene import register_scene
from experiments.studies.register.slicer import slicer_result
from registration.geometry.shapes import transformed
from registration.io.surfaces import write_surface
from registration.io.transforms import write_transform
from registration.metrics.surface_distance import rms
from registration.rigid.result import (
    AMBIGUOUS,
    FAILED,
    RigidResult,
    length_mm,
    percent,
    predicted_sentence,
    verdict_sentence,
)

# Landmarks whose error is this many times what they and the surfaces reach at best speak for another pose.
LANDMARK_FACTOR = 5.0
# Surfaces that show one vessel with less than this probability may each show a part of it.
UNLIKELY = 0.5
# An offset of the walls below this is what masks and models have anyway.
NOTED_OFFSET_MM = 0.2


def write(found: Registered, workspace: Path, slicer: str) -> None:
    """Write registration.json, moved.ply, fixed_T_moving.h5, scene.html and what 3D Slicer opens.

    Parameters
    ----------
    found : Registered
        Registered pair.
    workspace : Path
        Folder of the run in which result files are left.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer.
    """
    pose = found.result.fixed_T_moving
    record_text = json.dumps(record(found), indent=2, allow_nan=False)
    files.write_text(workspace / "registration.json", record_text + "\n")
    write_surface(workspace / "moved.ply", transformed(found.pair.moving.surface, pose))
    write_transform(workspace / "fixed_T_moving.h5", pose)
    if found.deformed is not None:
        write_deformed(found.deformed, workspace)
        write_carried(found.carried, found.deformed, found.pair, pose, workspace)
    residual, verdict, *more = _findings(found)
    rival = found.result.rival_fixed_T_moving if found.result.verdict == AMBIGUOUS else None
    notes, judged = (verdict, *more, residual), found.result.verdict
    scene = register_scene(found.pair, pose, found.name, notes, rival, found.deformed, judged)
    scene.write(workspace / "scene.html")
    write_slicer_result(workspace, slicer_result(found), slicer)


def outcome(found: Registered, slicer: str) -> Outcome:
    """Make the outcome of the study.

    Parameters
    ----------
    found : Registered
        Registered pair.
    slicer : {'scene', 'bundle', 'none'}
        What was written for 3D Slicer.

    Returns
    -------
    Outcome
        Metrics, the table of one row and the findings.
    """
    import pandas as pd

    result, residuals = found.result, found.residuals
    metrics = {key: float(getattr(residuals, key)) for key in (*LENGTHS, *SHARES)}
    metrics |= {"iterations": float(result.iterations), "runtime_s": result.runtime_s}
    errors_mm = found.landmark_errors_mm
    if errors_mm is not None:
        metrics |= {"landmark_error_mm": rms(errors_mm), "landmark_error_max_mm": float(errors_mm.max())}
    shown = ("rmse_mm", "rmse_trimmed_mm", "inlier_share", "coverage", "landmark_error_mm", "runtime_s")
    row: dict[str, Any] = {"rigid": found.name, "verdict": result.verdict}
    row |= {key: metrics[key] for key in shown if key in metrics}
    low_mm, high_mm = found.predicted_tre_mm
    predicted = {
        "ambiguity_gap": result.ambiguity_gap,
        "predicted_tre_low_mm": low_mm,
        "predicted_tre_high_mm": high_mm,
        "tre_mm": found.measured_tre_mm,
    }
    return Outcome(
        metrics={
            **metrics,
            # What a method does not know is no failure of it, so it is no metric either.
            **{key: float(value) for key, value in predicted.items() if math.isfinite(value)},
            **_of_deformed(found),
            "converged": float(result.converged),
            "candidates": float(len(result.candidates)),
        },
        tables={"registration": pd.DataFrame([row])},
        findings=(
            *_findings(found),
            "registration.json holds the pose and all candidates, moved.ply the moved surface in mm (LPS), "
            "fixed_T_moving.h5 the transform for ITK and 3D Slicer, scene.html the page to look at.",
            *_files_of_deformed(found),
            *((f"{FILES[slicer == BUNDLE]} is the scene for 3D Slicer.",) if slicer != NONE else ()),
        ),
        tags={"rigid": found.name, "verdict": result.verdict},
        inputs=found.pair.inputs,
    )


def _of_deformed(found: Registered) -> dict[str, float]:
    """Metrics of the deformable stage."""
    if found.deformed is None:
        return {}
    result, (low_mm, high_mm) = found.deformed.result, found.deformed.predicted_tre_mm
    metrics = {f"deformed_{key}": float(getattr(found.deformed.residuals, key)) for key in LENGTHS}
    metrics |= {"deformation_mm": result.size_mm, "strain_p95": result.plausibility.strain_p95}
    metrics |= {"jacobian_min": result.plausibility.jacobian_min, "deformable_runtime_s": result.runtime_s}
    errors_mm = landmark_errors_mm(found.deformed, found.pair, found.result.fixed_T_moving)
    if errors_mm is not None:
        metrics["deformed_landmark_error_mm"] = rms(errors_mm)
    metrics |= {"deformed_predicted_tre_low_mm": low_mm, "deformed_predicted_tre_high_mm": high_mm}
    return {key: value for key, value in metrics.items() if math.isfinite(value)}


def _files_of_deformed(found: Registered) -> list[str]:
    if found.deformed is None:
        return []
    return [
        "moved_deformed.ply is the moved surface after both stages, model_deformed.ply the model where the sweep has "
        "seen it, displacement.npz, .nrrd and .h5 the displacement of the model (ITK, 3D Slicer); "
        "registration.json lists what was carried along."
    ]


def _findings(found: Registered) -> tuple[str, ...]:
    result, residuals = found.result, found.residuals
    sentences = [
        f"{found.name} left {residuals.rmse_mm:.3f} mm RMSE ({residuals.rmse_trimmed_mm:.3f} mm trimmed) after "
        f"{result.runtime_s:.2f} s; a low residual alone does not prove the pose of a straight or symmetric vessel.",
        verdict_sentence(result),
        *doubts(found),
    ]
    low_mm, high_mm = found.predicted_tre_mm
    # What a model of residuals says of a pose that is wrong would only mislead.
    holds = result.verdict != FAILED
    if holds and (predicted := predicted_sentence(low_mm, high_mm, result.deformation)):
        sentences.append(predicted)
    if found.truth is not None:
        at = "" if found.truth.targets_mm is None else ", at its own target points, as the prediction"
        sentences.append(
            f"Measured TRE {length_mm(found.measured_tre_mm)} against the known pose of {found.truth.path.name}{at}."
        )
    if holds and math.isfinite(result.probability_right_vessel):
        sentences.append(
            "The probability that both surfaces show one vessel at this pose is "
            f"{percent(result.probability_right_vessel)}."
        )
    if holds:
        sentences += _of_offset(result.wall_offset_mm)
    sentences += _of_overlap(result)
    if result.weak_directions:
        sentences.append(f"The clouds leave open: {', '.join(result.weak_directions)}.")
    if not result.converged and result.verdict != FAILED:
        sentences.append("The method stopped at its limit of iterations before it converged.")
    errors_mm = found.landmark_errors_mm
    if errors_mm is not None:
        sentences.append(_of_landmarks(found, errors_mm))
    if found.refusal:
        sentences.append(f"No deformable registration followed: {found.refusal}.")
    if found.deformed is not None:
        sentences += deformed_sentences(found.deformed, residuals.rmse_mm)
        sentences += _of_landmarks_after(found, found.deformed)
    return tuple(sentences)


def _of_landmarks_after(found: Registered, deformed: Deformed) -> list[str]:
    errors_mm = landmark_errors_mm(deformed, found.pair, found.result.fixed_T_moving)
    if errors_mm is None:
        return []
    sentence = (
        f"After the deformable stage they lie {rms(errors_mm):.2f} mm apart, {errors_mm.max():.2f} mm at most"
    )
    if found.carried.landmark_deviation_mm is None:
        return [f"{sentence}."]
    return [
        f"{sentence}; they pulled there (landmark_deviation_mm), so that this is a residual and no error."
    ]


def _of_offset(offset_mm: float) -> list[str]:
    """What is to be said of walls that lie apart everywhere."""
    if not abs(offset_mm) >= NOTED_OFFSET_MM:
        return []
    return [
        f"The moving wall lies {abs(offset_mm):.2f} mm {'outside' if offset_mm > 0 else 'inside'} the fixed one "
        "everywhere: the borders were drawn differently, or the scale differs; the pose allows for it."
    ]


def _of_overlap(result: RigidResult) -> list[str]:
    """What is to be said where each surface may show a part of the vessel only."""
    if math.isfinite(result.overlap_share):
        return [
            f"It is a partial overlap: {100 * result.overlap_share:.0f} % of the moving points lie beside the fixed "
            "surface, and the predicted error is that of these; the RMSE is over all."
        ]
    if result.verdict in (AMBIGUOUS, FAILED) and result.probability_right_vessel < UNLIKELY:
        return [
            "Where both surfaces reach beyond each other, give initial=, or "
            "rigid.multistart.partial_overlap.overhang=0.6."
        ]
    return []


def _of_landmarks(found: Registered, errors_mm: np.ndarray) -> str:
    several = "1 landmark lies" if len(errors_mm) == 1 else f"{len(errors_mm)} landmarks lie"
    sentence = f"{several} {rms(errors_mm):.2f} mm apart (RMS), {errors_mm.max():.2f} mm at most"
    pairs = found.pair.landmarks
    best_mm = 0.0 if pairs is None else rms(pairs.errors_mm(pairs.fixed_T_moving))
    # Landmarks that fit each other well elsewhere, while the surfaces fit well here, contradict the surfaces.
    if rms(errors_mm) > LANDMARK_FACTOR * max(best_mm, found.residuals.rmse_mm):
        sentence += (
            f", {best_mm:.2f} mm in their own best pose: they contradict the surfaces, which may have been read in the "
            "wrong axes (moving_space, fixed_space) or lie in another pose that fits as well"
        )
    return sentence + "."
