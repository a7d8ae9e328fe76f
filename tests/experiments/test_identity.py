"""The hash that tells one job from another."""

from __future__ import annotations

from pathlib import Path

from experiments.identity import config_hash, flatten

BASE = {"study": "robustness", "trials": 60, "rigid": {"starts": 24}, "target": "nowhere.stl"}


def test_the_hash_depends_on_what_is_computed() -> None:
    assert config_hash(BASE) != config_hash({**BASE, "trials": 61})
    assert config_hash(BASE) != config_hash({**BASE, "rigid": {"starts": 25}})
    assert config_hash(BASE) != config_hash({**BASE, "seed": 0})
    assert config_hash({"seed": 0}) != config_hash({"seed": None})
    assert config_hash({"align": True}) != config_hash({"align": 1})


def test_the_hash_does_not_depend_on_how_it_is_run_or_written() -> None:
    assert config_hash(BASE) == config_hash(dict(reversed(list(BASE.items()))))
    assert config_hash(BASE) == config_hash({**BASE, "trials": 60.0})
    for key in ("tracking", "resume", "out", "workers"):
        assert config_hash(BASE) == config_hash({**BASE, key: "anything"})
    for key in ("cache", "resume", "workers"):
        assert config_hash({"dataset": {key: 1}}) == config_hash({"dataset": {key: 2}})
    assert config_hash({"dataset": {"seed": 1}}) != config_hash({"dataset": {"seed": 2}})


def test_a_file_that_changes_under_its_name_is_another_job(tmp_path: Path) -> None:
    path = tmp_path / "target.stl"
    config = {"parts": [{"target": str(path)}]}
    absent = config_hash(config)
    path.write_text("one")
    first = config_hash(config)
    path.write_text("two")
    assert len({absent, first, config_hash(config)}) == 3


def test_flat_parameters_are_dotted() -> None:
    assert flatten({"a": {"b": {"c": 1}, "d": {}}, "e": [1, 2]}) == {"a.b.c": 1, "a.d": {}, "e": [1, 2]}
