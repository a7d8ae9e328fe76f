"""make bench and bench-quick: all benchmarks are in them, each with a small budget, and skip what lacks its data."""

from __future__ import annotations

import argparse
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from quick_budget import data_folder, parsed

FOLDER = Path(__file__).resolve().parents[1] / "scripts"
SCRIPTS = [*sorted(FOLDER.glob("bench_*.py")), FOLDER / "benchmarks.py"]


def test_make_bench_quick_names_every_benchmark(repository: Path) -> None:
    text = (repository / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    named = re.search(r"^BENCHMARKS := (.*)$", text, re.MULTILINE)
    target = text[text.index("\nbench-quick: setup\n") :].split("\n\n")[0]
    assert named is not None
    assert sorted(named[1].split()) == sorted(path.stem for path in SCRIPTS)
    assert "$(BENCHMARKS)" in target
    assert "scripts/$$name.py --quick" in target
    assert "== %s" in target


def test_make_bench_writes_the_page(repository: Path) -> None:
    text = (repository / "Makefile").read_text(encoding="utf-8")
    target = text[text.index("\nbench: setup\n") :].split("\n\n")[0]
    assert "$(PY) scripts/benchmarks.py" in target
    assert "--quick" not in target


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_benchmark_starts_and_has_a_small_budget(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # In this process: one of its own for each would import the libraries again, which takes longer than all else.
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    monkeypatch.setattr(sys, "path", [str(path.parent), *sys.path])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert not ended.value.code
    assert re.search(r"--quick\s+a small budget", capsys.readouterr().out)


@pytest.mark.parametrize("name", ["bench_centerline", "bench_reconstruction"])
def test_a_benchmark_without_its_data_is_skipped_with_a_sentence(
    name: str, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CTUS_TEST_DATA", str(tmp_path))
    script = [sys.executable, str(repository / "scripts" / f"{name}.py"), "--quick"]
    done = subprocess.run(script, check=True, capture_output=True, text=True)
    assert done.stdout.startswith(f"Skipped: expected the public data in {tmp_path / 'vmtk'} ")
    assert done.stdout.count("\n") == 1


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], (200, 512)),
        (["--quick"], (20, 64)),
        (["--quick", "--frames", "7"], (7, 64)),
        (["--size-px", "8"], (200, 8)),
    ],
)
def test_quick_changes_the_defaults_alone(given: list[str], expected: tuple[int, int]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size-px", type=int, default=512)
    found = parsed(parser, {"frames": 20, "size_px": 64}, given)
    assert (found.frames, found.size_px) == expected


def test_a_given_folder_is_taken_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CTUS_TEST_DATA", str(tmp_path))
    (tmp_path / "vmtk").mkdir()
    assert data_folder(tmp_path / "mine", "vmtk") == tmp_path / "mine"
    assert data_folder(None, "vmtk") == tmp_path / "vmtk"
