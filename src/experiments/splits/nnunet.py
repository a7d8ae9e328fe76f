"""The split file of nnU-Net, ``splits_final.json``: a list with ``train`` and ``val`` of each fold.

Format: nnU-Net v2, documentation/manual_data_splits.md. nnU-Net trains to the end and scores ``val`` out-of-fold, so
its ``val`` is what is called a fold's test part here, and its ``train`` is train and validation together.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import InputError
from experiments.splits.group_partition import GroupedCases
from experiments.splits.split import Split
from experiments.splits.split_set import SplitSet
from experiments.unicode_names import same_name
from models.labelled_frames import LabelledFrames

FILE_NAME = "splits_final.json"


def to_nnunet(splits: SplitSet) -> list[dict[str, list[str]]]:
    """Convert folds to the content of ``splits_final.json``.

    Parameters
    ----------
    splits : SplitSet
        All folds.

    Returns
    -------
    list of dict
        ``train`` and ``val`` of each fold; cases outside all folds are in neither list.
    """
    return [
        {"train": sorted((*split.train, *split.validation)), "val": sorted(split.test)} for split in splits
    ]


def is_nnunet(content: Any) -> bool:
    """Return whether the content of a JSON file is a list, as in ``splits_final.json``.

    Parameters
    ----------
    content : object
        Content of the file.

    Returns
    -------
    bool
        Whether it is.
    """
    return isinstance(content, list)


@dataclass(frozen=True)
class NnUnetSplits:
    """The folds of a ``splits_final.json``, with an early-stopping part taken out of ``train``.

    Parameters
    ----------
    path : Path
        The file, for messages.
    content : object
        Its content.
    validation_parts : int
        The early-stopping part is one in so many, by whole groups.
    seed : int
        Seed of that choice. With the fold, it acts as in the project's own folds, so that what ``to_nnunet``
        wrote comes back as it was.
    """

    path: Path
    content: Any
    validation_parts: int
    seed: int

    def __call__(
        self, frames: LabelledFrames, selection_groups: Collection[str], test_groups: Collection[str]
    ) -> SplitSet:
        """Convert the folds.

        Parameters
        ----------
        frames : LabelledFrames
            All cases; those outside the groups below must be in one list of each fold.
        selection_groups, test_groups : collection of str
            Groups kept outside all folds, whose cases must be in no list.

        Returns
        -------
        SplitSet
            All folds.

        Raises
        ------
        InputError
            If the content has another form, and as ``SplitSet`` and its ``for_frames`` raise it.
        """
        cases = GroupedCases.of(frames)
        selection, held_out = (
            cases.names(cases.in_groups(groups)) for groups in (selection_groups, test_groups)
        )
        number_of = {case: number for number, case in enumerate(cases.ids)}
        splits = []
        for fold, lists in enumerate(self.content):
            sides = [self._cases(lists, side, fold, number_of) for side in ("train", "val")]
            if not len(sides[0]):
                raise InputError(f"{self.path}: expected cases under train in fold {fold}, received none")
            stopping = cases.stopping_part(sides[0], self.validation_parts, self.seed + 1 + fold)
            train, validation, test = (
                cases.names(part) for part in (np.setdiff1d(sides[0], stopping), stopping, sides[1])
            )
            group_of = cases.group_of()
            splits.append(
                Split(fold, len(self.content), train, validation, test, group_of, selection, held_out)
            )
        return SplitSet(tuple(splits)).for_frames(frames)

    def _cases(self, lists: Any, side: str, fold: int, number_of: dict[str, int]) -> np.ndarray:
        named = lists.get(side) if isinstance(lists, dict) else None
        if not isinstance(named, list) or not all(isinstance(case, str) for case in named):
            raise InputError(
                f"{self.path}: expected a list of cases as {side} of fold {fold}, received {named!r}"
            )
        named = [same_name(case) for case in named]
        if unknown := sorted(set(named) - set(number_of)):
            raise InputError(
                f"{self.path}: expected only cases of the data set in fold {fold}, received {unknown[0]!r}"
            )
        return np.unique([number_of[case] for case in named]).astype(np.int64)
