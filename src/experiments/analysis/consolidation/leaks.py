"""Refusal of evaluations in which what is scored was seen before."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from experiments.errors import InputError
from experiments.splits.split import FOLD_SIDES
from experiments.splits.split_set import SplitSet
from models.labelled_frames import LabelledFrames


def require_no_leaks(frames: LabelledFrames, splits: SplitSet) -> None:
    """Require that cross-validation, selection and test share no group and no image.

    Parameters
    ----------
    frames : LabelledFrames
        All cases.
    splits : SplitSet
        The folds of one outer fold.

    Raises
    ------
    InputError
        If a role has no cases, or a group or an image (under any name) is in two roles.
    """
    digests = {
        case: hashlib.sha256(repr(image.shape).encode() + image.tobytes()).hexdigest()
        for case, image in zip(frames.case_ids, frames.images, strict=True)
    }
    role_of_group: dict[str, str] = {}
    role_of_image: dict[str, tuple[str, str]] = {}
    found: set[str] = set()
    for case, role in _roles(splits):
        found.add(role)
        group = splits.splits[0].groups[case]
        if role_of_group.setdefault(group, role) != role:
            raise InputError(
                f"split: expected group {group!r} in one part, found it in {role_of_group[group]} and {role}"
            )
        other, seen = role_of_image.setdefault(digests[case], (case, role))
        if seen != role:
            raise InputError(
                f"split: expected each image in one part, found the same image as {other!r} in {seen} and as {case!r} "
                f"in {role}: put both into one group"
            )
    for role, hint in (("selection", "selection_share"), ("held_out", "test_share or outer_folds")):
        if role not in found:
            raise InputError(
                f"split: expected groups for {role}, received none (split=three_way or split=nested, or {hint})"
            )


def _roles(splits: SplitSet) -> Iterator[tuple[str, str]]:
    """Every case with its role, once for each fold."""
    for split in splits:
        for case, side in split.sides():
            yield case, "cross-validation" if side in FOLD_SIDES else side
