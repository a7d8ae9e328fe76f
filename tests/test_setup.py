"""scripts/setup.sh: which interpreter it takes, and when .venv is made afresh."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

# An interpreter that says it is of one version and notes what it is asked to do.
FAKE = """#!/usr/bin/env bash
here=$(dirname "$0")
case "$*" in
  *'sys.exit(not'*) [ {fits} = yes ];;
  *'%d.%d'*) echo {version};;
  *'import ensurepip'*) true;;
  '-m venv --clear .venv') rm -rf .venv; mkdir -p .venv/bin; cp "$0" .venv/bin/python
    echo "made {version}" >>"$NOTES";;
  *'-m pip install'*) printf '#!/bin/sh\\n' >.venv/bin/ctus; chmod +x .venv/bin/ctus
    echo "installed {version}" >>"$NOTES";;
  '-m compileall -q src') echo "compiled {version}" >>"$NOTES";;
  *'import open3d'*) [ {loads} = yes ] || {{ echo 'ImportError: libnone.so.1' >&2; exit 1; }};;
  --version) echo "Python {version}.9";;
  *) exit 9;;
esac
"""


@pytest.fixture
def project(tmp_path: Path, repository: Path) -> Path:
    """A project folder with the script and interpreters that only pretend."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(repository / "scripts" / "setup.sh", tmp_path / "scripts" / "setup.sh")
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_text("")
    (tmp_path / "bin").mkdir()
    for version, fits, loads in (
        ("3.11", "yes", "yes"),
        ("3.12", "yes", "yes"),
        ("3.13", "yes", "no"),
        ("3.14", "no", "yes"),
    ):
        interpreter = tmp_path / "bin" / f"python{version}"
        interpreter.write_text(FAKE.format(version=version, fits=fits, loads=loads))
        interpreter.chmod(0o755)
    return tmp_path


def set_up(project: Path, **environment: str) -> tuple[int, str, list[str]]:
    """Run the script; its exit code, what it printed, and what the interpreters were asked to do."""
    notes = project / "notes"
    notes.write_text("")
    path = f"{project / 'bin'}:{os.environ['PATH']}"
    ended = subprocess.run(
        ["bash", str(project / "scripts" / "setup.sh")],
        env={"PATH": path, "NOTES": str(notes), **environment},
        capture_output=True,
        text=True,
    )
    return ended.returncode, ended.stdout + ended.stderr, notes.read_text().splitlines()


def test_another_interpreter_gets_a_fresh_environment_which_then_stays(project: Path) -> None:
    assert set_up(project)[2] == ["made 3.11", "installed 3.11", "compiled 3.11"]
    assert set_up(project)[2] == []
    assert set_up(project, PYTHON="python3.12")[2] == ["made 3.12", "installed 3.12", "compiled 3.12"]
    assert set_up(project, PYTHON="python3.12")[2] == []
    # Without the word, what is there stays.
    assert set_up(project)[2] == []
    (project / "constraints.txt").write_text("numpy==2\n")
    assert set_up(project)[2] == ["installed 3.12", "compiled 3.12"]


@pytest.mark.parametrize("python", ["python3.14", "no-such-python"])
def test_an_interpreter_that_does_not_fit_is_refused(project: Path, python: str) -> None:
    code, said, asked = set_up(project, PYTHON=python)
    assert code == 2
    assert f"PYTHON: expected Python 3.11, 3.12 or 3.13, received {python}" in said
    assert asked == []


def test_make_hands_the_interpreter_on(project: Path, repository: Path) -> None:
    shutil.copy(repository / "Makefile", project / "Makefile")
    script = project / "scripts" / "setup.sh"
    script.write_text('#!/bin/sh\necho "PYTHON is $PYTHON"\n')
    script.chmod(0o755)
    said = subprocess.run(
        ["make", "-C", str(project), "setup", "PYTHON=python3.12"], capture_output=True, text=True
    ).stdout
    assert "PYTHON is python3.12" in said


def test_packages_that_do_not_load_end_the_set_up_with_the_reason(project: Path) -> None:
    code, said, done = set_up(project, PYTHON=str(project / "bin" / "python3.13"))
    assert (code, done) == (1, ["made 3.13", "installed 3.13"])
    assert "Open3D or VTK does not load: ImportError: libnone.so.1" in said
    # The next call does not take it for complete.
    assert set_up(project, PYTHON=str(project / "bin" / "python3.13"))[0] == 1
