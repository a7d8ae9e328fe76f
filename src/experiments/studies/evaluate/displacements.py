"""Displacements that a deformable method gives beside its poses: which file belongs to which case, and its scores."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.analysis.registration.pose_scores import PoseResult
from experiments.errors import InputError
from experiments.inputs.surfaces import naming
from experiments.unicode_names import same_name
from registration.benchmark.cases import CaseTruth
from registration.benchmark.deformable_entries import STEM, DisplacementScore, score_displacement
from registration.io.sampled_displacement import SUFFIXES

# What study=register leaves next to its registration.json.
OWN, RESULT = "displacement", "registration.json"
NOT_SCORED = (
    "The displacement is not scored: the reference does not say where the tissue was swept, as the truth of a "
    "benchmark's case does."
)


def is_displacement(path: Path) -> bool:
    """Tell whether a file next to results is a displacement by its name.

    Parameters
    ----------
    path : Path
        File.

    Returns
    -------
    bool
        True for ``displacement.*`` and ``<case>_displacement.*``.
    """
    return _stem(path) == OWN or _stem(path).endswith(STEM)


def displacement_beside(result: Path) -> Path | None:
    """Find the displacement that belongs to a single result.

    Parameters
    ----------
    result : Path
        File of the result.

    Returns
    -------
    Path or None
        The first of ``<result>_displacement`` with a known suffix; next to a ``registration.json`` also of
        ``displacement``, where it is the fixed side that it displaces. None if there is none.
    """
    names = [f"{result.stem}{STEM}", *([OWN] if result.name == RESULT and _of_fixed_side(result) else [])]
    found = (result.with_name(name + suffix) for name in names for suffix in SUFFIXES)
    return next((path for path in found if path.is_file()), None)


def pair_displacements(folder: Path, poses: Mapping[str, Path]) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Find the displacement of each case that has a pose.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    poses : Mapping[str, Path]
        Files of the poses by case.

    Returns
    -------
    displacements : dict
        Files by case; empty for a rigid method.
    unused : tuple of str
        Names of displacements that belong to no case with a pose.

    Raises
    ------
    InputError
        If a file is of a kind that is not read, two have one name, or none belongs to a case with a pose.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if not path.is_file() or path.name.startswith(".") or not _stem(path).endswith(STEM):
            continue
        if path.suffix not in SUFFIXES:
            raise InputError(
                f"prediction: {path}: expected a displacement on a grid ({', '.join(SUFFIXES)}), received "
                f"{path.suffix}; of points on a surface none is known at the targets inside it"
            )
        name = same_name(path.stem.removesuffix(STEM))
        if name in found:
            raise InputError(
                f"prediction: expected one displacement of each name in {folder}, received {found[name].name} and "
                f"{path.name}"
            )
        found[name] = path
    used = {name: path for name, path in found.items() if name in poses}
    if found and not used:
        raise InputError(
            f"prediction: expected displacements named after cases with a pose ({next(iter(poses))}{STEM}"
            f"{SUFFIXES[0]}, ...) in {folder}, received {len(found)} of other names"
        )
    return used, tuple(path.stem for name, path in found.items() if name not in used)


def displacement_row(path: Path | None, result: PoseResult, truth: CaseTruth) -> dict[str, Any]:
    """Score the displacement of one case.

    A method enters with a displacement for every pose: a case without one would be scored as one that moves nothing.

    Parameters
    ----------
    path : Path or None
        File of the displacement; None where there is none, as for a case without a pose.
    result : PoseResult
        Result of the case.
    truth : CaseTruth
        Truth of the case.

    Returns
    -------
    dict
        Errors in mm by column name, infinite without a result, and ``jacobian_min``.

    Raises
    ------
    InputError
        If the file cannot be scored, or a case with a pose has none; the message names it.
    """
    pose = result.fixed_T_moving
    if pose is None:
        return asdict(DisplacementScore())
    if path is None:
        raise InputError(
            f"prediction: {truth.name}{STEM}{SUFFIXES[0]}: expected a displacement for every case that has a pose, "
            "received none; write one of zeros where nothing moves"
        )
    with naming("prediction"):
        return asdict(score_displacement(path, pose, truth))


def _of_fixed_side(result: Path) -> bool:
    """Whether the deformable stage of a registration displaced the fixed side, whose targets the truth has."""
    try:
        stage = json.loads(result.read_text(encoding="utf-8")).get("deformable")
        return bool(stage and stage.get("model_side") == "fixed")
    except (OSError, ValueError, AttributeError):
        return False  # reading the result refuses it in its own words


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").rpartition(".")[0]
