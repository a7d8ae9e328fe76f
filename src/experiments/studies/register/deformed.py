"""The deformable stage of a registration of a user's own files: which side is displaced, and onto what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.registration.deformed_model import SIDES, Deformed, displace
from experiments.errors import InputError
from experiments.studies.register.pair import Pair
from registration import transforms
from registration.checks import require_positive
from registration.deformable.landmark_constraints import LandmarkConstraints
from registration.geometry.shapes import diagonal_mm, points_of, sampled, transformed
from registration.rigid.result import FAILED

if TYPE_CHECKING:
    from registration.cpd import CoherentPointDrift
    from registration.rigid.result import RigidResult


def require_side(model_side: str | None) -> None:
    """Check the setting ``model_side``.

    Parameters
    ----------
    model_side : str or None
        Side of the model; None chooses.

    Raises
    ------
    InputError
        If it is no side.
    """
    if model_side is not None and model_side not in SIDES:
        raise InputError(f"model_side: expected fixed, moving or null, received {model_side!r}")


def deform(
    name: str,
    method: CoherentPointDrift,
    pair: Pair,
    rigid: RigidResult,
    side: str,
    landmark_deviation_mm: float | None = None,
    *,
    points: Mapping[str, int],
    inlier_mm: float,
    keep: float,
    seed: int,
) -> tuple[Deformed | None, str]:
    """Displace the model's side onto the other after the rigid pose.

    What the deformable stage refuses is no reason to lose the rigid result.

    Parameters
    ----------
    name : str
        Name of the method.
    method : CoherentPointDrift
        The method.
    pair : Pair
        Both sides.
    rigid : RigidResult
        Result of the rigid stage.
    side : str
        Side of the model.
    landmark_deviation_mm : float or None, optional
        Standard deviation in mm of the landmarks as constraints; None where they only measure the error.
    points : Mapping[str, int]
        Number of points sampled from a mesh, by side.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.

    Returns
    -------
    found : Deformed or None
        The result; None after a rigid stage that failed, or where the clouds are refused.
    refusal : str
        Why there is none; empty otherwise.
    """
    if rigid.verdict == FAILED:
        return None, "the rigid registration failed"
    pose = rigid.fixed_T_moving
    surfaces = {"fixed": pair.fixed.surface, "moving": transformed(pair.moving.surface, pose)}
    draws = dict(zip(SIDES, np.random.default_rng([seed, 2]).spawn(2), strict=True))
    clouds = {each: sampled(surfaces[each], points[each], draws[each]) for each in SIDES}
    frame = pair.moving.frame if side == "fixed" else None
    landmarks = None
    if landmark_deviation_mm is not None and pair.landmarks is not None:
        both_mm = {
            "fixed": pair.landmarks.fixed_mm,
            "moving": transforms.apply(pose, pair.landmarks.moving_mm),
        }
        other = SIDES[1 - SIDES.index(side)]
        landmarks = LandmarkConstraints(both_mm[side], both_mm[other], landmark_deviation_mm)
    return displace(
        name, method, side, surfaces, clouds, frame, landmarks, inlier_mm=inlier_mm, keep=keep, seed=seed
    )


def model_side_of(model_side: str | None, pair: Pair) -> str:
    """Choose the side of the model.

    Parameters
    ----------
    model_side : str or None
        Side that was asked for; None takes the side that is no sweep, else the longer one.
    pair : Pair
        Both sides.

    Returns
    -------
    str
        fixed or moving.
    """
    if model_side is not None:
        return model_side
    if pair.moving.frame is not None:
        return "fixed"
    sizes_mm = [diagonal_mm(points_of(side.surface)) for side in (pair.fixed, pair.moving)]
    return SIDES[int(sizes_mm[1] > sizes_mm[0])]


def require_constraints(landmark_deviation_mm: float | None, pair: Pair) -> None:
    """Check the setting ``landmark_deviation_mm``.

    Parameters
    ----------
    landmark_deviation_mm : float or None
        Standard deviation in mm of the landmarks as constraints; None where they only measure the error.
    pair : Pair
        Both sides.

    Raises
    ------
    InputError
        If it is not above 0, or there are no landmarks.
    """
    if landmark_deviation_mm is None:
        return
    require_positive("landmark_deviation_mm", landmark_deviation_mm)
    if pair.landmarks is None:
        raise InputError(
            "landmark_deviation_mm: expected moving_landmarks and fixed_landmarks as constraints, received none"
        )
