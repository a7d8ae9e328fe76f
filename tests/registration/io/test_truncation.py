"""Files that the user names."""

from __future__ import annotations

from pathlib import Path

import pytest

from registration.errors import InputError
from registration.io.truncation import read_bytes, require_file


def test_a_file_that_is_there(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("")
    assert require_file(tmp_path / "a.ply") == tmp_path / "a.ply"


def test_folders_and_nothing_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file, received a folder"):
        require_file(tmp_path)
    with pytest.raises(InputError, match=r"none\.ply: expected a file, received nothing there"):
        require_file(tmp_path / "none.ply")


def test_content_is_read_whole_or_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").write_bytes(b"NRRD\x00")
    assert read_bytes(tmp_path / "a.nrrd") == b"NRRD\x00"
    with pytest.raises(InputError, match=r"none\.nrrd: expected"):
        read_bytes(tmp_path / "none.nrrd")
