"""Nothing half-written stands under a final name."""

from __future__ import annotations

from pathlib import Path

import pytest

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
