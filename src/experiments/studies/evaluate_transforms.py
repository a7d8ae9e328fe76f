"""A method's transforms beside the truth: which files belong together, and a row of scores for each case."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.names import same_name
from experiments.datasets.reading import IMAGE_SUFFIXES
from experiments.errors import InputError
from experiments.outcome import Progress
from experiments.studies.evaluate_poses import Answer, answer_row, read_answer
from experiments.studies.registration_inputs import naming, read_pose
from registration.benchmark.case_files import CASE_FILE, TRUTH, read_case
from registration.benchmark.cases import CaseTruth
from registration.benchmark.truth_files import read_truth
from registration.centerline_io import read_centerline_table
from registration.geometry_io import read_centerline
from registration.results import FAILED
from registration.transform_files import ITK_SUFFIXES

SUFFIXES = (".json", *ITK_SUFFIXES)
MOST_TARGETS = 500
MISSING = "no file for this case"
# Files of JSON that lie beside answers and hold none.
NO_ANSWERS = ("evaluation", "metrics", "job", "identity", "case")


@dataclass(frozen=True)
class TransformPairs:
    """The cases of a reference by name, with the answer's file (None where there is none), and files of no case.

    ``cases`` is the folder that holds the cases themselves, None where only their truth is at hand; ``targets_mm``
    (t, 3) are those of references that have none of their own.
    """

    references: dict[str, Path]
    predictions: dict[str, Path]
    unused: tuple[str, ...]
    cases: Path | None
    targets_mm: np.ndarray | None


def are_transforms(reference: Path) -> bool:
    """Whether a reference is a truth, a folder of them, or a subset of the benchmark, and not masks."""
    if reference.is_file():
        return reference.suffix.lower() in SUFFIXES
    if (reference / TRUTH).is_dir():
        return True
    images = any(path.suffix.lower() in IMAGE_SUFFIXES for path in reference.iterdir())
    return not images and bool(_transform_files(reference))


def pair_transforms(prediction: Path, reference: Path, targets: str | None) -> TransformPairs:
    """Say which answer belongs to which reference, by name; one file goes with one file whatever their names.

    Raises InputError for paths that are not there, a folder against a file, no references, no answer of their names, or
    two answers of one name.
    """
    targets_mm = None if targets is None else _targets(Path(targets))
    if reference.is_file() != prediction.is_file():
        kinds = {True: "a file", False: "a folder"}
        raise InputError(
            f"prediction: expected {kinds[reference.is_file()]}, as reference is, received "
            f"{kinds[prediction.is_file()]} {prediction}"
        )
    if reference.is_file():
        name = reference.stem
        return TransformPairs({name: reference}, {name: prediction}, (), None, targets_mm)
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
    unused = tuple(name for name in found if name not in references)
    return TransformPairs(references, predictions, unused, cases, targets_mm)


def read_reference(path: Path, targets_mm: np.ndarray | None) -> CaseTruth:
    """The truth of a benchmark's case, or a pose with the targets given apart."""
    if targets_mm is None:
        if path.suffix.lower() != ".json":
            raise InputError(
                f"targets: expected a centerline (.csv, .vtp) to measure {path} at, received none"
            )
        with naming("reference"):
            return read_truth(path)
    return CaseTruth(
        name=path.stem,
        anatomy=path.stem,
        kind="",
        place="",
        fixed_T_moving=read_pose(path, "reference"),
        targets_mm=targets_mm,
        covered=np.ones(len(targets_mm), dtype=bool),
        outlier=np.zeros(0, dtype=bool),
        angle_deg=float("nan"),
        translation_mm=float("nan"),
        simulated=False,
    )


def transform_rows(pairs: TransformPairs, progress: Progress) -> Iterator[dict[str, Any]]:
    """A row a case, in order of name; a case without a file has failed."""
    total = len(pairs.references)
    for name, path in progress.track(pairs.references.items(), "scoring transforms", total):
        truth = read_reference(path, pairs.targets_mm)
        case = None
        if pairs.cases is not None and pairs.targets_mm is None:
            with naming("reference"):
                case = read_case(pairs.cases / path.stem)
        given = pairs.predictions.get(name)
        answer = Answer(None, FAILED, error=MISSING) if given is None else read_answer(given)
        yield answer_row(answer, truth, case)


def _targets(path: Path) -> np.ndarray:
    with naming("targets"):
        if path.suffix.lower() == ".csv":
            return read_centerline_table(path).even_points(MOST_TARGETS)
        return read_centerline(path).even_points(MOST_TARGETS)


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
        and path.stem not in NO_ANSWERS
    )
