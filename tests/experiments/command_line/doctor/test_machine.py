"""Disk and GPU: a full disk is missing, a GPU that torch can't use is a note, no GPU is no fault."""

from __future__ import annotations

from collections import namedtuple
from importlib import metadata
from pathlib import Path

import pytest

from experiments.command_line.doctor import machine
from experiments.command_line.doctor.findings import State

Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize(("free", "state"), [(0.5, State.MISSING), (5, State.NOTE), (50, State.OK)])
def test_a_full_disk_is_missing(free: float, state: State, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(machine.shutil, "disk_usage", lambda path: Usage(0, 0, int(free * machine.GIB)))
    assert machine.free_disk(tmp_path / "not" / "yet").state is state


def test_the_processor_has_cores_and_memory() -> None:
    assert " cores, " in machine.processor().text


@pytest.mark.parametrize(
    ("cards", "build", "state", "words"),
    [
        ("", "", State.OK, "none"),
        ("NVIDIA H200, 143771 MiB", "CUDA 12.8", State.OK, "built for CUDA 12.8"),
        ("NVIDIA H200, 143771 MiB", "", State.NOTE, "processor alone"),
    ],
)
def test_a_gpu_that_torch_cannot_use_is_a_note(cards, build, state, words, monkeypatch) -> None:
    monkeypatch.setattr(machine, "_cards", lambda: cards)
    monkeypatch.setattr(machine, "torch_build", lambda: build)
    found = machine.gpu()
    assert found.state is state
    assert words in found.text


@pytest.mark.parametrize(
    ("text", "build"),
    [
        ("cuda: Optional[str] = '12.8'\nhip: Optional[str] = None\n", "CUDA 12.8"),
        ("cuda: Optional[str] = None\nhip: Optional[str] = '6.4.0'\n", "ROCm 6.4.0"),
        ("cuda: Optional[str] = None\nhip: Optional[str] = None\n", ""),
    ],
)
def test_the_build_of_torch_is_read_from_its_own_file(text, build, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "torch").mkdir()
    (tmp_path / "torch" / "version.py").write_text(text)

    class Distribution:
        def locate_file(self, name: str) -> Path:
            return tmp_path / name

    monkeypatch.setattr(metadata, "distribution", lambda name: Distribution())
    assert machine.torch_build() == build


def test_cards_are_those_that_the_driver_names(tmp_path: Path, monkeypatch) -> None:
    program = tmp_path / "nvidia-smi"
    program.write_text("#!/bin/sh\necho 'NVIDIA H200, 143771 MiB'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert machine._cards() == "NVIDIA H200, 143771 MiB"
    program.write_text("#!/bin/sh\nexit 9\n")
    assert machine._cards() == ""
