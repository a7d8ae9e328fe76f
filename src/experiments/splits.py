"""Which cases train, which stop the training, and which are scored: by whole groups, never across one."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from experiments.errors import InputError
from experiments.files import write_text
from models.labelled_frames import LabelledFrames

AREA_CLASSES = 4


@dataclass(frozen=True)
class Split:
    """The case ids of one fold, with the group of each: ``train``, ``validation`` (early stopping) and ``test``."""

    fold: int
    folds: int
    train: tuple[str, ...]
    validation: tuple[str, ...]
    test: tuple[str, ...]
    groups: dict[str, str]

    def __post_init__(self) -> None:
        if not 0 <= self.fold < self.folds:
            raise InputError(f"fold: expected 0 to {self.folds - 1}, received {self.fold}")
        side_of: dict[str, str] = {}
        for side in ("train", "validation", "test"):
            if not getattr(self, side):
                raise InputError(f"{side}: expected at least one case in fold {self.fold}, received none")
            for case in getattr(self, side):
                group = self.groups[case]
                if side_of.setdefault(group, side) != side:
                    raise InputError(
                        f"groups: expected group {group!r} on one side of fold {self.fold}, "
                        f"found it in {side_of[group]} and {side}"
                    )

    def of(self, frames: LabelledFrames, side: str) -> LabelledFrames:
        """The frames of one side; InputError if a case is not among ``frames``."""
        place = {case: index for index, case in enumerate(frames.case_ids)}
        cases: tuple[str, ...] = getattr(self, side)
        missing = next((case for case in cases if case not in place), None)
        if missing is not None:
            raise InputError(f"split: expected cases of the data set, received {missing!r}, which it has not")
        return frames.subset(place[case] for case in cases)

    def write(self, path: Path) -> None:
        """Write as JSON."""
        write_text(path, json.dumps(asdict(self), indent=1))

    @staticmethod
    def read(path: Path) -> Split:
        """Read what ``write`` wrote; InputError if it is not that."""
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            for side in ("train", "validation", "test"):
                content[side] = tuple(content[side])
            return Split(**content)
        except (OSError, KeyError, TypeError, json.JSONDecodeError) as error:
            raise InputError(f"{path}: expected a split written as JSON, received another file") from error


@dataclass(frozen=True)
class GroupFolds:
    """K-fold cross-validation by groups, stratified by vessel area.

    Every group is tested once. Of the groups that a fold doesn't test, one part in ``validation_parts`` (at least one
    group) stops the training early; the rest trains. Areas fall in five classes: none, and four of like number.
    """

    folds: int
    seed: int = 0
    validation_parts: int = 5

    def __post_init__(self) -> None:
        for name in ("folds", "validation_parts"):
            if getattr(self, name) < 2:
                raise InputError(f"{name}: expected at least 2, received {getattr(self, name)}")

    def __call__(self, frames: LabelledFrames) -> tuple[Split, ...]:
        """All folds; InputError if there are too few groups for them."""
        count = len(set(frames.groups))
        if count < max(self.folds, 3):
            raise InputError(
                f"folds: expected at least {max(self.folds, 3)} groups for {self.folds} folds with one to "
                f"validate, received {count}"
            )
        classes, groups = area_classes(frames), np.array(frames.groups)
        group_of = dict(zip(frames.case_ids, frames.groups, strict=True))
        splits: list[Split] = []
        for fold, test in enumerate(_parts(classes, groups, self.folds, self.seed)):
            rest = np.setdiff1d(np.arange(len(groups)), test)
            parts = min(self.validation_parts, len(set(groups[rest])))
            validation = rest[_parts(classes[rest], groups[rest], parts, self.seed + 1 + fold)[0]]
            train = np.setdiff1d(rest, validation)
            sides = (tuple(frames.case_ids[i] for i in side) for side in (train, validation, test))
            splits.append(Split(fold, self.folds, next(sides), next(sides), next(sides), group_of))
        return tuple(splits)


def area_classes(frames: LabelledFrames) -> np.ndarray:
    """0 for a case without vessel, 1 to 4 by the share of the image that the vessel fills."""
    shares = np.array([mask.mean() for mask in frames.masks])
    classes = np.zeros(len(shares), dtype=np.int64)
    shown = shares > 0
    if shown.any():
        limits = np.quantile(shares[shown], np.linspace(0, 1, AREA_CLASSES + 1)[1:-1])
        classes[shown] = 1 + np.searchsorted(limits, shares[shown])
    return classes


def _parts(classes: np.ndarray, groups: np.ndarray, parts: int, seed: int) -> list[np.ndarray]:
    """Divide the cases by groups into parts of like size and make-up: indices of each part.

    From the largest group to the smallest, in random order among equals, each goes to the part with which it has the
    least in common, counted in cases and in cases of each class: that adds least to the squared differences between
    the parts. An empty part has nothing in common with any group, so none stays empty. (scikit-learn's
    StratifiedGroupKFold looks at classes alone: it divided six sweeps of equal length 3 to 2 to 1.)
    """
    names, member = np.unique(groups, return_inverse=True)
    counts = np.zeros((len(names), AREA_CLASSES + 1))
    np.add.at(counts, (member, classes), 1)
    sizes = counts.sum(axis=1)
    present = counts.sum(axis=0) > 0
    shares = counts[:, present] / counts[:, present].sum(axis=0)
    # Size weighs as much as all classes together.
    weighed = np.column_stack([shares, np.sqrt(present.sum()) * sizes / sizes.sum()])
    shuffled = np.random.default_rng(seed).permutation(len(names))
    filled, part_of = np.zeros((parts, weighed.shape[1])), np.zeros(len(names), dtype=np.int64)
    for group in shuffled[np.argsort(-sizes[shuffled], kind="stable")]:
        part_of[group] = np.argmin(filled @ weighed[group])
        filled[part_of[group]] += weighed[group]
    return [np.flatnonzero(part_of[member] == part) for part in range(parts)]
