"""``ctus doctor`` as a command: the page, the exit code, and how quick it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.command_line.doctor import report


def test_the_page_names_everything_and_the_machine_of_the_tests_is_able(home: Path, capsys) -> None:
    assert main(["doctor"]) == 0
    shown = capsys.readouterr().out
    subjects = {line[9:27].strip() for line in shown.splitlines()}
    assert {"Python", "ctus", "packages", "processor", "GPU", "disk", "store"} <= subjects
    assert shown.rstrip().endswith("ctus can work on this machine.")


def test_what_is_missing_gives_exit_code_1(home: Path, capsys) -> None:
    assert main(["doctor", "tracking.uri=http://localhost:1"]) == 1
    assert "ctus can't work yet: store" in capsys.readouterr().out


@pytest.mark.parametrize("word", ["dta=x", "data", "data=", "study=register"])
def test_another_word_is_refused_in_one_sentence(word: str, capsys) -> None:
    assert main(["doctor", word]) == 2
    assert f"{word}: expected data=<value>" in capsys.readouterr().err


def test_its_own_help(capsys) -> None:
    assert main(["doctor", "--help"]) == 0
    assert capsys.readouterr().out == report.USAGE


def test_nothing_heavy_is_imported(repository: Path, tmp_path: Path) -> None:
    program = (
        "import sys; from experiments.cli import main; main(['doctor'])\n"
        "heavy = {'hydra', 'torch', 'mlflow', 'open3d', 'lightning', 'monai', 'numpy', 'pandas', 'vtk'}\n"
        "sys.exit(','.join(sorted(heavy & set(sys.modules))) or 0)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(repository / "src"), "CTUS_HOME": str(tmp_path)},
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
