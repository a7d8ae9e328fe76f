"""Transforms are read in another process first: whole ones pass, what fails or does not end is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io import trial_process
from registration.io.transforms import write_transform


def test_a_whole_transform_passes_and_another_file_under_its_name_is_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "t.h5"
    write_transform(path, np.eye(4))
    trial_process.require_harmless_transform(path)
    path.write_bytes(path.read_bytes()[:200] + bytes(100))
    with pytest.raises(InputError, match=r"t\.h5: expected a complete ITK transform, received a file that"):
        trial_process.require_harmless_transform(path)


@pytest.mark.parametrize(
    ("code", "message"),
    [("while True: pass", "keeps its reader busy"), ("import os; os.abort()", "that crashes")],
)
def test_readers_that_do_not_end_or_crash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    monkeypatch.setattr(trial_process, "_READ_TRANSFORM", code)
    monkeypatch.setattr(trial_process, "TRIAL_S", 0.5)
    path = tmp_path / "t.h5"
    path.write_bytes(code.encode())
    with pytest.raises(InputError, match=message):
        trial_process.require_harmless_transform(path)
