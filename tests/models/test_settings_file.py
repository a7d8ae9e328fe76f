"""Settings in YAML by the rules of version 1.2."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml

from models.errors import InputError
from models.settings_file import parse_settings, read_settings


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1E5", 1e5),
        ("-2.5e+3", -2500.0),
        (".5", 0.5),
        ("4", 4),
        ("-4", -4),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("1_0", "1_0"),
        ("1:30", "1:30"),
        ("no", "no"),
        ("on", "on"),
        ("true", True),
        ("~", None),
        ("null", None),
        ("'010'", "010"),
        ("2020-01-01", "2020-01-01"),
        (".inf", math.inf),
        ("1.10", 1.1),
        ("[1e-3, x]", [0.001, "x"]),
    ],
)
def test_a_plain_value_is_what_version_1_2_says(text: str, value: object) -> None:
    found = parse_settings(f"key: {text}")["key"]
    assert found == value and type(found) is type(value)


def test_a_tag_runs_nothing() -> None:
    with pytest.raises(yaml.YAMLError):
        parse_settings("!!python/object/apply:os.system ['true']")


def test_merge_keys_still_merge() -> None:
    assert parse_settings("a: &a {x: 1}\nb: {<<: *a, y: 2}")["b"] == {"x": 1, "y": 2}


def test_the_safe_loader_itself_is_left_as_it_was() -> None:
    parse_settings("a: 1e-3")
    assert yaml.safe_load("a: no") == {"a": False}


@pytest.mark.parametrize("text", ["- 1\n", "a: [1\n"])
def test_what_is_no_mapping_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(InputError, match=r"c\.yaml: expected a YAML"):
        read_settings(tmp_path / "c.yaml")


def test_a_setting_given_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text("seed: 1\nmodel: unet\nseed: 2\n")
    with pytest.raises(InputError, match=r"settings\.yaml: expected each setting once, received seed twice"):
        read_settings(path)
