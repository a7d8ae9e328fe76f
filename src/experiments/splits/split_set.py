"""All folds of a data set together: what they must agree on, and the file they are kept in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.errors import InputError, reading
from experiments.files import write_text
from experiments.splits.split import FOLD_SIDES, OUTSIDE, Split, from_json, read_json
from models.labelled_frames import LabelledFrames


@dataclass(frozen=True)
class SplitSet:
    """All folds of a data set, of every outer fold where they are nested.

    Parameters
    ----------
    splits : tuple of Split
        The folds.

    Raises
    ------
    InputError
        If a group is tested in two folds, held out of two outer folds, or in the folds in one and outside in
        another; the message names group and places.
    """

    splits: tuple[Split, ...]

    def __post_init__(self) -> None:
        if not self.splits:
            raise InputError("split: expected at least one fold, received none")
        if len({(split.outer_fold, split.fold) for split in self.splits}) != len(self.splits):
            raise InputError("split: expected each fold once, received one twice")
        if any(split.groups != self.splits[0].groups for split in self.splits):
            raise InputError("groups: expected the same groups in all folds, received others")
        tested: dict[tuple[int | None, str], str] = {}
        outside: dict[tuple[int | None, str], str] = {}
        held_out: dict[str, str] = {}
        for split in self.splits:
            for case, side in split.sides():
                group = split.groups[case]
                key = (split.outer_fold, group)
                if side == "test":
                    _once(tested, key, group, f"test of {split.place}")
                _once(outside, key, group, side if side in OUTSIDE else "the folds")
                if side == "held_out" and split.outer_fold is not None:
                    _once(held_out, group, group, f"held_out of outer fold {split.outer_fold}")

    def __iter__(self) -> Iterator[Split]:
        return iter(self.splits)

    def __len__(self) -> int:
        return len(self.splits)

    def fold(self, fold: int, outer_fold: int | None = None) -> Split:
        """Return one fold.

        Parameters
        ----------
        fold : int
            Its number.
        outer_fold : int or None
            Its outer fold; None: not nested.

        Returns
        -------
        Split
            The fold.

        Raises
        ------
        InputError
            If there is none of that number.
        """
        for split in self.splits:
            if (split.outer_fold, split.fold) == (outer_fold, fold):
                return split
        raise InputError(
            f"fold: expected one of the split's (outer fold, fold) {list(self.pairs())}, "
            f"received {(outer_fold, fold)}"
        )

    def pairs(self) -> tuple[tuple[int | None, int], ...]:
        """Return the numbers of all folds.

        Returns
        -------
        tuple of (int or None, int)
            Outer fold (None: not nested) and fold.
        """
        return tuple((split.outer_fold, split.fold) for split in self.splits)

    def for_frames(self, frames: LabelledFrames) -> SplitSet:
        """Return the same folds with the groups of a data set.

        Parameters
        ----------
        frames : LabelledFrames
            All cases.

        Returns
        -------
        SplitSet
            The folds.

        Raises
        ------
        InputError
            If a case is in one of both alone, or the folds do not keep the groups of ``frames`` whole; the
            message names case or group.
        """
        groups = dict(zip(frames.case_ids, frames.groups, strict=True))
        for split in self.splits:
            named = {case for case, _ in split.sides()}
            if unknown := named - set(groups):
                raise InputError(
                    f"split: expected only cases of the data set in {split.place}, received {min(unknown)!r}"
                )
            if missing := set(groups) - named:
                raise InputError(
                    f"split: expected a side of {split.place} for every case of the data set, found none for "
                    f"{min(missing)!r} ({len(missing)} in all)"
                )
        return SplitSet(tuple(Split(**{**vars(split), "groups": groups}) for split in self.splits))

    def renamed(self, names: Mapping[str, str]) -> SplitSet:
        """Return the same folds with other names.

        Parameters
        ----------
        names : mapping of str to str
            New name of each case.

        Returns
        -------
        SplitSet
            The folds.
        """
        groups = {names[case]: group for case, group in self.splits[0].groups.items()}
        sides = [
            {side: tuple(names[case] for case in getattr(split, side)) for side in (*FOLD_SIDES, *OUTSIDE)}
            for split in self.splits
        ]
        changed = [{**vars(split), "groups": groups, **side} for split, side in zip(self, sides, strict=True)]
        return SplitSet(tuple(Split(**fields) for fields in changed))

    def of_outer_fold(self, outer_fold: int | None) -> SplitSet:
        """Return the folds of one outer fold.

        Parameters
        ----------
        outer_fold : int or None
            Its number; None stands for all where folds are not nested.

        Returns
        -------
        SplitSet
            The folds.

        Raises
        ------
        InputError
            If there is no such outer fold, or None is given for nested folds.
        """
        splits = tuple(split for split in self.splits if split.outer_fold == outer_fold)
        if not splits:
            numbers = sorted({split.outer_fold for split in self.splits if split.outer_fold is not None})
            expected = (
                f"one of {', '.join(map(str, numbers))}" if numbers else "null, as folds are not nested"
            )
            raise InputError(f"outer_fold: expected {expected}, received {outer_fold}")
        return SplitSet(splits)

    def write(self, path: Path) -> None:
        """Write all folds as one JSON file: ``groups`` (case to group) and ``folds``.

        Parameters
        ----------
        path : Path
            The file.
        """
        folds = [{key: value for key, value in vars(split).items() if key != "groups"} for split in self]
        write_text(path, json.dumps({"groups": self.splits[0].groups, "folds": folds}, indent=1))

    @staticmethod
    def read(path: Path) -> SplitSet:
        """Read what ``write`` wrote.

        Parameters
        ----------
        path : Path
            The file.

        Returns
        -------
        SplitSet
            The folds.

        Raises
        ------
        InputError
            If it is another file.
        """
        content = read_json(path)
        with reading(path, "a file of all folds"):
            return SplitSet(
                tuple(from_json({**fold, "groups": content["groups"]}) for fold in content["folds"])
            )


def _once(found: dict[Any, str], key: Any, group: str, place: str) -> None:
    if found.setdefault(key, place) != place:
        raise InputError(
            f"groups: expected group {group!r} in one place, found it in {found[key]} and {place}"
        )
