"""Archives whose sums do not fit, or that unpack to far more than they are, are refused."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from models import archives
from models.archives import require_whole_archive


def test_whole_archives_pass(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.arange(100))
    np.savez_compressed(tmp_path / "b.npz", x=np.zeros(100_000))
    require_whole_archive(tmp_path / "a.npz")
    require_whole_archive(tmp_path / "b.npz")


def test_a_changed_byte_is_found_where_numpy_does_not_look(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, x=np.arange(100, dtype=np.uint8))
    data = path.read_bytes()
    at = data.index(bytes(range(40, 60)))
    path.write_bytes(data[:at] + b"\xff" + data[at + 1 :])
    with pytest.raises(zipfile.BadZipFile, match=r"damaged: x\.npy"):
        require_whole_archive(path)


def test_bombs_pipes_and_missing_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(tmp_path / "a.npz", x=np.zeros(1_000_000, np.uint8))
    monkeypatch.setattr(archives, "FREE_BYTES", 1000)
    with pytest.raises(zipfile.BadZipFile, match="bytes when unpacked"):
        require_whole_archive(tmp_path / "a.npz")
    os.mkfifo(tmp_path / "p.npz")
    for name in ("p.npz", "none.npz"):
        with pytest.raises(FileNotFoundError, match="no regular file"):
            require_whole_archive(tmp_path / name)
