"""``quiet=`` and ``verbose=``: taken out of the words of a call, kept for its processes, and what they change."""

from __future__ import annotations

import os

import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.running.verbosity import VARIABLE, Verbosity, read_verbosity, saying, verbosity


@pytest.mark.parametrize(
    ("words", "others", "level"),
    [
        (["study=a", "quiet=true"], ["study=a"], Verbosity.QUIET),
        (["verbose=True", "-m", "x=1"], ["-m", "x=1"], Verbosity.VERBOSE),
        (["quiet=false", "verbose=true"], [], Verbosity.VERBOSE),
        (["quiet=false"], [], Verbosity.NORMAL),
        (["x.quiet=1", "quiet"], ["x.quiet=1", "quiet"], Verbosity.NORMAL),
    ],
)
def test_the_words_are_taken_out(words, others, level, monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert read_verbosity(words) == (others, level)


def test_without_a_word_the_environment_says(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "quiet")
    assert read_verbosity(["a=1"]) == (["a=1"], Verbosity.QUIET)
    monkeypatch.setenv(VARIABLE, "nonsense")
    assert verbosity() is Verbosity.NORMAL


@pytest.mark.parametrize("words", [["quiet=maybe"], ["verbose="], ["quiet=true", "verbose=true"]])
def test_other_values_and_both_are_refused(words: list[str], capsys) -> None:
    with pytest.raises(InputError, match="expected"):
        read_verbosity(words)
    assert main([*words, "study=export_runs"]) == 2
    assert "expected" in capsys.readouterr().err


def test_the_environment_is_as_before_when_a_call_has_ended(monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    with saying(Verbosity.QUIET):
        assert os.environ[VARIABLE] == "quiet" and verbosity() is Verbosity.QUIET
        with saying(Verbosity.VERBOSE):
            assert verbosity() is Verbosity.VERBOSE
        assert verbosity() is Verbosity.QUIET
    assert VARIABLE not in os.environ


def test_a_quiet_call_prints_where_the_files_are_and_changes_no_job(counting_study, home, capsys) -> None:
    assert main(["study=counting", f"out={home / 'a'}", "quiet=true"]) == 0
    quiet = capsys.readouterr()
    (line,) = quiet.out.splitlines()
    assert line.startswith("Files: ")
    assert quiet.err == ""
    calls = list(counting_study.calls)
    # The same job: it is not run again when it is asked for with another voice.
    assert main(["study=counting", f"out={home / 'a'}", "verbose=true", "resume=true"]) == 0
    assert list(counting_study.calls) == calls
    assert "Dashboard: " in capsys.readouterr().out


def test_a_stop_by_the_keyboard_says_how_to_go_on(counting_study, home, capsys, monkeypatch) -> None:
    from experiments.running import run_sweep

    def stopped(points: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_sweep, "run", stopped)
    assert main(["study=counting"]) == 130
    assert capsys.readouterr().err.rstrip().endswith("Continue with the same command and resume=true.")
    assert main(["study=segmentation", "dataset=phantom"]) == 130
    assert capsys.readouterr().err.rstrip().endswith("resume=true trainer.resume=true.")
