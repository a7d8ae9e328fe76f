"""Names and paths are what the user wrote, on the command line and in files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from experiments.cli import compose_sweep
from experiments.command_line.text_settings import TEXT, is_text, loader_with_text, quoted_override
from experiments.errors import InputError
from experiments.splits.group_splits import GroupSplits

NAMES = [
    "1.10",
    "1_0",
    "010",
    "1:30",
    "null",
    "yes",
    "1e3",
    "0x10",
    "-5",
    ".5",
    "+5",
    "true",
    "nan",
    "2024-01-01",
]


def composed(*overrides: str, **more: Any) -> dict[str, Any]:
    ((config, _),) = compose_sweep(["study=inspect_dataset", *overrides], **more)
    return dict(config)


@pytest.mark.parametrize("name", NAMES)
def test_a_group_is_held_out_by_the_name_on_the_command_line(name: str) -> None:
    config = composed(
        "dataset=usgra", f"split.test_groups=[{name}]", f"split.selection_groups=[a, {name} ,'b c']"
    )
    assert config["split"]["test_groups"] == [name]
    assert config["split"]["selection_groups"] == ["a", name, "b c"]


@pytest.mark.parametrize("name", NAMES)
def test_a_group_is_held_out_by_the_name_in_a_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "split").mkdir()
    (tmp_path / "split" / "mine.yaml").write_text(
        "_target_: experiments.splits.group_splits.GroupSplits\nfolds: 010\n"
        f"test_groups: [{name}]\nselection_groups:\n  - {name}_\n  - 'a'\n"
    )
    split = composed("dataset=usgra", "split=mine", config_dir=str(tmp_path))["split"]
    assert split["test_groups"] == [name]
    assert split["selection_groups"] == [f"{name}_", "a"]
    # What is no name stays what YAML makes of it.
    assert split["folds"] == 8


def test_names_and_paths_of_one_value_are_text_and_null_is_none(tmp_path: Path) -> None:
    config = composed("dataset=san_raffaele", "dataset.session=1_0", "dataset.root=2024_01", "out=1e3")
    assert (config["dataset"]["session"], config["dataset"]["root"], config["out"]) == (
        "1_0",
        "2024_01",
        "1e3",
    )
    assert composed("dataset=san_raffaele", "dataset.session=null")["dataset"]["session"] is None
    (tmp_path / "preset").mkdir()
    (tmp_path / "preset" / "mine.yaml").write_text(
        "# @package _global_\ndataset:\n  session: null\n  root: 010\n"
    )
    config = composed("dataset=san_raffaele", "+preset=mine", config_dir=str(tmp_path))
    assert (config["dataset"]["session"], config["dataset"]["root"]) == (None, "010")


def test_a_sweep_over_names_keeps_them_apart() -> None:
    points = compose_sweep(
        [
            "study=inspect_dataset",
            "dataset=san_raffaele",
            "dataset.session=1.10,1.1",
            "split.test_groups=[1_0],[10]",
        ],
        multirun=True,
    )
    found = {(config["dataset"]["session"], *config["split"]["test_groups"]) for config, _ in points}
    assert found == {("1.10", "1_0"), ("1.10", "10"), ("1.1", "1_0"), ("1.1", "10")}


@pytest.mark.parametrize(
    ("override", "quoted"),
    [
        ("split.test_groups=[1.10,a]", "split.test_groups=['1.10',a]"),
        ('split.test_groups=[10 b,"1.0"]', 'split.test_groups=[10 b,"1.0"]'),
        ("dataset.session=choice(1.10,2)", "dataset.session=choice('1.10','2')"),
        ("dataset.session=range(1,3)", "dataset.session=range(1,3)"),
        ("dataset.root=${oc.env:HOME}", "dataset.root=${oc.env:HOME}"),
        ("++split={test_groups:[1.10],folds:3}", "++split={test_groups:['1.10'],folds:3}"),
        ("split.folds=10", "split.folds=10"),
        ("dataset.substitute.subjects=10", "dataset.substitute.subjects=10"),
        ("~out", "~out"),
    ],
)
def test_only_names_and_paths_are_quoted_and_once(override: str, quoted: str) -> None:
    assert quoted_override(override) == quoted == quoted_override(quoted)


def test_a_number_that_may_have_been_another_name_is_refused_in_python() -> None:
    assert GroupSplits(test_groups=[8, "a"]).test_groups == ("8", "a")
    for wrong in (1.1, None, True):
        with pytest.raises(InputError, match="test_groups: expected names as text, received"):
            GroupSplits(test_groups=[wrong])  # type: ignore[list-item]
    with pytest.raises(InputError, match="test_groups: expected a list of names, received 'a'"):
        GroupSplits(test_groups="a")


def settings_of(node: yaml.Node) -> Iterator[tuple[str, yaml.Node]]:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield str(key.value), value
            yield from settings_of(value)


def test_no_setting_that_is_a_number_goes_by_such_a_name(repository: Path) -> None:
    """The last part of a dotted name decides: a count under a name of this list would become text."""
    found = 0
    for path in sorted((repository / "conf").rglob("*.yaml")):
        for key, value in settings_of(yaml.compose(path.read_text(encoding="utf-8"))):
            if is_text(key) and isinstance(value, yaml.ScalarNode):
                found += 1
                assert value.tag in ("tag:yaml.org,2002:str", "tag:yaml.org,2002:null"), (path, key)
    assert found > 50


def test_the_loader_leaves_all_else_alone() -> None:
    text = "out: 1\nother: {out: [1, null], seed: 1}\nseed: 010\n"
    assert yaml.load(text, Loader=loader_with_text(yaml.SafeLoader)) == {
        "out": "1",
        "other": {"out": ["1", "null"], "seed": 1},
        "seed": 8,
    }
    assert "out" in TEXT
