"""The recipe of a split: k folds by groups, groups outside all folds, nested folds, or a split file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.errors import InputError
from experiments.paths import PathSetting
from experiments.splits.group_partition import GroupedCases, Indices
from experiments.splits.nnunet import NnUnetSplits, is_nnunet
from experiments.splits.split import Split, read_json
from experiments.splits.split_set import SplitSet
from experiments.unicode_names import text_names
from models.labelled_frames import LabelledFrames

# A fold needs a group for each of train, validation and test.
MIN_GROUPS = 3


@dataclass(frozen=True)
class GroupSplits:
    """Cross-validation by groups, stratified by vessel area, with groups outside all folds where asked for.

    Parameters
    ----------
    folds : int
        Number of folds, at least 2; every group of the cross-validation is tested in one of them.
    seed : int
        Seed of the division.
    validation_parts : int
        Of the groups that a fold does not test, one part in so many (at least one group) stops the training
        early; the rest trains. At least 2.
    selection_share, test_share : float
        Share of the cases, 0 to below 1, for selection and test outside all folds; at least one group each
        where above 0.
    selection_groups, test_groups : sequence of str
        Groups named for them instead.
    outer_folds : int or None
        Nested folds: the groups of each outer fold are the test groups in turn, and folds and selection come
        from the rest. None: not nested.
    file : Path or None
        A split to use as it is: one that ``SplitSet.write`` wrote, or nnU-Net's ``splits_final.json``, from
        whose ``train`` the early-stopping part is taken (``validation_parts``, ``seed``). Of all else only
        the named groups then count.

    Raises
    ------
    InputError
        If a setting is out of range, or two exclude each other.
    """

    folds: int = 3
    seed: int = 0
    validation_parts: int = 5
    selection_share: float = 0.0
    test_share: float = 0.0
    selection_groups: Sequence[str] = ()
    test_groups: Sequence[str] = ()
    outer_folds: int | None = None
    file: PathSetting | None = None

    def __post_init__(self) -> None:
        for role in ("selection", "test"):
            names = text_names(f"{role}_groups", getattr(self, f"{role}_groups"))
            object.__setattr__(self, f"{role}_groups", names)
            share = getattr(self, f"{role}_share")
            if not 0 <= share < 1:
                raise InputError(f"{role}_share: expected 0 to below 1, received {share}")
            if share and names:
                raise InputError(f"{role}_share: expected 0 together with {role}_groups, received {share}")
        for name in ("folds", "validation_parts", "outer_folds"):
            value = getattr(self, name)
            if (value is not None or name != "outer_folds") and not _whole(value):
                raise InputError(f"{name}: expected a whole number of at least 2, received {value!r}")
        if self.selection_share + self.test_share >= 1:
            raise InputError(
                f"test_share: expected less than {1 - self.selection_share:g} together with selection_share, "
                f"received {self.test_share}"
            )
        if self.outer_folds is not None and (self.test_share or self.test_groups):
            raise InputError(
                f"outer_folds: expected null together with test_share or test_groups, received {self.outer_folds}"
            )

    def pairs(self) -> tuple[tuple[int | None, int], ...]:
        """Return the fold of every job, from the configuration and the split file alone.

        Returns
        -------
        tuple of (int or None, int)
            Outer fold (None: not nested) and fold.

        Raises
        ------
        InputError
            If the file can't be read as a split.
        """
        if self.file is not None:
            content = read_json(self._path)
            if is_nnunet(content):
                return tuple((None, fold) for fold in range(len(content)))
            return SplitSet.read(self._path).pairs()
        outer: Sequence[int | None] = [None] if self.outer_folds is None else range(self.outer_folds)
        return tuple((number, fold) for number in outer for fold in range(self.folds))

    def __call__(
        self, frames: LabelledFrames, *, selection_groups: Sequence[str] = (), test_groups: Sequence[str] = ()
    ) -> SplitSet:
        """Divide a data set.

        Parameters
        ----------
        frames : LabelledFrames
            All cases.
        selection_groups, test_groups : sequence of str
            Groups that the data set itself keeps outside all folds.

        Returns
        -------
        SplitSet
            All folds.

        Raises
        ------
        InputError
            If there are too few groups, a named group is missing or named for both, the data set and the
            settings both choose groups for the test, or the file does not fit the data set.
        """
        if test_groups and (self.outer_folds is not None or self.test_share or self.test_groups):
            raise InputError(
                "split: expected no test_share, test_groups or outer_folds for a data set that keeps groups for "
                f"the test itself ({', '.join(sorted(test_groups)[:3])}), received some"
            )
        selection = {*self.selection_groups, *selection_groups}
        test = {*self.test_groups, *test_groups}
        _check_names(frames, selection, test)
        if self.file is not None:
            return self._given(frames, selection, test)
        return SplitSet(tuple(self._made(GroupedCases.of(frames), selection, test)))

    @property
    def _path(self) -> Path:
        return Path(str(self.file)).expanduser()

    def _given(self, frames: LabelledFrames, selection: set[str], test: set[str]) -> SplitSet:
        content = read_json(self._path)
        if is_nnunet(content):
            made = NnUnetSplits(self._path, content, self.validation_parts, self.seed)
            return made(frames, selection, test)
        splits = SplitSet.read(self._path).for_frames(frames)
        for role, groups in (("selection", selection), ("held_out", test)):
            for split in splits:
                wrong = next(
                    (s for case, s in split.sides() if split.groups[case] in groups and s != role), None
                )
                if wrong is not None:
                    raise InputError(
                        f"{self._path}: expected groups {', '.join(sorted(groups)[:3])} in {role} of {split.place}, "
                        f"found one in {wrong}"
                    )
        return splits

    def _made(self, cases: GroupedCases, selection: set[str], test: set[str]) -> Iterator[Split]:
        named_selection, named_test = cases.in_groups(selection), cases.in_groups(test)
        pool = np.setdiff1d(np.arange(len(cases.ids)), np.union1d(named_selection, named_test))
        if self.outer_folds is None:
            yield from self._folds(cases, None, pool, named_selection, named_test)
            return
        if (count := cases.count_groups(pool)) < self.outer_folds:
            raise InputError(
                f"outer_folds: expected at least {self.outer_folds} groups for as many outer folds, received {count}"
            )
        for outer, part in enumerate(cases.divide(pool, _equal(self.outer_folds), self.seed)):
            yield from self._folds(cases, outer, np.setdiff1d(pool, part), named_selection, part)

    def _folds(
        self, cases: GroupedCases, outer: int | None, pool: Indices, selection: Indices, held_out: Indices
    ) -> Iterator[Split]:
        """Return the folds of ``pool`` less the groups that the shares take from it."""
        taken = [share for share in (self.selection_share, self.test_share) if share]
        self._require_groups(cases.count_groups(pool) - len(taken), outer)
        pool, *chosen = cases.divide(pool, [1 - sum(taken), *taken], self.seed)
        self._require_groups(cases.count_groups(pool), outer)
        if self.test_share:
            held_out = np.union1d(held_out, chosen.pop())
        if self.selection_share:
            selection = np.union1d(selection, chosen.pop())
        for fold, test in enumerate(cases.divide(pool, _equal(self.folds), self.seed)):
            rest = np.setdiff1d(pool, test)
            validation = cases.stopping_part(rest, self.validation_parts, self.seed + 1 + fold)
            yield Split(
                fold=fold,
                folds=self.folds,
                train=cases.names(np.setdiff1d(rest, validation)),
                validation=cases.names(validation),
                test=cases.names(test),
                groups=cases.group_of(),
                selection=cases.names(selection),
                held_out=cases.names(held_out),
                outer_fold=outer,
            )

    def _require_groups(self, count: int, outer: int | None) -> None:
        minimum = max(self.folds, MIN_GROUPS)
        if count < minimum:
            where = "" if outer is None else f" within outer fold {outer}"
            raise InputError(
                f"folds: expected at least {minimum} groups for {self.folds} folds with one to validate{where}, "
                f"received {max(count, 0)} (groups for selection and test not counted)"
            )


def _equal(parts: int) -> list[float]:
    return [1 / parts] * parts


def _whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 2


def _check_names(frames: LabelledFrames, selection: set[str], test: set[str]) -> None:
    for name, groups in (("selection_groups", selection), ("test_groups", test)):
        if unknown := sorted(groups - set(frames.groups)):
            raise InputError(
                f"{name}: expected groups of the data set, received {unknown[0]!r}, which it has not"
            )
    if both := sorted(selection & test):
        raise InputError(f"test_groups: expected none of selection_groups, received {both[0]!r}")
