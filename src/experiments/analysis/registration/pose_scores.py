"""Results of registration, as anyone's files hold them, and the row of scores that each one gets."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.inputs.surfaces import naming, read_pose
from registration import transforms
from registration.benchmark.alternative_pose import SecondPose, second_pose
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.scoring import PoseScore, lowest_tre_mm, score_pose
from registration.input_files import refusing
from registration.rigid.result import ACCEPTED, FAILED, NOT_JUDGED, VERDICTS
from registration.text_files import read_text

if TYPE_CHECKING:
    import pandas as pd

NOT_DEFINED = float("nan")


@dataclass(frozen=True)
class PoseResult:
    """Result of a method on one case: a pose, and how the method judges it.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4), or None
        Rigid transform from the moving to the fixed coordinate frame, in mm; None if there is no result.
    verdict : str, optional
        The method's own judgement; ``not judged`` for a method without acceptance criteria.
    ambiguity_gap : float, optional
        Gap to the best other pose that the method states; NaN if it states none.
    tre_low_mm, tre_high_mm : float, optional
        Bounds in mm of the 90 % interval that the method predicts for its TRE; NaN if it predicts none.
    runtime_s : float, optional
        Run time in s; NaN if unknown.
    candidates : tuple of ndarray, shape (4, 4), optional
        Other poses that the method considered, as ``fixed_T_moving``.
    error : str, optional
        Why there is no result; empty if there is one.
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
        """Whether the method judges its results at all."""
        return self.verdict != NOT_JUDGED


def read_result(path: Path) -> PoseResult:
    """Read a result from JSON as ``study=register`` writes it, or a bare transform (JSON, .tfm, .h5).

    Parameters
    ----------
    path : Path
        File to read. Only ``fixed_T_moving`` is required in JSON; null stands for no result.

    Returns
    -------
    PoseResult
        The result; what the file does not hold has the defaults of the class.

    Raises
    ------
    InputError
        If the file is missing, is not such a file, or holds an unknown verdict; the message names the file.
    """
    found = _object(path) if path.suffix.lower() == ".json" else {}
    verdict = found.get("verdict", NOT_JUDGED)
    if verdict not in VERDICTS:
        raise InputError(
            f"prediction: {path}: expected a verdict of {', '.join(VERDICTS)}, received {verdict!r}"
        )
    found_pose = found.get("fixed_T_moving", path) is not None
    pose = read_pose(path, "prediction") if found_pose else None
    try:
        predicted = found.get("predicted_tre_mm") or {}
        return PoseResult(
            fixed_T_moving=pose,
            verdict=str(verdict) if found_pose else FAILED,
            ambiguity_gap=_number(found.get("ambiguity_gap")),
            tre_low_mm=_number(predicted.get("low")),
            tre_high_mm=_number(predicted.get("high")),
            runtime_s=_number(found.get("runtime_s")),
            candidates=tuple(_pose(one["fixed_T_moving"]) for one in found.get("candidates", ())),
            error="" if found_pose else str(found.get("error") or "the method gave no result"),
        )
    except (TypeError, ValueError, KeyError, AttributeError) as refusal:
        raise InputError(
            f"prediction: {path}: expected numbers as registration.json has them, received {refusal}"
        ) from refusal


def score_result(result: PoseResult, truth: CaseTruth, case: BenchmarkCase | None) -> dict[str, Any]:
    """Score one result: what its case is, its errors, and how the method judged it.

    A missing result has infinite errors. A result that was not accepted, or was wrong although its method
    judges its results, is compared with the best second pose there is (``second_pose_gap``, in standard
    errors, and its ``second_tre_mm``). ``ambiguous_rightly`` is 1 or 0 for those that were not accepted. Where the
    model is that of another vessel there is no true pose and nothing to compare: errors are NaN. Where tissue deforms
    no second pose is looked for.

    Parameters
    ----------
    result : PoseResult
        Result to score.
    truth : CaseTruth
        Truth of the case.
    case : BenchmarkCase or None
        The case itself; None if it is not at hand: then what needs its clouds, such as the second pose, is
        NaN.

    Returns
    -------
    dict
        Values by column name; errors in mm and deg, NaN where not defined.
    """
    pose = result.fixed_T_moving
    score = PoseScore() if pose is None else score_pose(pose, truth, case)
    tre_mm = score.tre_symmetric_mm
    low_mm, high_mm = result.tre_low_mm, result.tre_high_mm
    predicted = truth.same_vessel and math.isfinite(low_mm) and math.isfinite(high_mm)
    doubted = result.verdict not in (ACCEPTED, NOT_JUDGED)
    wrongly_sure = result.judged and not score.success_tre_symmetric
    # Where tissue deforms, neighbouring residuals go together: a gap in independent stretches would mean nothing.
    comparable = truth.same_vessel and truth.displacement_mm is None
    wanted = comparable and (doubted or wrongly_sure)
    second = _second(result, truth, case) if wanted else None
    return {
        "case": truth.name,
        "anatomy": truth.anatomy,
        "kind": truth.kind,
        "block": truth.block,
        "same_vessel": truth.same_vessel,
        "place": truth.place,
        "symmetric": bool(truth.symmetry),
        "angle_deg": truth.angle_deg,
        "translation_mm": truth.translation_mm,
        "covered_share": float(truth.covered.mean()),
        "lowest_tre_mm": lowest_tre_mm(truth),
        **asdict(score),
        "success": score.success,
        "success_tre": score.success_tre,
        "success_tre_symmetric": score.success_tre_symmetric,
        "verdict": result.verdict,
        "ambiguity_gap": result.ambiguity_gap,
        "tre_low_mm": low_mm,
        "tre_high_mm": high_mm,
        "covered_by_interval": float(low_mm <= tre_mm <= high_mm) if predicted else NOT_DEFINED,
        "high_over_error": high_mm / tre_mm if predicted and tre_mm > 0 else NOT_DEFINED,
        "second_pose_gap": NOT_DEFINED if second is None else second.gap,
        "second_tre_mm": NOT_DEFINED if second is None else second.tre_mm,
        "ambiguous_rightly": float(second.hidden) if second is not None and doubted else NOT_DEFINED,
        "runtime_s": result.runtime_s,
        "error": result.error,
        "simulated": truth.simulated,
    }


def plain(value: float) -> float | None:
    """Convert a number for JSON, which has no NaN and no infinity.

    Parameters
    ----------
    value : float
        Any number.

    Returns
    -------
    float or None
        The number; None if it is NaN or infinite.
    """
    return float(value) if math.isfinite(value) else None


def plain_metrics(metrics: Mapping[str, float]) -> dict[str, float | None]:
    """Convert metrics for JSON, which has no NaN and no infinity.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Scalars by name.

    Returns
    -------
    dict
        The same with None for NaN and infinity.
    """
    return {name: plain(value) for name, value in metrics.items()}


def _second(result: PoseResult, truth: CaseTruth, case: BenchmarkCase | None) -> SecondPose | None:
    return None if case is None else second_pose(case, truth, result.candidates)


def _object(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"prediction: {path}: expected a file with a fixed_T_moving, received none")
    with naming("prediction"), refusing(path, "JSON"):
        found = json.loads(read_text(path))
    if not isinstance(found, dict):
        raise InputError(f"prediction: {path}: expected a JSON object, received a {type(found).__name__}")
    return found


def _number(value: Any) -> float:
    return NOT_DEFINED if value is None else float(value)


def _pose(value: Any) -> np.ndarray:
    return transforms.require_rigid(np.array(value, dtype=np.float64).reshape(4, 4), "candidates")


def judges(cases: pd.DataFrame) -> bool:
    """Tell whether the method judges its own results; one that gave no result at all does not.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials of one method.

    Returns
    -------
    bool
        True for a method that judges.
    """
    own = cases.loc[cases["error"] == "", "verdict"]
    return bool((own != NOT_JUDGED).any())
