import dataclasses
import json

import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from experiments.splits.split_set import SplitSet

# Six cases in six groups; the first fold tests a, the second b.
GROUPS = {name: name.upper() for name in "abcdef"}


def fold(number: int, test: str, rest: str, **changes: object) -> Split:
    fields = {
        "fold": number,
        "folds": 2,
        "train": tuple(rest[1:]),
        "validation": (rest[0],),
        "test": tuple(test),
        "groups": GROUPS,
    }
    return Split(**{**fields, **changes})


def test_folds_are_found_by_number() -> None:
    splits = SplitSet((fold(0, "a", "bcde"), fold(1, "b", "acde")))
    assert splits.fold(1).test == ("b",) and len(splits) == 2
    assert splits.pairs() == ((None, 0), (None, 1))
    with pytest.raises(InputError, match=r"fold: expected one of .*\(None, 1\)\], received \(None, 2\)"):
        splits.fold(2)
    nested = SplitSet(tuple(dataclasses.replace(one, outer_fold=7) for one in splits))
    assert nested.fold(0, 7).test == ("a",)
    assert nested.of_outer_fold(7) == nested
    with pytest.raises(InputError, match="outer_fold: expected one of 7, received None"):
        nested.of_outer_fold(None)
    with pytest.raises(InputError, match="outer_fold: expected null, as folds are not nested, received 0"):
        splits.of_outer_fold(0)


@pytest.mark.parametrize(
    ("splits", "message"),
    [
        ((), "expected at least one fold, received none"),
        ((fold(0, "a", "bcd"), fold(0, "b", "acd")), "expected each fold once"),
        (
            (fold(0, "a", "bcd"), fold(1, "ab", "cd")),
            "group 'A' in one place, found it in test of fold 0 and test of fold 1",
        ),
        (
            (fold(0, "a", "bcd", held_out=("e",)), fold(1, "b", "ade")),
            "group 'E' in one place, found it in held_out and the folds",
        ),
        (
            (fold(0, "a", "bcd", held_out=("e",)), fold(1, "b", "acd", selection=("e",))),
            "group 'E' in one place, found it in held_out and selection",
        ),
        (
            (
                fold(0, "a", "bcd", held_out=("e",), outer_fold=0),
                fold(0, "a", "bcd", held_out=("e",), outer_fold=1),
            ),
            "group 'E' in one place, found it in held_out of outer fold 0 and held_out of outer fold 1",
        ),
        (
            (fold(0, "a", "bcd"), fold(1, "b", "acd", groups={**GROUPS, "f": "A"})),
            "expected the same groups in all folds",
        ),
    ],
)
def test_refuses_folds_that_leak_into_each_other(splits: tuple[Split, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SplitSet(splits)


def test_a_case_of_the_same_group_in_two_folds_is_found() -> None:
    with pytest.raises(
        InputError, match="group 'A' in one place, found it in test of fold 0 and test of fold 1"
    ):
        SplitSet(
            (
                fold(0, "a", "cde", groups={**GROUPS, "b": "A"}),
                fold(1, "b", "cde", groups={**GROUPS, "b": "A"}),
            )
        )


def test_written_and_read_folds_are_the_same(tmp_path) -> None:
    frames = drawn_frames(36, per_group=3)
    for recipe in (
        GroupSplits(3),
        GroupSplits(2, selection_share=0.2, test_share=0.2),
        GroupSplits(2, outer_folds=3),
    ):
        splits = recipe(frames)
        splits.write(tmp_path / "splits.json")
        assert SplitSet.read(tmp_path / "splits.json") == splits
        assert GroupSplits(file=str(tmp_path / "splits.json"))(frames) == splits
        assert GroupSplits(file=str(tmp_path / "splits.json")).pairs() == recipe.pairs()


@pytest.mark.parametrize(
    "content", ["[]", "3", "{}", '{"groups": {}, "folds": [{"fold": 0}]}', '{"fold": 0}']
)
def test_refuses_a_file_that_holds_no_folds(tmp_path, content: str) -> None:
    (tmp_path / "splits.json").write_text(content)
    with pytest.raises(
        InputError,
        match=r"splits\.json: expected a file of all folds, received a file that can't be read as one",
    ):
        SplitSet.read(tmp_path / "splits.json")


def test_refuses_a_file_whose_folds_leak(tmp_path) -> None:
    path = tmp_path / "splits.json"
    SplitSet((fold(0, "a", "bcde"), fold(1, "b", "acde"))).write(path)
    content = json.loads(path.read_text())
    content["groups"]["c"] = "A"
    path.write_text(json.dumps(content))
    with pytest.raises(
        InputError, match="expected group 'A' on one side of fold 0, found it in train and test"
    ):
        SplitSet.read(path)


def test_the_data_sets_cases_and_groups_decide() -> None:
    frames = drawn_frames(12, per_group=3)
    splits = GroupSplits(2)(frames)
    assert splits.for_frames(frames) == splits
    with pytest.raises(InputError, match=r"expected only cases of the data set in fold 0, received 'case11'"):
        splits.for_frames(frames.subset(range(11)))
    with pytest.raises(InputError, match=r"every case of the data set, found none for 'case12' \(3 in all\)"):
        splits.for_frames(drawn_frames(15, per_group=3))
    other = dataclasses.replace(frames, groups=tuple(f"p{index % 4}" for index in range(12)))
    with pytest.raises(InputError, match=r"expected group 'p\d' on one side of fold 0, found it in"):
        splits.for_frames(other)


def test_renamed_cases_stay_where_they_are() -> None:
    splits = SplitSet((fold(0, "a", "bcde", held_out=("f",)), fold(1, "b", "acde", held_out=("f",))))
    renamed = splits.renamed({name: f"x{name}" for name in GROUPS})
    assert renamed.fold(0).train == ("xc", "xd", "xe") and renamed.fold(1).held_out == ("xf",)
    assert renamed.fold(0).groups["xa"] == "A"
