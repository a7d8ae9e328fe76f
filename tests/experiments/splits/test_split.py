import json

import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.splits.split import Split


def split(**changes: object) -> Split:
    fields = {
        "fold": 0,
        "folds": 2,
        "train": ("a",),
        "validation": ("b",),
        "test": ("c",),
        "groups": {"a": "1", "b": "2", "c": "3", "d": "4"},
    }
    return Split(**{**fields, **changes})


def test_refuses_a_group_on_two_sides() -> None:
    with pytest.raises(
        InputError, match="expected group '1' on one side of fold 0, found it in train and test"
    ):
        split(groups={"a": "1", "b": "2", "c": "1"})


@pytest.mark.parametrize("outside", ["selection", "held_out"])
def test_refuses_a_group_of_a_fold_outside_of_it(outside: str) -> None:
    assert getattr(split(**{outside: ("d",)}), outside) == ("d",)
    with pytest.raises(
        InputError,
        match=f"group '2' on one side of fold 0 of outer fold 3, found it in validation and {outside}",
    ):
        split(**{outside: ("d",)}, groups={"a": "1", "b": "2", "c": "3", "d": "2"}, outer_fold=3)


def test_refuses_an_empty_side_and_a_fold_that_is_none() -> None:
    with pytest.raises(InputError, match="validation: expected at least one case in fold 0, received none"):
        split(validation=())
    with pytest.raises(InputError, match="train: expected each case once in fold 0, received one twice"):
        split(train=("a", "a"))
    with pytest.raises(InputError, match="fold: expected 0 to 1, received 2"):
        split(fold=2)


def test_the_frames_of_a_side() -> None:
    frames = drawn_frames(4, per_group=1)
    groups = dict(zip(frames.case_ids, frames.groups, strict=True))
    one = split(
        train=("case01",), validation=("case00",), test=("case03",), held_out=("case02",), groups=groups
    )
    assert one.of(frames, "test").case_ids == ("case03",)
    assert one.of(frames, "held_out").groups == ("sweep2",)
    assert len(one.of(frames, "selection")) == 0
    assert dict(one.sides()) == {
        "case01": "train",
        "case00": "validation",
        "case03": "test",
        "case02": "held_out",
    }
    with pytest.raises(InputError, match="split: expected cases of the data set, received 'case03'"):
        one.of(frames.subset(range(3)), "test")


def test_what_was_written_is_read(tmp_path) -> None:
    one = split(selection=("d",), outer_fold=1)
    one.write(tmp_path / "split.json")
    assert Split.read(tmp_path / "split.json") == one


def test_a_file_with_a_byte_order_mark_is_read(tmp_path) -> None:
    split().write(tmp_path / "split.json")
    (tmp_path / "marked.json").write_bytes((tmp_path / "split.json").read_text().encode("utf-8-sig"))
    assert Split.read(tmp_path / "marked.json") == split()


def test_a_file_without_groups_outside_the_folds_is_read(tmp_path) -> None:
    path = tmp_path / "split.json"
    split().write(path)
    content = json.loads(path.read_text())
    for name in ("selection", "held_out", "outer_fold"):
        del content[name]
    path.write_text(json.dumps(content))
    assert Split.read(path) == split()


@pytest.mark.parametrize("content", [None, "", "[]", '{"fold": 0}', '{"train": 3}', "\xff"])
def test_refuses_a_file_that_is_no_split(tmp_path, content: str | None) -> None:
    path = tmp_path / "split.json"
    if content is not None:
        path.write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match=r"split\.json: expected (a split written as JSON|a file|text)"):
        Split.read(path)
