"""Groups and images that would be scored after they were seen."""

from __future__ import annotations

import dataclasses

import pytest
from drawn_vessels import drawn_frames

from experiments.analysis.consolidation.leaks import require_no_leaks
from experiments.errors import InputError
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from models.labelled_frames import LabelledFrames

THREE_WAY = GroupSplits(3, selection_share=0.2, test_share=0.2)


def test_a_three_way_split_passes() -> None:
    frames = drawn_frames(30)
    require_no_leaks(frames, THREE_WAY(frames))


@pytest.mark.parametrize(
    ("split", "role"),
    [(GroupSplits(3, test_share=0.2), "selection"), (GroupSplits(3, selection_share=0.2), "held_out")],
)
def test_a_split_without_a_part_is_refused(split: GroupSplits, role: str) -> None:
    frames = drawn_frames(30)
    with pytest.raises(InputError, match=f"split: expected groups for {role}, received none"):
        require_no_leaks(frames, split(frames))


def test_one_image_under_two_names_in_two_parts_is_refused() -> None:
    frames = drawn_frames(30)
    splits = THREE_WAY(frames)
    place = {case: index for index, case in enumerate(frames.case_ids)}
    seen, scored = splits.splits[0].train[0], splits.splits[0].held_out[0]
    images = list(frames.images)
    images[place[scored]] = images[place[seen]]
    copied = dataclasses.replace(frames, images=tuple(images))
    with pytest.raises(
        InputError, match=f"found the same image as '{seen}' in cross-validation and as '{scored}'"
    ):
        require_no_leaks(copied, splits)


def test_a_group_in_two_parts_is_refused_before_anything_is_trained() -> None:
    frames: LabelledFrames = drawn_frames(30)
    split = THREE_WAY(frames).splits[0]
    groups = dict(split.groups) | {split.held_out[0]: split.groups[split.train[0]]}
    with pytest.raises(InputError, match=r"expected group .* on one side of fold 0"):
        Split(**{**vars(split), "groups": groups})
