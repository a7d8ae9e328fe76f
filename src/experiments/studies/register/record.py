"""A finished registration of two files, and its record in registration.json."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.deformed_model import Deformed, deformed_record
from experiments.analysis.registration.pose_scores import plain
from experiments.studies.register.carried import Carried, carried_record
from experiments.studies.register.pair import Pair
from experiments.studies.register.truth import KnownTruth
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceResiduals, rms
from registration.metrics.targets import MAX_TARGETS, target_points

if TYPE_CHECKING:
    from registration.rigid.residual_model.deformation import Deformation
    from registration.rigid.result import Candidate, RigidResult
    from registration.rigid.search_cone import SearchCone

LENGTHS = ("rmse_mm", "rmse_trimmed_mm", "rmse_bidirectional_mm", "msd_mm", "hd95_mm")
SHARES = ("inlier_share", "coverage")


@dataclass(frozen=True)
class Registered:
    """Pair with the result of its registration.

    Parameters
    ----------
    name : str
        Name of the method.
    pair : Pair
        Both sides.
    result : RigidResult
        Result of the method.
    residuals : SurfaceResiduals
        Residuals between both surfaces.
    truth : KnownTruth or None, optional
        The right pose, where it is known.
    deformed : Deformed or None, optional
        Result of the deformable stage; None without one.
    refusal : str, optional
        Why there is none where one was asked for; empty otherwise.
    carried : Carried, optional
        What the deformable stage carries along, and how it used the landmarks.
    """

    name: str
    pair: Pair
    result: RigidResult
    residuals: SurfaceResiduals
    truth: KnownTruth | None = None
    deformed: Deformed | None = None
    refusal: str = ""
    carried: Carried = field(default_factory=Carried)

    @property
    def landmark_errors_mm(self) -> np.ndarray | None:
        """The distance of each pair of landmarks after registration, or None where there are none."""
        pairs = self.pair.landmarks
        return None if pairs is None else pairs.errors_mm(self.result.fixed_T_moving)

    @property
    def predicted_tre_mm(self) -> tuple[float, float]:
        """The 90 % interval that the method predicts for the target registration error; NaN if it predicts none."""
        return self.result.tre_interval_mm(self._targets_mm)

    @property
    def measured_tre_mm(self) -> float:
        """The target registration error against the right pose; NaN where that is not known."""
        if self.truth is None:
            return math.nan
        return self.truth.tre_mm(self.result.fixed_T_moving, self._targets_mm)

    @property
    def _targets_mm(self) -> np.ndarray:
        """Targets of the truth, else points of the fixed centerline, else of the fixed surface."""
        if self.truth is not None and self.truth.targets_mm is not None:
            return self.truth.targets_mm
        targets_mm = self.pair.fixed.centerline_mm(MAX_TARGETS)
        return target_points(self.pair.fixed.surface) if targets_mm is None else targets_mm


def record(found: Registered) -> dict[str, Any]:
    """Make the content of registration.json.

    Parameters
    ----------
    found : Registered
        Registered pair.

    Returns
    -------
    dict
        Content, ready for JSON; a number that is not finite is None.
    """
    result, pair = found.result, found.pair
    return {
        "moving": str(pair.moving.path),
        "fixed": str(pair.fixed.path),
        "rigid": found.name,
        "units": {"length": "mm", "time": "s"},
        "space": "lps",
        "moving_space": pair.moving.space,
        "fixed_space": pair.fixed.space,
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        **{key: getattr(found.residuals, key) for key in (*LENGTHS, *SHARES)},
        "distances_to": "triangles" if isinstance(pair.fixed.surface, Mesh) else "points",
        "iterations": result.iterations,
        "converged": result.converged,
        "verdict": result.verdict,
        "reason": result.reason,
        # JSON has no infinity: no other pose was found at all, which is not the same as that nobody looked.
        "ambiguity_gap": "inf" if result.ambiguity_gap == math.inf else plain(result.ambiguity_gap),
        "weak_directions": list(result.weak_directions),
        "rival_fixed_T_moving": _plain(result.rival_fixed_T_moving),
        "overlap_share": plain(result.overlap_share),
        "wall_offset_mm": plain(result.wall_offset_mm),
        "predicted_tre_mm": _predicted_tre(found),
        "measured_tre_mm": plain(found.measured_tre_mm),
        "deformation": _deformation(result.deformation),
        "probability_right_vessel": plain(result.probability_right_vessel),
        "initial": _initial(pair, result.search_cone),
        "centerlines": {
            side: None if path is None else str(path)
            for side, path in (
                ("moving", pair.moving.centerline_path),
                ("fixed", pair.fixed.centerline_path),
            )
        },
        "landmarks": _landmarks(found),
        "deformable": _deformable(found),
        "candidates": [_candidate(candidate) for candidate in result.candidates],
        "runtime_s": result.runtime_s,
    }


def _deformable(found: Registered) -> dict[str, Any] | None:
    deformed = deformed_record(found.deformed, (*LENGTHS, *SHARES))
    if deformed is None or found.deformed is None:
        return None
    return deformed | carried_record(found.carried, found.deformed, found.pair, found.result.fixed_T_moving)


def _predicted_tre(found: Registered) -> dict[str, Any]:
    low_mm, high_mm = found.predicted_tre_mm
    deformation = found.result.deformation
    return {
        "low": plain(low_mm),
        "high": plain(high_mm),
        "level": 0.9,
        "includes_deformation": deformation is not None and deformation.is_predicted,
    }


def _deformation(found: Deformation | None) -> dict[str, Any] | None:
    """What the residuals say of tissue that has moved; None where nobody looked."""
    if found is None:
        return None
    return {
        "detected": bool(found.detected),
        "size_mm": plain(found.size_mm),
        "gain": plain(found.gain),
        "expected_mm": plain(found.expected_mm),
    }


def _initial(pair: Pair, cone: SearchCone | None) -> dict[str, Any] | None:
    if pair.initial is None:
        return None
    return {
        "source": pair.initial.source,
        "fixed_T_moving": pair.initial.fixed_T_moving.tolist(),
        "search_cone_deg": None if cone is None else cone.angle_deg,
        "search_radius_mm": None if cone is None else cone.radius_mm,
    }


def _landmarks(found: Registered) -> dict[str, Any] | None:
    pairs, errors_mm = found.pair.landmarks, found.landmark_errors_mm
    if pairs is None or errors_mm is None:
        return None
    return {
        "error_mm": rms(errors_mm),
        "error_max_mm": float(errors_mm.max()),
        "errors_mm": dict(zip(pairs.names, errors_mm.tolist(), strict=True)),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    """Every field of a candidate under its own name, arrays as lists and what is not known as null."""
    entries = {each.name: getattr(candidate, each.name) for each in fields(candidate)}
    return {key: _plain(value) for key, value in entries.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return plain(value) if isinstance(value, float) else value
