"""Nothing half-written stands under a final name."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from registration.io import atomic
from registration.io.atomic import atomic_folder, write_atomic


def test_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.mha"
    write_atomic(path, b"one")
    write_atomic(path, b"two")
    assert path.read_bytes() == b"two"
    assert [entry.name for entry in path.parent.iterdir()] == ["b.mha"]


def test_failure_leaves_neither_folder_nor_stage(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), atomic_folder(tmp_path / "sweep") as stage:
        (stage / "half").write_text("x")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "sweep").mkdir()
    with atomic_folder(tmp_path / "sweep") as stage:
        (stage / "file").write_text("x")
    assert (tmp_path / "sweep" / "file").read_text() == "x"


def test_what_processes_that_are_gone_have_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    own = atomic.partial_name("a")
    gone = own.replace(str(os.getpid()), str(ended.pid))
    elsewhere = f".a.partial-anotherhost-{ended.pid}"
    (tmp_path / f"{gone}-x1").mkdir()
    (tmp_path / f"{gone}-x1" / "half").write_text("")
    (tmp_path / f"{gone}.csv").write_text("")
    kept = [f"{own}-x2", f"{own}.csv", f"{elsewhere}-x3", "a.csv", ".a", ".a.partial-old"]
    for name in kept:
        (tmp_path / name).write_text("")
    assert atomic.remove_leftovers(tmp_path) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(kept)
    assert atomic.remove_leftovers(tmp_path / "none") == 0


def test_a_folder_that_was_left_half_written_is_gone_when_the_next_is_made(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / f"{atomic.partial_name('out').replace(str(os.getpid()), str(ended.pid))}-abc").mkdir()
    with atomic.atomic_folder(tmp_path / "out") as stage:
        (stage / "x").write_text("")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
