"""Answers to registration problems, as anyone's files hold them, and the row of scores that each one gets."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import InputError
from experiments.inputs.surfaces import read_pose
from registration import transforms
from registration.benchmark.alternative_pose import SecondPose, second_pose
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.scoring import PoseScore, score_pose
from registration.rigid.result import ACCEPTED, FAILED, NOT_JUDGED, VERDICTS

NOT_DEFINED = float("nan")


@dataclass(frozen=True)
class Answer:
    """What a method says of one case: a pose, and what it thinks of it.

    ``fixed_T_moving`` is None where there is no answer; ``error`` then says why. The verdict of a method that does not
    judge itself is ``not judged``. ``tre_low_mm`` and ``tre_high_mm`` are the 90 % interval that it predicts for its
    error; NaN, as are ``ambiguity_gap`` and ``runtime_s``, where it says nothing. ``candidates`` are the other poses
    that it looked at.
    """

    fixed_T_moving: np.ndarray | None
    verdict: str = NOT_JUDGED
    ambiguity_gap: float = NOT_DEFINED
    tre_low_mm: float = NOT_DEFINED
    tre_high_mm: float = NOT_DEFINED
    runtime_s: float = NOT_DEFINED
    candidates: tuple[np.ndarray, ...] = ()
    error: str = ""

    @property
    def judged(self) -> bool:
        """Whether the method judges its answers at all."""
        return self.verdict != NOT_JUDGED


def read_answer(path: Path) -> Answer:
    """Read an answer from JSON as ``study=register`` writes it, or a bare transform (JSON, .tfm, .h5).

    Only ``fixed_T_moving`` must be there; null stands for no answer. Raises InputError that names the file.
    """
    told = _object(path) if path.suffix.lower() == ".json" else {}
    verdict = told.get("verdict", NOT_JUDGED)
    if verdict not in VERDICTS:
        raise InputError(
            f"prediction: {path}: expected a verdict of {', '.join(VERDICTS)}, received {verdict!r}"
        )
    answered = told.get("fixed_T_moving", path) is not None
    pose = read_pose(path, "prediction") if answered else None
    try:
        predicted = told.get("predicted_tre_mm") or {}
        return Answer(
            fixed_T_moving=pose,
            verdict=str(verdict) if answered else FAILED,
            ambiguity_gap=_number(told.get("ambiguity_gap")),
            tre_low_mm=_number(predicted.get("low")),
            tre_high_mm=_number(predicted.get("high")),
            runtime_s=_number(told.get("runtime_s")),
            candidates=tuple(_pose(one["fixed_T_moving"]) for one in told.get("candidates", ())),
            error="" if answered else str(told.get("error") or "the method gave no answer"),
        )
    except (TypeError, ValueError, KeyError, AttributeError) as refusal:
        raise InputError(
            f"prediction: {path}: expected numbers as registration.json has them, received {refusal}"
        ) from refusal


def answer_row(answer: Answer, truth: CaseTruth, case: BenchmarkCase | None) -> dict[str, Any]:
    """The row of one case: what it is, its errors, and what the method thought of its answer.

    No answer has infinite errors. An answer that was not accepted, or was wrongly by a method that judges itself, is
    compared with the best second pose there is (``second_pose_gap``, in standard errors, and its ``second_tre_mm``),
    where the case is at hand. ``ambiguous_rightly`` is 1 or 0 for those that were not accepted.
    """
    pose = answer.fixed_T_moving
    score = PoseScore() if pose is None else score_pose(pose, truth, case)
    tre_mm = score.tre_symmetric_mm
    predicted = math.isfinite(answer.tre_low_mm) and math.isfinite(answer.tre_high_mm)
    doubted = answer.verdict not in (ACCEPTED, NOT_JUDGED)
    wrongly_sure = answer.judged and not score.success_tre_symmetric
    second = _second(answer, truth, case) if doubted or wrongly_sure else None
    return {
        "case": truth.name,
        "anatomy": truth.anatomy,
        "kind": truth.kind,
        "place": truth.place,
        "symmetric": bool(truth.symmetry),
        "angle_deg": truth.angle_deg,
        "translation_mm": truth.translation_mm,
        "covered_share": float(truth.covered.mean()),
        **asdict(score),
        "success": score.success,
        "success_tre": score.success_tre,
        "success_tre_symmetric": score.success_tre_symmetric,
        "verdict": answer.verdict,
        "ambiguity_gap": answer.ambiguity_gap,
        "tre_low_mm": answer.tre_low_mm,
        "tre_high_mm": answer.tre_high_mm,
        "covered_by_interval": (
            float(answer.tre_low_mm <= tre_mm <= answer.tre_high_mm) if predicted else NOT_DEFINED
        ),
        "second_pose_gap": NOT_DEFINED if second is None else second.gap,
        "second_tre_mm": NOT_DEFINED if second is None else second.tre_mm,
        "ambiguous_rightly": float(second.hidden) if second is not None and doubted else NOT_DEFINED,
        "runtime_s": answer.runtime_s,
        "error": answer.error,
        "simulated": truth.simulated,
    }


def plain(value: float) -> float | None:
    """A number for JSON, which has no NaN and no infinity: null stands for both."""
    return float(value) if math.isfinite(value) else None


def plain_metrics(metrics: Mapping[str, float]) -> dict[str, float | None]:
    """Metrics for JSON."""
    return {name: plain(value) for name, value in metrics.items()}


def _second(answer: Answer, truth: CaseTruth, case: BenchmarkCase | None) -> SecondPose | None:
    return None if case is None else second_pose(case, truth, answer.candidates)


def _object(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"prediction: {path}: expected a file with a fixed_T_moving, received none")
    try:
        told = json.loads(path.read_text(encoding="utf-8-sig"))
    except ValueError as refusal:
        raise InputError(f"prediction: {path}: expected JSON, received {refusal}") from refusal
    if not isinstance(told, dict):
        raise InputError(f"prediction: {path}: expected a JSON object, received a {type(told).__name__}")
    return told


def _number(value: Any) -> float:
    return NOT_DEFINED if value is None else float(value)


def _pose(value: Any) -> np.ndarray:
    return transforms.require_rigid(np.array(value, dtype=np.float64).reshape(4, 4), "candidates")
