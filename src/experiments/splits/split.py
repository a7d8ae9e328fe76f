"""Which cases train, which stop the training, which are scored, and which stay outside all folds: by whole groups.

A group has one of three roles: cross-validation, ``selection`` (on which every choice made from the folds' models is
fitted) or ``test`` (scored once). A fold divides the cross-validation groups into ``train``, ``validation`` (early
stopping) and ``test`` (its left-out part, scored out-of-fold). To tell the two apart, the cases of the groups whose
role is test are called ``held_out`` everywhere in the program.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from experiments.errors import InputError, reading
from experiments.files import write_text
from experiments.unicode_names import same_name
from models.labelled_frames import LabelledFrames
from registration.text_files import read_text

FOLD_SIDES = ("train", "validation", "test")
OUTSIDE = ("selection", "held_out")


@dataclass(frozen=True)
class Split:
    """The case ids of one fold, with the group of each.

    Parameters
    ----------
    fold : int
        Number of the fold, from 0.
    folds : int
        Number of folds.
    train, validation, test : tuple of str
        The fold's own cases.
    groups : dict of str to str
        Group of each case.
    selection, held_out : tuple of str
        Cases outside all folds; may be empty.
    outer_fold : int or None
        The outer fold whose groups are ``held_out``, where folds are nested.

    Raises
    ------
    InputError
        If a side of the fold is empty, a case is named twice, or a group is on two sides; the message names
        it.
    """

    fold: int
    folds: int
    train: tuple[str, ...]
    validation: tuple[str, ...]
    test: tuple[str, ...]
    groups: dict[str, str]
    selection: tuple[str, ...] = ()
    held_out: tuple[str, ...] = ()
    outer_fold: int | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.fold < self.folds:
            raise InputError(f"fold: expected 0 to {self.folds - 1}, received {self.fold}")
        side_of: dict[str, str] = {}
        for side in (*FOLD_SIDES, *OUTSIDE):
            cases: tuple[str, ...] = getattr(self, side)
            if not cases and side in FOLD_SIDES:
                raise InputError(f"{side}: expected at least one case in {self.place}, received none")
            if len(set(cases)) != len(cases):
                raise InputError(f"{side}: expected each case once in {self.place}, received one twice")
            for case in cases:
                group = self.groups[case]
                if side_of.setdefault(group, side) != side:
                    raise InputError(
                        f"groups: expected group {group!r} on one side of {self.place}, "
                        f"found it in {side_of[group]} and {side}"
                    )

    @property
    def place(self) -> str:
        """Which fold this is, in words."""
        return f"fold {self.fold}" + ("" if self.outer_fold is None else f" of outer fold {self.outer_fold}")

    def of(self, frames: LabelledFrames, side: str) -> LabelledFrames:
        """Take the frames of one side.

        Parameters
        ----------
        frames : LabelledFrames
            All cases.
        side : str
            ``train``, ``validation``, ``test``, ``selection`` or ``held_out``.

        Returns
        -------
        LabelledFrames
            The frames, in the order of the split.

        Raises
        ------
        InputError
            If a case is not among ``frames``.
        """
        place = {case: index for index, case in enumerate(frames.case_ids)}
        cases: tuple[str, ...] = getattr(self, side)
        missing = next((case for case in cases if case not in place), None)
        if missing is not None:
            raise InputError(f"split: expected cases of the data set, received {missing!r}, which it has not")
        return frames.subset(place[case] for case in cases)

    def sides(self) -> Iterator[tuple[str, str]]:
        """Iterate over every case with the side it is on.

        Yields
        ------
        (str, str)
            Case and side.
        """
        for side in (*FOLD_SIDES, *OUTSIDE):
            for case in getattr(self, side):
                yield case, side

    def write(self, path: Path) -> None:
        """Write this fold as JSON, as ``python -m models.train`` reads it.

        Parameters
        ----------
        path : Path
            The file.
        """
        write_text(path, json.dumps(asdict(self), indent=1))

    @staticmethod
    def read(path: Path) -> Split:
        """Read what ``write`` wrote.

        Parameters
        ----------
        path : Path
            The file.

        Returns
        -------
        Split
            The fold.

        Raises
        ------
        InputError
            If it is another file.
        """
        content = read_json(path)
        with reading(path, "a split written as JSON"):
            return from_json(content)


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : Path
        The file, in UTF-8 with or without a byte-order mark.

    Returns
    -------
    object
        Its content.

    Raises
    ------
    InputError
        If it can't be read as JSON.
    """
    with reading(path, "a split written as JSON"):
        return json.loads(read_text(path))


def from_json(content: dict[str, Any]) -> Split:
    """Build a fold from the content of a file.

    Parameters
    ----------
    content : dict
        The fields of a ``Split``.

    Returns
    -------
    Split
        The fold.

    Raises
    ------
    KeyError, TypeError or AttributeError
        If the content is not that of a fold.
    """
    sides = {side: tuple(map(same_name, content[side])) for side in FOLD_SIDES}
    # A file that knows no groups outside the folds says nothing of them.
    outside = {side: tuple(map(same_name, content.get(side, ()))) for side in OUTSIDE}
    groups = {same_name(case): same_name(group) for case, group in content["groups"].items()}
    return Split(**{**content, **sides, **outside, "groups": groups})
