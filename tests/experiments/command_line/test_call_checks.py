"""What is wrong with a call as such is said before any work starts."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.command_line.call_checks import require_shared, require_writable
from experiments.errors import InputError

GOOD = {"seed": 0, "out": None, "resume": False, "jobs": 1, "tracking": {"uri": None, "enabled": True}}


def test_good_settings_pass() -> None:
    require_shared(GOOD)
    require_shared({**GOOD, "seed": None, "out": "folder"})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"seed": "abc"}, "seed: expected a whole number or null, received 'abc'"),
        ({"seed": 1.5}, "seed: expected a whole number or null, received 1.5"),
        ({"seed": -1}, "seed: expected a whole number from 0, received -1"),
        ({"resume": "maybe"}, "resume: expected true or false, received 'maybe'"),
        ({"out": [1]}, "out: expected text"),
        ({"tracking": None}, "tracking: expected settings of the tracker"),
        ({"tracking": {"enabled": 1}}, "tracking.enabled: expected true or false, received 1"),
        (
            {"tracking": {"urii": "x"}},
            "tracking.urii: expected a setting of the tracker .* did you mean uri?",
        ),
    ],
)
def test_a_shared_setting_of_another_type_is_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        require_shared({**GOOD, **changes})


def test_a_folder_that_can_be_written_is_left_as_it_was(tmp_path: Path) -> None:
    require_writable(tmp_path / "a" / "b" / "c")
    assert not list(tmp_path.iterdir())
    (tmp_path / "there").mkdir()
    require_writable(tmp_path / "there")
    assert not list((tmp_path / "there").iterdir())


@pytest.mark.parametrize("name", ["file", "file/inside", "x" * 300, "nul\0byte", "/proc/1/nothing"])
def test_a_folder_that_can_not_be_written_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="out: expected a folder"):
        require_writable(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_command_line_checks_before_it_computes(
    counting_study, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "file").write_text("")
    for word, sentence in (
        (f"out={home / 'file'}", "out: expected a folder for the results, received the file"),
        ("seed=abc", "seed: expected a whole number or null"),
        ("tracking.uri=localhost:5000", "did you mean http://localhost:5000?"),
    ):
        assert main(["study=counting", word]) == 2
        said = capsys.readouterr().err
        assert sentence in said and "Traceback" not in said
    assert counting_study.calls == []


def test_calls_that_try_the_same_new_folder_at_once_do_not_refuse_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, calls = tempfile.mkdtemp, []

    def taken_away_by_another_call(prefix: str, dir: Path) -> str:
        calls.append(dir)
        if len(calls) == 1:
            dir.rmdir()
        return made(prefix=prefix, dir=dir)

    monkeypatch.setattr(tempfile, "mkdtemp", taken_away_by_another_call)
    require_writable(tmp_path / "outputs" / "register")
    assert len(calls) == 2 and not list(tmp_path.iterdir())
