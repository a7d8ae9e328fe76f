"""The design of the robustness study: rotations crossed with pieces, the other factors one at a time.

A job is one method on one piece of one target, with all rotations; or one method with all levels of one factor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from experiments.errors import InputError, require_count
from registration import errors as registration_errors
from registration.perturbation.perturbation import Perturbation, Piece

# What a row's factor says where rotation and overlap are crossed, and which fields of a perturbation a factor sets.
CROSSED = "rotation"
FACTORS: Mapping[str, tuple[str, ...]] = {
    "translation_mm": ("translation_min_mm", "translation_max_mm"),
    "noise_mm": ("noise_mm",),
    "outlier_share": ("outlier_share",),
    "missing_share": ("missing_share",),
}
# Column of the settings of the trials in which the jobs of a sweep differ; none where they do not.
CONDITION = "condition"
# What a row's place says of a whole vessel.
WHOLE = "whole"


@dataclass(frozen=True)
class Condition:
    """Trials that are disturbed alike.

    Parameters
    ----------
    factor : str
        Name of the factor.
    level : float
        Level of the factor; NaN where rotation and overlap are crossed.
    perturbation : Perturbation
        How the trials are disturbed.
    trials : int
        Number of trials.
    """

    factor: str
    level: float
    perturbation: Perturbation
    trials: int


def job_changes(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List what each job changes in the configuration: target, method, piece and factor.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        Changes of each job.

    Raises
    ------
    InputError
        If ``rigid`` names no method or ``factors`` is no mapping.
    """
    methods, factors = config.get("rigid"), config.get("factors") or {}
    if not isinstance(methods, Mapping) or not methods:
        raise InputError(f"rigid: expected at least one method, received {methods!r}")
    if not isinstance(factors, Mapping):
        raise InputError(f"factors: expected levels by the name of a factor, received {factors!r}")
    pieces = list(_pieces(_listed("overlaps", config), _listed("places", config)))
    parts: list[dict[str, Any]] = [
        {"overlaps": [overlap], "places": [place]} | ({"factors": {}} if factors else {})
        for overlap, place in pieces
    ]
    overlap, place = pieces[0]
    parts += [
        {"overlaps": [overlap], "places": [place], "factors": {factor: levels}}
        for factor, levels in factors.items()
    ]
    return [
        {**anatomy, "rigid": {name: settings}, **part}
        for anatomy in _anatomies(config.get("target"), config.get("target_centerline"))
        for part in parts
        for name, settings in methods.items()
    ]


def conditions(
    perturbation: Perturbation,
    rotations: Sequence[str] | None,
    factors: Mapping[str, Sequence[float]] | None,
    trials: int,
) -> tuple[Condition, ...]:
    """List the conditions of one job: every kind of rotation, or every level of its factor.

    A factor's levels meet angles from the whole range.

    Parameters
    ----------
    perturbation : Perturbation
        How trials are disturbed apart from rotation and factor.
    rotations : sequence of str or None
        Kinds of rotation; None for the perturbation's own.
    factors : Mapping[str, Sequence[float]] or None
        Levels by the name of a factor; None or empty for the rotations.
    trials : int
        Number of trials of each level and, where the perturbation has bins of angles, of each bin.

    Returns
    -------
    tuple of Condition
        The conditions.

    Raises
    ------
    InputError
        If a factor, rotation or level is invalid.
    """
    require_count("trials", trials)
    if factors:
        plain = dataclasses.replace(perturbation, angle_bin_deg=None)
        found = []
        for factor, levels in factors.items():
            for level in _listed(f"factors.{factor}", {f"factors.{factor}": levels}):
                at_level = _at_level(plain, factor, level)
                found.append(Condition(factor, float(level), at_level, trials))
        return tuple(found)
    kinds = [perturbation.rotation] if rotations is None else _listed("rotations", {"rotations": rotations})
    turned = [_replaced("rotations", perturbation, {"rotation": kind}) for kind in kinds]
    return tuple(Condition(CROSSED, float("nan"), each, trials * each.poses.bins) for each in turned)


def one_piece(overlaps: Sequence[float], places: Sequence[str]) -> Piece:
    """Make the only piece of a job.

    Parameters
    ----------
    overlaps : sequence of float
        One share of the vessel's extent that the moving cloud covers.
    places : sequence of str
        One place of the piece along the vessel.

    Returns
    -------
    Piece
        The piece.

    Raises
    ------
    InputError
        If there is not one value of each, or they make no piece.
    """
    for name, values in (("overlaps", overlaps), ("places", places)):
        if len(_listed(name, {name: values})) != 1:
            raise InputError(f"{name}: expected one value a job, received {len(values)}")
    try:
        return Piece(overlaps[0], places[0])
    except registration_errors.InputError as refusal:
        raise InputError(f"overlaps and places: {refusal}") from refusal


def _pieces(overlaps: Sequence[float], places: Sequence[str]) -> Iterator[tuple[float, str]]:
    for overlap in overlaps:
        # The whole vessel has no place.
        yield from ((overlap, place) for place in (places[:1] if overlap == 1 else places))


def _anatomies(target: Any, centerline: Any) -> list[dict[str, Any]]:
    """One change a target, its centerline with it; none where there is but one."""
    if target is None or isinstance(target, str):
        return [{}]
    targets = _listed("target", {"target": target})
    lines = [None] * len(targets) if centerline is None else centerline
    if isinstance(lines, str) or len(lines) != len(targets):
        raise InputError(
            f"target_centerline: expected one for each of {len(targets)} targets or none, received {centerline!r}"
        )
    return [{"target": each, "target_centerline": line} for each, line in zip(targets, lines, strict=True)]


def _listed(name: str, config: Mapping[str, Any]) -> Sequence[Any]:
    values = config.get(name)
    if not isinstance(values, Sequence) or isinstance(values, str) or not values:
        raise InputError(f"{name}: expected a list with something in it, received {values!r}")
    return values


def _at_level(perturbation: Perturbation, factor: str, level: Any) -> Perturbation:
    if factor not in FACTORS:
        raise InputError(f"factors: expected some of {', '.join(FACTORS)}, received {factor!r}")
    if isinstance(level, bool) or not isinstance(level, (int, float)):
        raise InputError(f"factors.{factor}: expected numbers, received {level!r}")
    return _replaced(f"factors.{factor}", perturbation, dict.fromkeys(FACTORS[factor], level))


def _replaced(name: str, perturbation: Perturbation, change: Mapping[str, Any]) -> Perturbation:
    try:
        return dataclasses.replace(perturbation, **change)
    except registration_errors.InputError as refusal:
        raise InputError(f"{name}: {refusal}") from refusal
