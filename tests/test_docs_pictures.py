"""The documentation's pictures of pages: which they are, and how they are made small."""

from __future__ import annotations

from pathlib import Path

import docs_pictures
import numpy as np
import pytest
from PIL import Image

from experiments.errors import InputError


def test_only_pictures_of_pages_are_taken(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "a.md").write_text("![s](scene_1280.png) ![r](registered.png) [no picture](report_9.png)")
    (tmp_path / "deep" / "b.md").write_text("![again](../scene_1280.png)\n![w](sweep_1280.png)\n")
    found = docs_pictures.pictures_of_pages(tmp_path)
    assert found == [tmp_path / "deep" / "sweep_1280.png", tmp_path / "scene_1280.png"]


def test_the_documentation_shows_pictures_that_are_there_and_small(repository: Path) -> None:
    found = docs_pictures.pictures_of_pages(repository / "docs")
    assert found
    assert [path for path in found if path.stat().st_size > docs_pictures.MAX_BYTES] == []


def test_empty_rows_at_the_end_are_cut(tmp_path: Path) -> None:
    pixels = np.full((200, 50, 3), 255, dtype=np.uint8)
    pixels[20:60, 5:40] = 10, 120, 200
    Image.fromarray(pixels).save(tmp_path / "large.png")
    size = docs_pictures.small_picture(tmp_path / "large.png", tmp_path / "small.png")
    with Image.open(tmp_path / "small.png") as small:
        assert small.size == (50, 71)
        assert small.getpixel((10, 30)) == (10, 120, 200)
    assert size == (tmp_path / "small.png").stat().st_size


def test_a_large_picture_gets_a_palette(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (100, 200, 3)).astype(np.uint8)
    Image.fromarray(noise).save(tmp_path / "large.png")
    # Noise takes three bytes a pixel, one with a palette.
    monkeypatch.setattr(docs_pictures, "MAX_BYTES", 30_000)
    docs_pictures.small_picture(tmp_path / "large.png", tmp_path / "small.png")
    with Image.open(tmp_path / "small.png") as small:
        assert (small.size, small.mode) == ((200, 100), "P")


def test_a_picture_that_is_missing_or_too_large_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"scene_1.png: expected a picture that make test-pages saves"):
        docs_pictures.small_picture(tmp_path / "scene_1.png", tmp_path / "out.png")
    Image.new("RGB", (50, 50)).save(tmp_path / "black.png")
    monkeypatch.setattr(docs_pictures, "MAX_BYTES", 10)
    with pytest.raises(InputError, match="expected at most 10 bytes"):
        docs_pictures.small_picture(tmp_path / "black.png", tmp_path / "out.png")
