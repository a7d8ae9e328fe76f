import json
from pathlib import Path

import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.splits.group_splits import GroupSplits
from experiments.splits.nnunet import NnUnetSplits, is_nnunet, to_nnunet
from experiments.splits.split_set import SplitSet

FRAMES = drawn_frames(12, per_group=2)
PATH = Path("splits_final.json")


def read(content: object, **groups: list[str]) -> SplitSet:
    outside = {"selection_groups": [], "test_groups": [], **groups}
    return NnUnetSplits(PATH, content, validation_parts=5, seed=0)(FRAMES, **outside)


def names(*numbers: int) -> list[str]:
    return [f"case{number:02d}" for number in numbers]


def test_validation_is_part_of_nnunets_train() -> None:
    splits = GroupSplits(3)(FRAMES)
    lists = to_nnunet(splits)
    assert [set(one) for one in lists] == [{"train", "val"}] * 3
    for split, given in zip(splits, lists, strict=True):
        assert given["val"] == sorted(split.test)
        assert given["train"] == sorted((*split.train, *split.validation))
    assert is_nnunet(json.loads(json.dumps(lists))) and not is_nnunet({"folds": []})


@pytest.mark.parametrize("seed", [0, 3])
def test_what_was_written_comes_back(seed: int) -> None:
    splits = GroupSplits(3, seed=seed)(FRAMES)
    assert NnUnetSplits(PATH, to_nnunet(splits), 5, seed)(FRAMES, [], []) == splits


def test_groups_outside_all_folds_are_in_no_list() -> None:
    splits = GroupSplits(3)(FRAMES, selection_groups=["sweep1"], test_groups=["sweep4"])
    lists = to_nnunet(splits)
    assert not {"case02", "case03", "case08", "case09"} & {case for one in lists for case in one["train"]}
    assert read(lists, selection_groups=["sweep1"], test_groups=["sweep4"]) == splits
    with pytest.raises(InputError, match=r"every case of the data set, found none for 'case02' \(2 in all\)"):
        read(lists, test_groups=["sweep4"])
    with pytest.raises(InputError, match="expected group 'sweep0' on one side of fold 0, found it in"):
        read(lists, selection_groups=["sweep1"], test_groups=["sweep4", "sweep0"])


def test_refuses_a_group_in_train_and_val_and_in_two_vals() -> None:
    with pytest.raises(
        InputError, match=r"expected group 'sweep0' on one side of fold 0, found it in .* and test"
    ):
        read([{"train": names(*range(1, 12)), "val": names(0)}])
    one = {"train": names(*range(2, 12)), "val": names(0, 1)}
    with pytest.raises(
        InputError, match="group 'sweep0' in one place, found it in test of fold 0 and test of fold 1"
    ):
        read([one, one])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([{"train": names(*range(2, 12))}], "expected a list of cases as val of fold 0, received None"),
        ([[]], "expected a list of cases as train of fold 0"),
        ([{"train": [3], "val": names(0)}], "expected a list of cases as train of fold 0"),
        ([{"train": [], "val": names(0, 1)}], "expected cases under train in fold 0, received none"),
        (
            [{"train": ["who"], "val": names(0)}],
            "expected only cases of the data set in fold 0, received 'who'",
        ),
        ([], "expected at least one fold, received none"),
    ],
)
def test_refuses_other_content(content: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(content)
