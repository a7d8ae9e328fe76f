import dataclasses

import numpy as np
import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.splits import GroupFolds, Split, area_classes
from models.labelled_frames import LabelledFrames

FRAMES = drawn_frames(60, per_group=3, empty=9)
SIDES = ("train", "validation", "test")


def with_groups(frames: LabelledFrames, groups: list[str]) -> LabelledFrames:
    return dataclasses.replace(frames, groups=tuple(groups))


@pytest.mark.parametrize("folds", [2, 3, 5])
def test_every_case_is_tested_once_and_no_group_is_on_two_sides(folds: int) -> None:
    splits = GroupFolds(folds, seed=0)(FRAMES)
    assert [split.fold for split in splits] == list(range(folds))
    assert sorted(case for split in splits for case in split.test) == sorted(FRAMES.case_ids)
    group_of = dict(zip(FRAMES.case_ids, FRAMES.groups, strict=True))
    for split in splits:
        sides = [{group_of[case] for case in getattr(split, side)} for side in SIDES]
        assert all(sides)
        assert not (sides[0] & sides[1] or sides[0] & sides[2] or sides[1] & sides[2])
        assert len(split.train) + len(split.validation) + len(split.test) == len(FRAMES)
        assert len(split.train) > len(split.validation)


def test_groups_of_unequal_size_stay_whole_and_folds_stay_alike() -> None:
    sizes = [12, 1, 1, 7, 3, 3, 3, 2, 8, 5, 4, 6, 5]
    groups = [f"g{number}" for number, size in enumerate(sizes) for _ in range(size)]
    frames = with_groups(FRAMES, groups)
    splits = GroupFolds(3)(frames)
    assert all(16 <= len(split.test) <= 24 for split in splits)
    for group in set(groups):
        cases = {case for case, other in zip(frames.case_ids, groups, strict=True) if other == group}
        assert sum(cases <= set(split.test) for split in splits) == 1


def test_equal_groups_are_divided_equally_however_unlike() -> None:
    frames = drawn_frames(60, per_group=10)
    order = np.argsort([mask.sum() for mask in frames.masks])
    frames = with_groups(frames.subset(order), [f"g{index // 10}" for index in range(60)])
    for seed in range(5):
        assert [len(split.test) for split in GroupFolds(3, seed)(frames)] == [20, 20, 20]
        assert {len(split.validation) for split in GroupFolds(3, seed)(frames)} == {10}


def test_vessel_areas_are_alike_in_all_folds() -> None:
    # Groups of small and of large vessels: by chance alone a third could be nearly all of one kind.
    frames = drawn_frames(90, per_group=3)
    order = np.argsort([mask.sum() for mask in frames.masks])
    frames = with_groups(frames.subset(order), [f"g{index // 3}" for index in range(90)])
    kind = dict(zip(frames.case_ids, area_classes(frames), strict=True))
    for seed in range(4):
        for wanted in (1, 2, 3, 4):
            counts = [
                sum(kind[case] == wanted for case in split.test) for split in GroupFolds(3, seed)(frames)
            ]
            assert max(counts) - min(counts) <= 5  # a group is 3 cases; chance would differ by 9 and more


def test_the_seed_decides() -> None:
    first, same, other = (GroupFolds(3, seed)(FRAMES) for seed in (0, 0, 1))
    assert first == same and first != other


def test_as_many_groups_as_folds_are_enough_if_one_can_validate() -> None:
    frames = with_groups(FRAMES, [f"g{index % 3}" for index in range(60)])
    for split in GroupFolds(3)(frames):
        assert (len(split.train), len(split.validation), len(split.test)) == (20, 20, 20)


@pytest.mark.parametrize(("folds", "groups", "least"), [(3, 2, 3), (5, 4, 5), (2, 2, 3)])
def test_refuses_fewer_groups_than_folds(folds: int, groups: int, least: int) -> None:
    frames = with_groups(FRAMES, [f"g{index % groups}" for index in range(60)])
    with pytest.raises(InputError, match=f"folds: expected at least {least} groups .* received {groups}"):
        GroupFolds(folds)(frames)


def test_no_part_is_empty_however_unlike_the_groups() -> None:
    # Few groups that are each all of one kind are what stratifying alone stumbles over.
    for seed in range(10):
        frames = drawn_frames(40, per_group=10, empty=20, seed=seed)
        for split in GroupFolds(4, seed)(frames):
            assert split.train and split.validation and split.test


def test_a_few_cases_in_as_many_groups_are_divided_all_the_same() -> None:
    for one in GroupFolds(3)(drawn_frames(6, per_group=1)):
        assert len(one.test) == 2 and len(one.validation) == 1 and len(one.train) == 3


def test_area_classes() -> None:
    masks = [np.zeros((10, 10), bool) for _ in range(9)]
    for index, mask in enumerate(masks):
        mask[:index] = True
    frames = dataclasses.replace(drawn_frames(9, size=(10, 10)), masks=tuple(masks))
    assert area_classes(frames).tolist() == [0, 1, 1, 2, 2, 3, 3, 4, 4]


def split(**changes: object) -> Split:
    fields = {
        "fold": 0,
        "folds": 2,
        "train": ("a",),
        "validation": ("b",),
        "test": ("c",),
        "groups": {"a": "1", "b": "2", "c": "3"},
    }
    return Split(**{**fields, **changes})


def test_refuses_a_group_on_two_sides() -> None:
    with pytest.raises(
        InputError, match="expected group '1' on one side of fold 0, found it in train and test"
    ):
        split(groups={"a": "1", "b": "2", "c": "1"})


def test_refuses_an_empty_side_and_a_fold_that_is_none() -> None:
    with pytest.raises(InputError, match="validation: expected at least one case in fold 0, received none"):
        split(validation=())
    with pytest.raises(InputError, match="fold: expected 0 to 1, received 2"):
        split(fold=2)
    with pytest.raises(InputError, match="folds: expected at least 2, received 1"):
        GroupFolds(1)


def test_what_was_written_is_read(tmp_path) -> None:
    for one in GroupFolds(3)(FRAMES):
        one.write(tmp_path / "split.json")
        assert Split.read(tmp_path / "split.json") == one


@pytest.mark.parametrize("content", [None, "", "[]", '{"fold": 0}', '{"train": 3}'])
def test_refuses_a_file_that_is_no_split(tmp_path, content: str | None) -> None:
    path = tmp_path / "split.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=r"split\.json: expected a split written as JSON"):
        Split.read(path)


def test_frames_of_a_side_and_a_case_that_is_not_there() -> None:
    one = GroupFolds(3)(FRAMES)[1]
    assert one.of(FRAMES, "test").case_ids == one.test
    with pytest.raises(InputError, match="split: expected cases of the data set, received 'case"):
        one.of(FRAMES.subset(range(3)), "train")
