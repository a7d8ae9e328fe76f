import dataclasses
import json

import numpy as np
import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.splits.group_partition import area_classes
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import FOLD_SIDES, OUTSIDE, Split
from models.labelled_frames import LabelledFrames

FRAMES = drawn_frames(60, per_group=3, empty=9)


def with_groups(frames: LabelledFrames, groups: list[str]) -> LabelledFrames:
    return dataclasses.replace(frames, groups=tuple(groups))


def groups_on(split: Split, side: str) -> set[str]:
    return {split.groups[case] for case in getattr(split, side)}


@pytest.mark.parametrize("folds", [2, 3, 5])
def test_every_case_is_tested_once_and_no_group_is_on_two_sides(folds: int) -> None:
    splits = GroupSplits(folds)(FRAMES)
    assert [split.fold for split in splits] == list(range(folds))
    assert sorted(case for split in splits for case in split.test) == sorted(FRAMES.case_ids)
    for split in splits:
        sides = [groups_on(split, side) for side in FOLD_SIDES]
        assert all(sides) and split.selection == split.held_out == ()
        assert not (sides[0] & sides[1] or sides[0] & sides[2] or sides[1] & sides[2])
        assert len(split.train) + len(split.validation) + len(split.test) == len(FRAMES)
        assert len(split.train) > len(split.validation)


def test_groups_of_unequal_size_stay_whole_and_folds_stay_alike() -> None:
    sizes = [12, 1, 1, 7, 3, 3, 3, 2, 8, 5, 4, 6, 5]
    groups = [f"g{number}" for number, size in enumerate(sizes) for _ in range(size)]
    splits = GroupSplits(3)(with_groups(FRAMES, groups))
    assert all(16 <= len(split.test) <= 24 for split in splits)
    for group in set(groups):
        assert sum(group in groups_on(split, "test") for split in splits) == 1


def test_equal_groups_are_divided_equally_however_unlike() -> None:
    frames = drawn_frames(60, per_group=10)
    order = np.argsort([mask.sum() for mask in frames.masks])
    frames = with_groups(frames.subset(order), [f"g{index // 10}" for index in range(60)])
    for seed in range(5):
        assert [len(split.test) for split in GroupSplits(3, seed=seed)(frames)] == [20, 20, 20]
        assert {len(split.validation) for split in GroupSplits(3, seed=seed)(frames)} == {10}


def test_vessel_areas_are_alike_in_all_folds_and_outside_of_them() -> None:
    # Groups of small and of large vessels: by chance alone a third could be nearly all of one kind.
    frames = drawn_frames(90, per_group=3)
    order = np.argsort([mask.sum() for mask in frames.masks])
    frames = with_groups(frames.subset(order), [f"g{index // 3}" for index in range(90)])
    kind = dict(zip(frames.case_ids, area_classes(frames), strict=True))
    for seed in range(4):
        for wanted in (1, 2, 3, 4):
            counts = [
                sum(kind[case] == wanted for case in split.test)
                for split in GroupSplits(3, seed=seed)(frames)
            ]
            assert max(counts) - min(counts) <= 5  # a group is 3 cases; chance would differ by 9 and more
        held_out = GroupSplits(3, seed=seed, test_share=0.4)(frames).fold(0).held_out
        assert all(6 <= sum(kind[case] == wanted for case in held_out) <= 12 for wanted in (1, 2, 3, 4))


def test_the_seed_decides() -> None:
    first, same, other = (GroupSplits(3, seed=seed, test_share=0.3)(FRAMES) for seed in (0, 0, 1))
    assert first == same and first != other
    assert first.fold(0).held_out != other.fold(0).held_out


def test_as_many_groups_as_folds_are_enough_if_one_can_validate() -> None:
    frames = with_groups(FRAMES, [f"g{index % 3}" for index in range(60)])
    for split in GroupSplits(3)(frames):
        assert (len(split.train), len(split.validation), len(split.test)) == (20, 20, 20)


@pytest.mark.parametrize(("folds", "groups", "least"), [(3, 2, 3), (5, 4, 5), (2, 2, 3)])
def test_refuses_fewer_groups_than_folds(folds: int, groups: int, least: int) -> None:
    frames = with_groups(FRAMES, [f"g{index % groups}" for index in range(60)])
    with pytest.raises(InputError, match=f"folds: expected at least {least} groups .* received {groups}"):
        GroupSplits(folds)(frames)


def test_no_part_is_empty_however_unlike_the_groups() -> None:
    # Few groups that are each all of one kind are what stratifying alone stumbles over.
    for seed in range(10):
        for split in GroupSplits(4, seed=seed)(drawn_frames(40, per_group=10, empty=20, seed=seed)):
            assert split.train and split.validation and split.test


def test_a_few_cases_in_as_many_groups_are_divided_all_the_same() -> None:
    for one in GroupSplits(3)(drawn_frames(6, per_group=1)):
        assert len(one.test) == 2 and len(one.validation) == 1 and len(one.train) == 3


def test_shares_stay_outside_all_folds() -> None:
    # 20 groups of 3 cases: 4 of them to select, 6 to test, 10 for the folds.
    splits = GroupSplits(5, selection_share=0.2, test_share=0.3)(FRAMES)
    for split in splits:
        assert (len(groups_on(split, "selection")), len(groups_on(split, "held_out"))) == (4, 6)
        assert split.selection == splits.fold(0).selection and split.held_out == splits.fold(0).held_out
        assert len(list(split.sides())) == 60
    assert len({case for split in splits for case in split.test}) == 30
    alone = GroupSplits(5, selection_share=0.2)(FRAMES).fold(0)
    assert len(groups_on(alone, "selection")) == 4 and not alone.held_out


def test_named_groups_stay_outside_all_folds() -> None:
    for splits in (
        GroupSplits(3, selection_groups=["sweep3"], test_groups=["sweep1", "sweep0"])(FRAMES),
        GroupSplits(3)(FRAMES, selection_groups=["sweep3"], test_groups=["sweep1", "sweep0"]),
    ):
        for split in splits:
            assert groups_on(split, "selection") == {"sweep3"}
            assert groups_on(split, "held_out") == {"sweep0", "sweep1"}
    beside = GroupSplits(3, selection_share=0.2, test_groups=["sweep1"])(FRAMES).fold(0)
    assert groups_on(beside, "held_out") == {"sweep1"} and "sweep1" not in groups_on(beside, "selection")


def test_a_name_that_looks_like_a_number_is_a_name() -> None:
    frames = with_groups(FRAMES, [str(index % 6) for index in range(60)])
    assert groups_on(GroupSplits(3, test_groups=[2])(frames).fold(0), "held_out") == {"2"}


def test_every_group_is_the_test_of_one_outer_fold() -> None:
    recipe = GroupSplits(3, outer_folds=4, selection_share=0.2)
    splits = recipe(FRAMES)
    assert splits.pairs() == recipe.pairs() == tuple((outer, fold) for outer in range(4) for fold in range(3))
    held_out = [groups_on(splits.fold(0, outer), "held_out") for outer in range(4)]
    assert sorted(group for groups in held_out for group in groups) == sorted(set(FRAMES.groups))
    for outer in range(4):
        inner = [splits.fold(fold, outer) for fold in range(3)]
        assert {split.held_out for split in inner} == {inner[0].held_out}
        assert {split.selection for split in inner} == {inner[0].selection} and inner[0].selection
        tested = [case for split in inner for case in split.test]
        outside = {*inner[0].held_out, *inner[0].selection}
        assert sorted(tested) == sorted(set(FRAMES.case_ids) - outside)
        for split in inner:
            assert split.train and split.validation and len(list(split.sides())) == 60


def test_few_groups_are_enough_for_nested_folds_or_refused() -> None:
    frames = with_groups(FRAMES, [f"g{index % 5}" for index in range(60)])
    for split in GroupSplits(3, outer_folds=5)(frames):
        # Four groups are left for the folds: two or one to test, one to validate, the rest to train.
        assert [len(groups_on(split, side)) for side in (*FOLD_SIDES, *OUTSIDE)] in (
            [1, 1, 2, 0, 1],
            [2, 1, 1, 0, 1],
        )
    with pytest.raises(InputError, match=r"outer_folds: expected at least 6 groups .* received 5"):
        GroupSplits(3, outer_folds=6)(frames)
    with pytest.raises(
        InputError, match=r"folds: expected at least 4 groups .* within outer fold 0, received 3"
    ):
        GroupSplits(4, outer_folds=2)(frames)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"folds": 1}, "folds: expected a whole number of at least 2, received 1"),
        ({"folds": True}, "folds: expected a whole number of at least 2, received True"),
        ({"outer_folds": 1}, "outer_folds: expected a whole number of at least 2, received 1"),
        ({"validation_parts": 0}, "validation_parts: expected a whole number of at least 2, received 0"),
        ({"test_share": 1.0}, "test_share: expected 0 to below 1, received 1"),
        ({"selection_share": -0.1}, "selection_share: expected 0 to below 1, received -0.1"),
        ({"selection_share": 0.5, "test_share": 0.5}, "test_share: expected less than 0.5 together with"),
        (
            {"test_share": 0.1, "test_groups": ["a"]},
            "test_share: expected 0 together with test_groups, received 0.1",
        ),
        (
            {"outer_folds": 3, "test_share": 0.1},
            "outer_folds: expected null together with test_share or test_groups",
        ),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        GroupSplits(**settings)


def test_refuses_groups_that_are_not_there_or_in_two_roles() -> None:
    with pytest.raises(InputError, match="test_groups: expected groups of the data set, received 'nobody'"):
        GroupSplits(3, test_groups=["nobody"])(FRAMES)
    with pytest.raises(InputError, match="test_groups: expected none of selection_groups, received 'sweep1'"):
        GroupSplits(3, test_groups=["sweep1"])(FRAMES, selection_groups=["sweep1"])
    with pytest.raises(InputError, match=r"a data set that keeps groups for the test itself \(sweep1\)"):
        GroupSplits(3, outer_folds=3)(FRAMES, test_groups=["sweep1"])
    with pytest.raises(InputError, match=r"expected at least 3 groups .* received 2 "):
        GroupSplits(3, test_groups=[f"sweep{index}" for index in range(18)])(FRAMES)


def test_the_jobs_are_known_from_the_configuration_alone() -> None:
    assert GroupSplits(3).pairs() == ((None, 0), (None, 1), (None, 2))
    assert GroupSplits(2, outer_folds=2).pairs() == ((0, 0), (0, 1), (1, 0), (1, 1))


def test_nnunets_file_gives_its_folds(tmp_path) -> None:
    frames = drawn_frames(12, per_group=3)
    path = tmp_path / "splits_final.json"
    cases = [[f"case{index:02d}" for index in range(start, start + 3)] for start in range(0, 12, 3)]
    lists = [
        {"train": [*cases[1], *cases[2], *cases[3]], "val": cases[0]},
        {"train": [*cases[0], *cases[2], *cases[3]], "val": cases[1]},
    ]
    path.write_text(json.dumps(lists))
    recipe = GroupSplits(5, file=str(path))
    assert recipe.pairs() == ((None, 0), (None, 1))
    splits = recipe(frames)
    for split, given in zip(splits, lists, strict=True):
        assert sorted(split.test) == given["val"]
        assert sorted((*split.train, *split.validation)) == sorted(given["train"])
        assert len(groups_on(split, "validation")) == 1 and len(groups_on(split, "train")) == 2


def test_a_file_must_leave_the_data_sets_test_groups_outside(tmp_path) -> None:
    GroupSplits(3)(FRAMES).write(tmp_path / "splits.json")
    with pytest.raises(
        InputError, match=r"splits\.json: expected groups sweep1 in held_out of fold 0, found one in"
    ):
        GroupSplits(file=str(tmp_path / "splits.json"))(FRAMES, test_groups=["sweep1"])
    right = GroupSplits(3, test_groups=["sweep1"])(FRAMES)
    right.write(tmp_path / "splits.json")
    assert GroupSplits(file=str(tmp_path / "splits.json"))(FRAMES, test_groups=["sweep1"]) == right


def test_refuses_a_file_that_is_not_there(tmp_path) -> None:
    with pytest.raises(InputError, match=r"none\.json: expected a file, received nothing there"):
        GroupSplits(file=str(tmp_path / "none.json")).pairs()
