"""Digests kept by path, size and time: a large data set is read once, and a changed file again."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from experiments import files
from experiments.running import digest_cache
from experiments.running.digest_cache import DigestCache


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the files that are really read."""
    names: list[str] = []
    real = files.digest

    def digest(path: Path) -> str:
        names.append(path.name)
        return real(path)

    monkeypatch.setattr(files, "digest", digest)
    return names


def digest(path: Path) -> str:
    with DigestCache() as cache:
        return cache.digest(path)


def test_a_file_is_read_again_only_when_it_has_changed(
    home: Path, read: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(digest_cache, "SETTLED_S", -1.0)
    path = home / "a.png"
    path.write_bytes(b"one")
    first = digest(path)
    assert digest(path) == first
    assert read == ["a.png"]
    path.write_bytes(b"two")
    assert digest(path) != first
    assert read == ["a.png"] * 2


def test_a_file_that_has_just_changed_is_not_trusted(home: Path, read: list[str]) -> None:
    path = home / "a.png"
    path.write_bytes(b"one")
    old = time.time() - 3600
    os.utime(path, (old, old))  # as a copy that keeps the times: only the change of the entry is new
    digest(path)
    digest(path)
    assert read == ["a.png"] * 2


def test_nothing_is_made_where_nothing_is_kept(home: Path) -> None:
    with DigestCache(), pytest.raises(FileNotFoundError):
        digest(home / "missing.png")
    path = home / "a.png"
    path.write_bytes(b"one")
    digest(path)  # it has just changed
    assert not (home / ".cache").exists()


def test_without_a_place_for_the_cache_all_is_read(home: Path, read: list[str]) -> None:
    (home / ".cache").write_text("a file where a folder belongs")
    (home / "a.png").write_bytes(b"one")
    assert digest(home / "a.png") == digest(home / "a.png")
    assert read == ["a.png"] * 2


def test_a_damaged_cache_is_no_failure(home: Path, read: list[str]) -> None:
    (home / ".cache").mkdir()
    (home / ".cache" / "digests.db").write_bytes(b"no database" * 100)
    (home / "a.png").write_bytes(b"one")
    assert digest(home / "a.png") == files.digest(home / "a.png")
