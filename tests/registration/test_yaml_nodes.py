"""YAML whose aliases stand for little is read as PyYAML reads it, the rest refused before anything goes over it."""

from __future__ import annotations

import pytest
import yaml

from registration import yaml_nodes
from registration.errors import InputError
from registration.yaml_nodes import LARGEST_YAML_BYTES, load_yaml


def test_plain_yaml_and_honest_aliases() -> None:
    text = "a: &x [1, 2]\nb: *x\nc: {<<: {d: 3}, e: 4}\n"
    content, root = load_yaml(text)
    assert content == yaml.safe_load(text) == {"a": [1, 2], "b": [1, 2], "c": {"d": 3, "e": 4}}
    assert isinstance(root, yaml.MappingNode)
    assert load_yaml("") == (None, None)


def test_many_values_that_are_all_there_are_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml_nodes, "LARGEST_EXPANSION", 1000)
    count = 1010
    content, _ = load_yaml("[" + ",".join("1" * count) + "]")
    assert len(content) == count


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [x]\nb: &b [" + "*a," * 1000 + "]\nc: [" + "*b," * 1000 + "]\n", "aliases stand for at most"),
        ("a: &a {b: *a}\n", "alias of what it stands in"),
        ("[" * 3000, "nested too deep"),
        ("a" * (LARGEST_YAML_BYTES + 1), "YAML of at most"),
    ],
)
def test_what_would_grow_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_yaml(text)


def test_what_does_not_parse_is_left_to_the_caller() -> None:
    with pytest.raises(yaml.YAMLError):
        load_yaml("a: [")
