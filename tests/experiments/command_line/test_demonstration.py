"""``ctus demo``: its steps are calls that compose, and its end names what was written."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from experiments.cli import compose_sweep, main
from experiments.command_line import demonstration


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The calls of the steps, of which none is made: each leaves a log."""
    calls: list[list[str]] = []

    def run(words: list[str], log: Path) -> int:
        calls.append(words)
        log.write_text(f"Files: {log.stem}\nDashboard: mlflow ui of {log.stem}\n")
        return 0

    table = pd.DataFrame({"network": ["unet"], "DSC": ["0.95"]})
    monkeypatch.setattr(demonstration, "_run", run)
    monkeypatch.setattr(demonstration, "closing", lambda folder: ({"Segmentation": table}, ("A sentence.",)))
    return calls


def test_every_step_is_a_call_that_composes(tmp_path: Path) -> None:
    for name, sentence, words in demonstration.steps(tmp_path):
        overrides = [word for word in words if word != "-m"]
        points = compose_sweep(overrides, multirun="-m" in words)
        assert {config["study"] for config, _ in points} == {name}
        assert sentence[0].isupper() and not sentence.endswith(".")


def test_a_step_reads_what_an_earlier_one_writes(tmp_path: Path) -> None:
    seen: list[str] = []
    for name, _, words in demonstration.steps(tmp_path):
        read = [word.partition("=")[2].strip("'") for word in words if str(tmp_path) in word]
        assert all(Path(path).relative_to(tmp_path).parts[0] in seen for path in read)
        seen.append(name)


def test_the_end_names_what_to_open(called, tmp_path: Path, capsys) -> None:
    assert main(["demo", str(tmp_path / "shown")]) == 0
    assert [call[-1] for call in called] == [
        f"out='{tmp_path / 'shown' / name}'" for name in ("segmentation", "pipeline", "robustness")
    ]
    printed = capsys.readouterr().out
    assert "1/3  Training a U-Net" in printed and "0.95" in printed and "A sentence." in printed
    assert f"Open:      {tmp_path / 'shown' / 'pipeline' / 'scene.html'}" in printed
    assert printed.endswith("Dashboard: mlflow ui of robustness\n")
    kept = (tmp_path / "shown" / "summary.md").read_text()
    assert "| unet | 0.95 |" in kept and "Files: segmentation" in kept and "- A sentence." in kept


def test_without_a_folder_it_is_that_of_the_project(called, home: Path, monkeypatch) -> None:
    monkeypatch.chdir(home)
    assert main(["demo"]) == 0
    assert called[0][-1] == "out='outputs/demo/segmentation'"
    assert (home / "outputs" / "demo" / "summary.md").is_file()


def test_a_step_that_fails_ends_it_with_its_code_and_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    broken = ("first", "Nothing", ["study=nonsense"])
    monkeypatch.setattr(demonstration, "steps", lambda folder: [broken, broken])
    assert main(["demo", str(tmp_path)]) == 2
    printed, said = capfd.readouterr()
    assert "study: expected one of" in said
    assert printed == "1/2  Nothing\n"
    assert not (tmp_path / "summary.md").exists()


@pytest.mark.parametrize("name", ["José", "a,b", "{a}", "[b] (c)", "it's", "#1", 'say "a"', "1.10", "null"])
def test_a_folder_may_be_called_anything(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    for step, _, words in demonstration.steps(folder):
        call = [*words, demonstration._setting("out", folder / step)]
        points = compose_sweep([word for word in call if word != "-m"], multirun="-m" in call)
        config, _ = points[0]
        assert config["out"] == str(folder / step)
        if step == "robustness":
            assert str(folder / "pipeline" / "cloud.ply") in str(config["moving"])


@pytest.mark.parametrize("word", ["", "${seed}", "a\nb", "~nobody-of-this-name/x"])
def test_a_folder_that_no_call_can_be_given_is_refused(called, word: str, capsys) -> None:
    assert main(["demo", word]) == 2
    assert "demo: expected a folder" in capsys.readouterr().err and not called


def test_a_stop_by_the_keyboard_waits_for_the_call_to_end_its_runs(tmp_path: Path, monkeypatch) -> None:
    class Call:
        waits = 0

        def __init__(self, *_: object, **__: object) -> None:
            pass

        def wait(self) -> int:
            Call.waits += 1
            if Call.waits == 1:
                raise KeyboardInterrupt
            return 130

    monkeypatch.setattr(demonstration.subprocess, "Popen", Call)
    assert demonstration._run(["study=export_runs"], tmp_path / "log.txt") == 130
    assert Call.waits == 2


@pytest.mark.parametrize("words", [["a", "b"], ["out=a"], ["--quick"]])
def test_no_more_than_a_folder_is_taken(words: list[str], capsys) -> None:
    assert main(["demo", *words]) == 2
    assert "demo: expected no more than a folder, received " + " ".join(words) in capsys.readouterr().err


def test_a_folder_that_is_a_file_is_refused(called, tmp_path: Path, capsys) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demo", str(tmp_path / "file")]) == 2
    assert "file" in capsys.readouterr().err and not called


def test_help(capsys) -> None:
    assert main(["demo", "--help"]) == 0
    assert "simulated data" in capsys.readouterr().out
