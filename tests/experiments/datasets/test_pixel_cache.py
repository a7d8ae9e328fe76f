"""Images decoded once: the same pixels from the cache, and never those of a file that has changed."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
from dataset_layouts import grey, speckle
from dicom_files import write_dicom
from PIL import Image

from experiments.datasets import pixel_cache
from experiments.datasets.images import image_files
from experiments.datasets.pixel_cache import read_pairs
from experiments.errors import InputError

# The pixels that known files are decoded to. When it changes, entries of before are outdated: raise CACHE_VERSION and
# change both numbers here together.
DECODED = (1, "1b8dff4c662bc6ac")
SIZES = ((10, 12), (7, 9), (10, 12))


@pytest.fixture
def pairs(tmp_path: Path) -> tuple[list[Path], list[Path]]:
    images, masks = ([tmp_path / kind / f"{index}.png" for index in range(3)] for kind in ("images", "masks"))
    for index, size in enumerate(SIZES):
        grey(images[index], speckle(index, size))
        grey(masks[index], 2 * (speckle(index + 10, size) > 70))
    return images, masks


def read(pairs: tuple[list[Path], list[Path]], cache: Path | None, vessel: tuple[int, ...] = (2,)) -> tuple:
    return read_pairs(*pairs, vessel, (0, 1, 2, 3), str(cache) if cache else None)


def same(one: tuple, other: tuple) -> None:
    for first, second in zip(one[0] + one[1], other[0] + other[1], strict=True):
        assert first.dtype == second.dtype
        np.testing.assert_array_equal(first, second)


def test_the_second_time_nothing_is_decoded(pairs, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, first = read(pairs, None), read(pairs, tmp_path / "cache")
    monkeypatch.setattr(image_files, "read_grey", lambda *_: pytest.fail("decoded again"))
    monkeypatch.setattr(image_files, "read_mask", lambda *_: pytest.fail("decoded again"))
    second = read(pairs, tmp_path / "cache")
    same(plain, first)
    same(plain, second)
    np.testing.assert_array_equal(second[0][1], speckle(1, (7, 9)))
    np.testing.assert_array_equal(second[1][2], speckle(12) > 70)


def test_a_changed_file_is_read_again(pairs, tmp_path) -> None:
    read(pairs, tmp_path / "cache")
    changed = pairs[0][1]
    before = changed.stat()
    grey(changed, speckle(50, (7, 9)))
    os.utime(changed, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    np.testing.assert_array_equal(read(pairs, tmp_path / "cache")[0][1], speckle(50, (7, 9)))


def test_other_labels_are_another_entry_of_masks_alone(pairs, tmp_path) -> None:
    cache = tmp_path / "cache"
    vessel = read(pairs, cache)
    none = read(pairs, cache, vessel=(3,))
    assert vessel[1][0].any() and not none[1][0].any()
    assert len(list(cache.iterdir())) == 3


def test_what_is_at_fault_is_said_although_images_are_kept(pairs, tmp_path) -> None:
    read(pairs, tmp_path / "cache")
    grey(pairs[0][2], speckle(2, (20, 20)))
    with pytest.raises(InputError, match=r"masks.2\.png: expected the mask to have its image's size 20x20"):
        read(pairs, tmp_path / "cache")


@pytest.mark.parametrize("file", ["pixels.bin", "sizes.npy"])
def test_a_damaged_entry_is_made_again(pairs, tmp_path, file: str) -> None:
    before = read(pairs, None)
    read(pairs, tmp_path / "cache")
    for damaged in (tmp_path / "cache").glob(f"*/{file}"):
        damaged.write_bytes(damaged.read_bytes()[:-20])
    same(before, read(pairs, tmp_path / "cache"))
    same(before, read(pairs, tmp_path / "cache"))


def test_no_room_for_the_cache_is_no_failure(pairs, tmp_path) -> None:
    (tmp_path / "file").write_text("in the way")
    same(read(pairs, None), read(pairs, tmp_path / "file" / "cache"))


def test_another_version_is_another_entry(pairs, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    read(pairs, tmp_path / "cache")
    monkeypatch.setattr(pixel_cache, "CACHE_VERSION", pixel_cache.CACHE_VERSION + 1)
    monkeypatch.setattr(image_files, "read_grey", lambda path: np.zeros((3, 3), np.uint8))
    monkeypatch.setattr(image_files, "read_mask", lambda *_: np.ones((3, 3), bool))
    assert read(pairs, tmp_path / "cache")[0][0].shape == (3, 3)


def test_pixels_do_not_change_without_the_version(tmp_path: Path) -> None:
    ramp = np.arange(12 * 16, dtype=np.uint8).reshape(12, 16)
    colour = np.stack([ramp, ramp[::-1], ramp[:, ::-1]], axis=-1)
    palette = Image.fromarray((ramp % 3).astype(np.uint8), "P")
    palette.putpalette([0, 0, 0, 90, 90, 90, 255, 255, 255])
    pictures = {
        "grey.png": Image.fromarray(ramp),
        "colour.png": Image.fromarray(colour),
        "wide.png": Image.fromarray(ramp.astype(np.uint16) * 257),
        "binary.png": Image.fromarray(ramp > 90),
        "palette.png": palette,
    }
    for name, picture in pictures.items():
        picture.save(tmp_path / name)
    write_dicom(tmp_path / "frame.dcm", ramp)
    digest = hashlib.sha256()
    for name in (*pictures, "frame.dcm"):
        digest.update(image_files.read_grey(tmp_path / name).tobytes())
    for index, values in enumerate(((0, 1), (0, 255), (0, 1, 2))):
        grey(tmp_path / f"{index}.png", np.array(values, np.uint8)[ramp % len(values)])
        digest.update(image_files.read_mask(tmp_path / f"{index}.png", (1, 255), (0, 2)).tobytes())
    digest.update(image_files.read_mask(tmp_path / "binary.png", (1, 255), (0,)).tobytes())
    assert (pixel_cache.CACHE_VERSION, digest.hexdigest()[:16]) == DECODED
