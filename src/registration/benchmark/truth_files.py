"""The truth of a benchmark case as JSON, and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from registration.benchmark.cases import UNDEFORMED, CaseTruth
from registration.benchmark.symmetry import Screw, Symmetry
from registration.errors import InputError
from registration.input_files import guarded
from registration.text_files import read_text
from registration.transforms import require_rigid

# Clouds of the benchmark have some thousand points.
MOST_POINTS = 10_000_000


@guarded("the truth of a case")
def read_truth(path: Path) -> CaseTruth:
    """Read the truth of one case.

    Parameters
    ----------
    path : Path
        JSON file of the truth.

    Returns
    -------
    CaseTruth
        The truth.

    Raises
    ------
    InputError
        If the file is missing or malformed; the message names the file and what it lacks.
    """
    told = read_json(path)
    try:
        symmetry, targets, covered = told["symmetry"], len(told["targets_mm"]), len(told["covered"])
        if covered != targets or not targets:
            raise ValueError(f"{targets} targets with {covered} marks of what was swept")
        same_vessel, displacement = bool(told.get("same_vessel", True)), told.get("displacement_mm")
        outlier = np.zeros(_count(told["moving_points"]), dtype=bool)
        outlier[np.array(told["outliers"], dtype=np.int64)] = True
        truth = CaseTruth(
            name=str(told["case"]),
            anatomy=str(told["anatomy"]),
            kind=str(told["kind"]),
            place=str(told["place"]),
            fixed_T_moving=_pose(told["fixed_T_moving"], same_vessel),
            targets_mm=_array(told["targets_mm"]).reshape(-1, 3),
            covered=np.array(told["covered"], dtype=bool),
            outlier=outlier,
            angle_deg=float(told["angle_deg"]),
            translation_mm=float(told["translation_mm"]),
            symmetry=Symmetry(
                tuple(_screw(screw) for screw in symmetry["screws"]),
                tuple(_array(flip).reshape(4, 4) for flip in symmetry["flips"]),
            ),
            block=str(told.get("block", UNDEFORMED)),
            displacement_mm=None if displacement is None else _array(displacement).reshape(targets, 3),
            same_vessel=same_vessel,
        )
    except KeyError as lacking:
        raise InputError(
            f"{path}: expected the truth of a benchmark case, received none of {lacking}"
        ) from lacking
    except (ValueError, TypeError, IndexError) as refusal:
        raise InputError(f"{path}: expected the truth of a benchmark case, received {refusal}") from refusal
    return truth


def truth_as_json(truth: CaseTruth) -> dict[str, Any]:
    """Convert a truth to the content of its file.

    Parameters
    ----------
    truth : CaseTruth
        Truth of a case.

    Returns
    -------
    dict
        JSON object.
    """
    return {
        "case": truth.name,
        "anatomy": truth.anatomy,
        "block": truth.block,
        "kind": truth.kind,
        "place": truth.place,
        "units": {"length": "mm", "angle": "deg"},
        "angle_deg": truth.angle_deg,
        "translation_mm": truth.translation_mm,
        "same_vessel": truth.same_vessel,
        "fixed_T_moving": truth.fixed_T_moving.tolist() if truth.same_vessel else None,
        "displacement_mm": None if truth.displacement_mm is None else truth.displacement_mm.tolist(),
        "targets_mm": truth.targets_mm.tolist(),
        "covered": truth.covered.tolist(),
        "moving_points": len(truth.outlier),
        "outliers": np.flatnonzero(truth.outlier).tolist(),
        "symmetry": {
            "screws": [
                {
                    **vars(screw),
                    "point_mm": screw.point_mm.tolist(),
                    "direction": screw.direction.tolist(),
                }
                for screw in truth.symmetry.screws
            ],
            "flips": [flip.tolist() for flip in truth.symmetry.flips],
        },
    }


def _screw(told: dict[str, Any]) -> Screw:
    return Screw(
        _array(told["point_mm"]),
        _array(told["direction"]),
        *(float(told[key]) for key in ("turn_deg", "shift_mm", "low", "high")),
    )


def _pose(told: Any, same_vessel: bool) -> np.ndarray:
    """A pose; of another vessel there is none."""
    if same_vessel:
        return require_rigid(_array(told).reshape(4, 4), "fixed_T_moving")
    if told is not None:
        raise ValueError("a fixed_T_moving of another vessel")
    return np.full((4, 4), np.nan)


def _array(values: Any) -> np.ndarray:
    found: np.ndarray = np.array(values, dtype=np.float64)
    if not np.isfinite(found).all():
        raise ValueError("a number that is not finite")
    return found


def _count(value: Any) -> int:
    if not 0 <= int(value) <= MOST_POINTS:
        raise ValueError(f"{value} points where there are at most {MOST_POINTS}")
    return int(value)


@guarded("JSON")
def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    dict
        The object.

    Raises
    ------
    InputError
        If the file is missing or holds no JSON object; the message names it.
    """
    try:
        found = json.loads(read_text(path))
    except ValueError as refusal:
        raise InputError(f"{path}: expected JSON, received {refusal}") from refusal
    if not isinstance(found, dict):
        raise InputError(f"{path}: expected a JSON object, received a {type(found).__name__}")
    return found
