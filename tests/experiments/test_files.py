"""Writing beside and renaming."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.files import atomic_write, digest, staged, write_text


def test_a_failed_write_leaves_the_old_file_and_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as beside:
        beside.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_name_beside_keeps_the_suffix(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "cloud.ply") as beside:
        assert beside.suffix == ".ply"
        beside.write_text("x")
    assert (tmp_path / "cloud.ply").read_text() == "x"


def test_a_staged_folder_appears_whole_and_keeps_other_files(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "mine.txt").write_text("mine")
    (folder / "result.txt").write_text("old")
    with staged(folder) as stage:
        (stage / "deep").mkdir()
        (stage / "deep" / "new.txt").write_text("new")
        (stage / "result.txt").write_text("new")
        assert (folder / "result.txt").read_text() == "old"
    assert (folder / "deep" / "mine.txt").read_text() == "mine"
    assert (folder / "deep" / "new.txt").read_text() == "new"
    assert (folder / "result.txt").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def test_a_failed_stage_changes_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), staged(tmp_path / "out") as stage:
        (stage / "half.txt").write_text("half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_digest_is_sha256(tmp_path: Path) -> None:
    (tmp_path / "abc").write_text("abc")
    # The test vector of FIPS 180-2, appendix B.1.
    assert digest(tmp_path / "abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
