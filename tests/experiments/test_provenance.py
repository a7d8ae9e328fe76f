"""What a run says of the code it ran with, wherever its results go."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from experiments import provenance


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=A", "-c", "user.email=a@b.c")
    done = subprocess.run(
        ["git", "-C", str(folder), *who, *words], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository whose only code is a copy of the module, taken for the module itself."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    copy = shutil.copy(provenance.__file__, folder / "provenance.py")
    monkeypatch.setattr(provenance, "__file__", str(copy))
    git(folder, "init", "-q")
    return folder


def test_the_commit_is_that_of_the_code_not_of_the_project_folder(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    git(checkout, "add", ".")
    git(checkout, "commit", "-qm", "one")
    monkeypatch.setenv("CTUS_HOME", str(tmp_path / "elsewhere"))
    tags = provenance.environment_tags()
    assert tags["mlflow.source.git.commit"] == git(checkout, "rev-parse", "HEAD")
    assert tags["ctus.git_dirty"] == "false"
    # What is changed while a process runs is not what it runs.
    (checkout / "new.py").write_text("")
    assert provenance.environment_tags()["ctus.git_dirty"] == "false"
    provenance.git_tags.cache_clear()
    assert provenance.environment_tags()["ctus.git_dirty"] == "true"


def test_a_package_below_somebody_elses_repository_has_no_commit(checkout: Path) -> None:
    (checkout / "theirs.txt").write_text("")
    git(checkout, "add", "theirs.txt")
    git(checkout, "commit", "-qm", "theirs")
    assert "mlflow.source.git.commit" not in provenance.environment_tags()


def test_the_machine_names_its_gpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "nvidia-smi"
    tool.write_text("#!/bin/sh\necho 'NVIDIA A'\necho 'NVIDIA B'\n")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    provenance.gpu_names.cache_clear()
    assert provenance.environment_tags()["ctus.machine"].endswith(" CPUs, NVIDIA A, NVIDIA B")
    tool.write_text("#!/bin/sh\necho 'no driver'\nexit 9\n")
    provenance.gpu_names.cache_clear()
    assert provenance.environment_tags()["ctus.machine"].endswith(" CPUs")
    provenance.gpu_names.cache_clear()


def test_the_running_commit_is_short_and_says_whether_files_had_changed(monkeypatch) -> None:
    monkeypatch.setattr(provenance, "git_tags", lambda code: {})
    assert provenance.running_commit() == ""  # of an installed package
    tags = {provenance.COMMIT_TAG: "0123456789abcdef", "ctus.git_dirty": "true"}
    monkeypatch.setattr(provenance, "git_tags", lambda code: tags)
    assert provenance.running_commit() == "0123456789ab with changes"
