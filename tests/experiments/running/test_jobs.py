"""Refusals of a job name the setting, not the file alone."""

from __future__ import annotations

from pathlib import Path

import pytest

import registration.errors
from experiments.cli import main
from experiments.errors import InputError
from experiments.running.jobs import naming_settings

CONFIG = {"study": "register", "moving": "~/a.ply", "fixed": "b.ply", "landmarks": None}


@pytest.mark.parametrize(
    "said, then",
    [
        ("b.ply: expected a file", "fixed: b.ply: expected a file"),
        (f"{Path.home()}/a.ply: expected a file", f"moving: {Path.home()}/a.ply: expected a file"),
        ("b.ply.old: expected a file", "b.ply.old: expected a file"),
        ("fixed: b.ply: expected a file", "fixed: b.ply: expected a file"),
    ],
)
def test_a_refusal_that_begins_with_a_path_begins_with_its_setting(said: str, then: str) -> None:
    with (
        pytest.raises((InputError, registration.errors.InputError)) as refusal,
        naming_settings(CONFIG),
    ):
        raise registration.errors.InputError(said)
    assert str(refusal.value) == then


def test_what_is_no_refusal_passes() -> None:
    with pytest.raises(ZeroDivisionError, match=r"^b\.ply: x$"), naming_settings(CONFIG):
        raise ZeroDivisionError("b.ply: x")


def test_a_missing_file_is_named_with_its_setting_on_the_command_line(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=ct_model", f"input={home / 'none.nii'}"]) == 2
    assert capsys.readouterr().err.startswith(f"input: {home / 'none.nii'}: expected a file")
