"""The hash that tells one job from another."""

from __future__ import annotations

from experiments.running.config_hash import config_hash
from experiments.tracking.names import flatten

BASE = {"study": "robustness", "trials": 60, "rigid": {"starts": 24}, "target": "nowhere.stl"}


def test_the_hash_depends_on_what_is_computed() -> None:
    assert config_hash(BASE, {}) != config_hash({**BASE, "trials": 61}, {})
    assert config_hash(BASE, {}) != config_hash({**BASE, "rigid": {"starts": 25}}, {})
    assert config_hash(BASE, {}) != config_hash({**BASE, "seed": 0}, {})
    assert config_hash({"seed": 0}, {}) != config_hash({"seed": None}, {})
    assert config_hash({"align": True}, {}) != config_hash({"align": 1}, {})


def test_the_hash_does_not_depend_on_how_it_is_run_or_written() -> None:
    assert config_hash(BASE, {}) == config_hash(dict(reversed(list(BASE.items()))), {})
    assert config_hash(BASE, {}) == config_hash({**BASE, "trials": 60.0}, {})
    for key in ("tracking", "resume", "out", "workers"):
        assert config_hash(BASE, {}) == config_hash({**BASE, key: "anything"}, {})
    for key in ("cache", "resume", "workers"):
        assert config_hash({"dataset": {key: 1}}, {}) == config_hash({"dataset": {key: 2}}, {})
    assert config_hash({"dataset": {"seed": 1}}, {}) != config_hash({"dataset": {"seed": 2}}, {})


def test_other_contents_are_another_job() -> None:
    seen = {
        config_hash(BASE, contents)
        for contents in ({}, {"a": "1"}, {"a": "2"}, {"b": "1"}, {"a": "1", "b": "1"})
    }
    assert len(seen) == 5
    assert config_hash(BASE, {"a": "1", "b": "2"}) == config_hash(BASE, {"b": "2", "a": "1"})


def test_flat_parameters_are_dotted() -> None:
    assert flatten({"a": {"b": {"c": 1}, "d": {}}, "e": [1, 2]}) == {"a.b.c": 1, "a.d": {}, "e": [1, 2]}
