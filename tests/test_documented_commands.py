"""What README and pages tell a reader to type: each command is one that there is, each configuration composes."""

from __future__ import annotations

import json
import re
import shlex
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from documented_commands import commands, ctus_calls
from tube_sweeps import RADIUS_MM, tube_sweep
from volumes import voxelised, write_volume

from experiments import cli
from experiments.cli import compose_sweep, main
from experiments.command_line.call_options import read_options
from experiments.command_line.help_page import help_text
from experiments.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
# Programs of others that pages name.
OTHERS = {"cd", "conda", "export", "git", "mlflow", "pip", "source"}
README = ROOT / "README.md"


def test_the_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150


@cache
def composed(words: tuple[str, ...]) -> int:
    """Number of points that a call composes; pages repeat each other's commands."""
    multirun = words[0] == "-m"
    return len(compose_sweep(list(words[multirun:]), multirun=multirun))


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a sweep the first and the last point are composed, which have the first and the last of all values."""
    every = cli._sweep_points
    monkeypatch.setattr(cli, "_sweep_points", lambda words: [*every(words)[:1], *every(words)[1:][-1:]])


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_command_of_a_page_composes(page: Path, few_points: None) -> None:
    for words in ctus_calls(page):
        if "--help" in words:
            assert help_text(words)
        elif words[0] == "doctor" or any(word.startswith("-") for word in words if word != "-m"):
            assert words[0] == "doctor" or read_options(words), words
        else:
            try:
                assert composed(tuple(words))
            except InputError as refusal:
                raise AssertionError(f"{page.name}: ctus {shlex.join(words)}: {refusal}") from refusal


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_other_command_of_a_page_is_there(page: Path) -> None:
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for words in commands(page):
        program = Path(words[0]).name
        if program == "make":
            named = [word for word in words[1:] if "=" not in word]
            assert set(named) <= targets, words
        elif program == "python" and words[1:2] != ["-m"]:
            assert (ROOT / words[1]).is_file(), words
        else:
            assert program in {"ctus", "python", "mlflow", *OTHERS}, f"{page.name}: {words}"


def test_a_command_that_is_not_there_would_be_found(tmp_path: Path, few_points: None) -> None:
    page = tmp_path / "page.md"
    page.write_text("```sh\nA=1 ctus study=register \\\n  movin=a fixed='b c'  # comment\n```\n")
    assert ctus_calls(page) == [["study=register", "movin=a", "fixed=b c"]]
    with pytest.raises(AssertionError, match="movin"):
        test_every_command_of_a_page_composes(page, few_points)


def own_files(folder: Path) -> None:
    """The files that the README starts from: a sweep across a tube, its masks, and the tube in a volume from CT."""
    from PIL import Image

    from registration.readers.folder import write_folder

    drawn = tube_sweep(count=41)
    write_folder(folder / "sweep", drawn.sweep)
    (folder / "masks").mkdir()
    for number, mask in enumerate(drawn.masks):
        Image.fromarray((255 * mask).astype(np.uint8)).save(folder / "masks" / f"{number:06d}.png")
    start, end = drawn.axis_mm
    way = end - start

    def inside(points_mm: np.ndarray) -> np.ndarray:
        along = np.clip((points_mm - start) @ way / (way @ way), -0.1, 1.1)
        return np.linalg.norm(points_mm - start - along[:, None] * way, axis=1) < RADIUS_MM

    low, high = np.minimum(start, end) - 8, np.maximum(start, end) + 8
    write_volume(folder / "ct_labels.nii.gz", voxelised(inside, low, high, (0.6, 0.6, 0.8), np.eye(3)), True)


def test_the_readmes_way_from_own_files_to_a_registered_model(
    home: Path, tmp_path: Path, monkeypatch
) -> None:
    own_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    section = README.read_text(encoding="utf-8").split("\n## Your own data\n")[1].split("\n## ")[0]
    page = tmp_path / "section.md"
    page.write_text(section)
    for words in ctus_calls(page):
        assert main([*words, *(["tracking.enabled=false"] if words[0] != "doctor" else [])]) == 0, words
    # What the comments and the sentence below the commands promise is there.
    made = {path.name for path in (tmp_path / "registered").iterdir()}
    assert {"registration.json", "moved.ply", "fixed_T_moving.h5", "scene.html"} <= made
    for name in (
        "model/surface.ply",
        "model/centerline.vtp",
        "reconstructed/cloud.ply",
        "reconstructed/surface.ply",
    ):
        assert (tmp_path / name).is_file()
        assert name in section or Path(name).name in section
    found = json.loads((tmp_path / "registered" / "registration.json").read_text())
    # Both are the same tube in one frame; along a straight tube nothing holds the pose, and the verdict says so.
    assert found["rmse_mm"] < 0.3
    assert found["verdict"] == "ambiguous"
    assert "slide" in found["weak_directions"]
