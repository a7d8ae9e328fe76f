"""Completion of presets and of the words that are not settings; everything else is left to Hydra."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.cli import main
from experiments.command_line.completion import candidates, own_completion


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("ctus +sweep=aorta", ["+sweep=aorta_200"]),
        ("ctus -m +s", ["+sweep="]),
        ("ctus doc", ["doctor"]),
        ("ctus de", ["demo"]),
        ("ctus study=register doc", []),
        ("ctus study=register q", ["quiet=true"]),
        ("ctus +sweep=nonsense", []),
        ("ctus study=reg", []),
        ("ctus ", []),
    ],
)
def test_the_last_word_is_completed(line: str, found: list[str]) -> None:
    assert candidates(line) == found


def test_every_preset_is_offered(repository: Path) -> None:
    presets = sorted(path.stem for path in (repository / "conf" / "preset").glob("*.yaml"))
    assert candidates("ctus -m +sweep=") == [f"+sweep={name}" for name in presets]


def test_each_shell_gets_its_own_separator() -> None:
    typed = {"COMP_LINE": "ctus +sweep=vessel"}
    assert own_completion(["-sc", "query=bash"], typed) == "+sweep=vessel_types"
    typed = {"COMP_LINE": "ctus +sweep=figure_r"}
    assert own_completion(["-sc", "query=fish"], typed) == "+sweep=figure_robustness\n+sweep=figure_runtime"
    assert own_completion(["-sc", "install=bash"], typed) is None
    assert own_completion(["-sc", "query=bash"], {}) is None


def test_the_command_answers_presets_itself_and_leaves_studies_to_hydra(monkeypatch, capsys) -> None:
    monkeypatch.setenv("COMP_LINE", "ctus +sweep=aorta")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out == "+sweep=aorta_200\n"
    monkeypatch.setenv("COMP_LINE", "ctus study=regi")
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out == "study=register\n"
