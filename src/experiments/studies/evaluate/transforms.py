"""A method's transforms compared with the truth: which files belong together, and a row of scores for each case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from experiments.analysis.registration.pose_scores import PoseResult, read_result, score_result
from experiments.analysis.registration.simulated_truth import read_targets
from experiments.datasets.images.image_files import IMAGE_SUFFIXES
from experiments.errors import InputError
from experiments.inputs.surfaces import naming, read_pose
from experiments.outcome import Progress
from experiments.studies.evaluate.displacements import (
    NOT_SCORED,
    displacement_beside,
    displacement_row,
    is_displacement,
    pair_displacements,
)
from experiments.unicode_names import same_name
from registration import transforms
from registration.benchmark.case_files import CASE_FILE, TRUTH, read_case
from registration.benchmark.cases import CaseTruth
from registration.benchmark.truth_files import read_json, read_truth
from registration.io.centerlines import read_centerline_table
from registration.io.surfaces import read_centerline
from registration.io.transforms import ITK_SUFFIXES
from registration.metrics.surface_distance import pose_error
from registration.metrics.targets import MAX_TARGETS
from registration.rigid.result import FAILED

SUFFIXES = (".json", *ITK_SUFFIXES)
TRUTH_FILE, ANSWER_FILE = "truth.json", "registration.json"
MISSING = "no file for this case"
# JSON files that lie next to results and hold none.
# Targets as far from the vessel as this, and as many times nearer to it in the other frame, lie in the other.
APART_MM, ELSEWHERE = 10.0, 0.2
OTHER_FILES = ("evaluation", "metrics", "job", "identity", "case")


@dataclass(frozen=True)
class TransformPairs:
    """Cases of a reference with the results of the same names.

    Parameters
    ----------
    references : dict
        Files of the truth by case.
    predictions : dict
        Files of the result by case; a case without a result is not in it.
    unused : tuple of str
        Names of result files that belong to no case.
    cases : Path or None
        Folder of the cases themselves; None where only their truth is available.
    targets_mm : ndarray, shape (t, 3), or None
        Targets in the fixed frame in mm for references that have none of their own.
    displacements : Mapping[str, Path], optional
        Files of a deformable method's displacement by case; empty for a rigid method.
    """

    references: dict[str, Path]
    predictions: dict[str, Path]
    unused: tuple[str, ...]
    cases: Path | None
    targets_mm: np.ndarray | None
    displacements: Mapping[str, Path] = field(default_factory=dict)


def are_transforms(reference: Path) -> bool:
    """Tell whether a reference holds transforms and not masks.

    Parameters
    ----------
    reference : Path
        A truth, a folder of them, a subset of the benchmark, or masks.

    Returns
    -------
    bool
        True for transforms.
    """
    if reference.is_file():
        return reference.suffix.lower() in SUFFIXES
    if (reference / TRUTH).is_dir() or (reference / TRUTH_FILE).is_file():
        return True
    images = any(path.suffix.lower() in IMAGE_SUFFIXES for path in reference.iterdir())
    return not images and bool(_transform_files(reference))


def pair_transforms(prediction: Path, reference: Path, targets: str | None) -> TransformPairs:
    """Find the result that belongs to each reference, by name.

    One file is paired with one file whatever their names.

    Parameters
    ----------
    prediction : Path
        File or folder of the results.
    reference : Path
        File or folder of the true transforms.
    targets : str or None
        File of the targets; None for the references' own.

    Returns
    -------
    TransformPairs
        The pairs.

    Raises
    ------
    InputError
        If a file is set against a folder, there are no references or no results of their names, or two
        results have one name.
    """
    targets_mm = None if targets is None else _targets(Path(targets))
    reference, prediction = _one_file(reference, TRUTH_FILE), _one_file(prediction, ANSWER_FILE)
    if reference.is_file() != prediction.is_file():
        kinds = {True: "a file", False: "a folder"}
        raise InputError(
            f"prediction: expected {kinds[reference.is_file()]}, as reference is, received "
            f"{kinds[prediction.is_file()]} {prediction}"
        )
    if reference.is_file():
        name, beside = reference.stem, displacement_beside(prediction)
        displacements = {} if beside is None else {name: beside}
        return TransformPairs({name: reference}, {name: prediction}, (), None, targets_mm, displacements)
    truths = reference / TRUTH if (reference / TRUTH).is_dir() else reference
    references = _named(truths, "reference")
    cases = truths.parent if truths.name == TRUTH else None
    if cases is not None and not any(
        (cases / path.stem / CASE_FILE).is_file() for path in references.values()
    ):
        cases = None
    found = _named(prediction, "prediction")
    predictions = {name: path for name, path in found.items() if name in references}
    if not predictions:
        raise InputError(
            f"prediction: expected files named after the cases ({next(iter(references))}.json, ...) in {prediction}, "
            f"received {len(found)} of other names"
        )
    displacements, useless = pair_displacements(prediction, predictions)
    unused = (*(name for name in found if name not in references), *useless)
    return TransformPairs(references, predictions, unused, cases, targets_mm, displacements)


def read_reference(path: Path, targets_mm: np.ndarray | None) -> CaseTruth:
    """Read the truth of a benchmark's case, or a pose with the targets given apart.

    Parameters
    ----------
    path : Path
        File of the truth.
    targets_mm : ndarray, shape (t, 3), or None
        Targets in the fixed frame in mm; None for the file's own.

    Returns
    -------
    CaseTruth
        Truth of the case.

    Raises
    ------
    InputError
        If there are no targets.
    """
    own = read_targets(path)
    if targets_mm is None and own is None:
        if path.suffix.lower() != ".json" or not _is_benchmark(path):
            raise InputError(
                f"targets: expected a centerline (.csv, .vtp) to measure {path} at, in mm in the frame of its fixed "
                "side, received none"
            )
        with naming("reference"):
            return read_truth(path)
    if targets_mm is None:
        assert own is not None
        targets_mm = own[0]
    pose = read_pose(path, "reference")
    if own is not None:
        _refuse_other_frame(targets_mm, own[0], pose, own[1])
    return CaseTruth(
        name=path.stem,
        anatomy=path.stem,
        kind="",
        place="",
        fixed_T_moving=pose,
        targets_mm=targets_mm,
        covered=np.ones(len(targets_mm), dtype=bool),
        outlier=np.zeros(0, dtype=bool),
        angle_deg=float("nan"),
        translation_mm=float("nan"),
        simulated=own is not None,
        block="",
    )


def _is_benchmark(path: Path) -> bool:
    """Whether a file is, or was meant as, the truth of a benchmark's case: those name their case."""
    with naming("reference"):
        return "case" in read_json(path)


def _refuse_other_frame(given_mm: np.ndarray, own_mm: np.ndarray, pose: np.ndarray, frame: str) -> None:
    """Raise InputError for targets given apart that lie on the vessel only after the true pose: in the moving frame."""
    there = cKDTree(own_mm)  # points of a straight line too, which are no surface
    as_given, as_moving = (
        float(np.median(there.query(each)[0])) for each in (given_mm, transforms.apply(pose, given_mm))
    )
    if as_moving < ELSEWHERE * as_given and as_given > APART_MM:
        raise InputError(
            f"targets: expected points in the frame of the fixed side ({frame}), received points of the moving frame "
            f"({as_given:.0f} mm away from the vessel, {as_moving:.1f} mm once the true pose has moved them)"
        )


def transform_rows(pairs: TransformPairs, progress: Progress) -> Iterator[dict[str, Any]]:
    """Score each case, in order of name; a case without a file has failed.

    Parameters
    ----------
    pairs : TransformPairs
        Transforms to score.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    iterator of dict
        One row per case.
    """
    total = len(pairs.references)
    for name, path in progress.track(pairs.references.items(), "scoring transforms", total):
        truth = read_reference(path, pairs.targets_mm)
        case = None
        if pairs.cases is not None and pairs.targets_mm is None:
            with naming("reference"):
                case = read_case(pairs.cases / path.stem)
        given = pairs.predictions.get(name)
        result = PoseResult(None, FAILED, error=MISSING) if given is None else read_result(given)
        row = score_result(result, truth, case)
        if pairs.displacements and truth.block:
            row |= displacement_row(pairs.displacements.get(name), result, truth)
        yield row


def target_notes(pairs: TransformPairs, targets: str | None) -> list[str]:
    """State where the errors are measured, and whether a single transform looks like an inverse.

    Parameters
    ----------
    pairs : TransformPairs
        Transforms to score.
    targets : str or None
        File of the targets; None for the references' own.

    Returns
    -------
    list of str
        Sentences.
    """
    name, path = next(iter(pairs.references.items()))
    truth = read_reference(path, pairs.targets_mm)
    if targets is not None:
        where = f"at {len(truth.targets_mm)} points of {Path(targets).name}, taken to lie"
    else:
        where = (
            f"at {len(truth.targets_mm)} targets"
            if len(pairs.references) == 1
            else "at each case's targets, which lie"
        )
    own = read_targets(path)
    frame = f"{own[1]}: " if own is not None else ""
    notes = [f"Errors are measured {where} in the frame of the fixed side ({frame}mm in LPS)."]
    if pairs.displacements and not truth.block:
        notes.append(NOT_SCORED)
    given = pairs.predictions.get(name)
    pose = None if given is None or len(pairs.references) > 1 else read_result(given).fixed_T_moving
    if pose is not None and truth.same_vessel:
        error_mm, inverse_mm = (
            pose_error(each, truth.fixed_T_moving, truth.targets_mm).tre_mm
            for each in (pose, transforms.invert_rigid(pose))
        )
        if error_mm > APART_MM and inverse_mm < ELSEWHERE * error_mm:
            notes.append(
                f"The inverse of the transform is {inverse_mm:.1f} mm off, itself {error_mm:.1f} mm: were moving and "
                "fixed swapped?"
            )
    return notes


def _one_file(path: Path, name: str) -> Path:
    """The one file that matters in a folder which a study left: the result or the truth of a single registration."""
    return path / name if (path / name).is_file() else path


def _targets(path: Path) -> np.ndarray:
    with naming("targets"):
        if path.suffix.lower() == ".csv":
            return read_centerline_table(path).even_points(MAX_TARGETS)
        return read_centerline(path).even_points(MAX_TARGETS)


def _named(folder: Path, setting: str) -> dict[str, Path]:
    """The transforms of a folder by their names without suffix."""
    named: dict[str, Path] = {}
    for path in _transform_files(folder):
        name = same_name(path.stem)
        if name in named:
            raise InputError(
                f"{setting}: expected one transform of each name in {folder}, received {named[name].name} and "
                f"{path.name}"
            )
        named[name] = path
    if not named:
        raise InputError(f"{setting}: expected transforms ({', '.join(SUFFIXES)}) in {folder}, received none")
    return named


def _transform_files(folder: Path) -> list[Path]:
    return sorted(
        path
        for path in folder.iterdir()
        if path.is_file()
        and path.suffix.lower() in SUFFIXES
        and not path.name.startswith(".")
        and path.stem not in OTHER_FILES
        and not is_displacement(path)
    )
