from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.datasets import reading
from experiments.errors import InputError

LABELS = np.array([[0, 1, 2], [2, 0, 0]], dtype=np.uint8)


def write(path: Path, pixels: np.ndarray, mode: str | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels, mode).save(path)
    return path


def test_a_missing_root_says_where_the_data_comes_from_and_what_to_pass(tmp_path) -> None:
    with pytest.raises(
        InputError, match=r"data set x \(from y; layout z\), found no folder .*pass dataset\.root="
    ):
        reading.require_root("x", tmp_path / "none", "from y", "z")
    assert reading.require_root("x", str(tmp_path), "from y", "z") == tmp_path


def test_images_are_found_in_order_and_other_files_ignored(tmp_path) -> None:
    for name in ("b.png", "a.PNG", "c.jpg", "notes.txt", "Thumbs.db"):
        (tmp_path / name).touch()
    assert list(reading.image_files(tmp_path)) == ["a", "b", "c"]


def test_refuses_a_folder_that_is_missing_empty_or_has_a_name_twice(tmp_path) -> None:
    with pytest.raises(InputError, match="expected a folder of images, found none"):
        reading.image_files(tmp_path / "none")
    with pytest.raises(InputError, match=r"expected images \(\.png"):
        reading.image_files(tmp_path)
    for name in ("a.png", "a.bmp"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"a\.png: expected one image of each name, found a\.bmp as well"):
        reading.image_files(tmp_path)


def test_refuses_what_has_no_partner() -> None:
    one, two = {"a": Path("images/a.png")}, {"a": Path("masks/a.png"), "b": Path("masks/b.png")}
    with pytest.raises(InputError, match=r"masks/b\.png: expected an image of the same name"):
        reading.paired(one, two)
    with pytest.raises(InputError, match=r"images/a\.png: expected a mask of the same name"):
        reading.paired(one, {})


def test_colour_and_grey_images_give_the_same_grey(tmp_path) -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3) * 40
    for name, pixels in (
        ("l.png", grey),
        ("rgb.png", np.dstack([grey] * 3)),
        ("rgba.png", np.dstack([grey] * 4)),
    ):
        np.testing.assert_array_equal(reading.read_grey(write(tmp_path / name, pixels)), grey)


def test_labels_are_a_palettes_indices_not_its_colours(tmp_path) -> None:
    image = Image.fromarray(LABELS, "P")
    image.putpalette([0, 0, 0, 255, 0, 0, 0, 255, 0] + [0] * 759)
    image.save(tmp_path / "m.png")
    mask = reading.read_mask(tmp_path / "m.png", {2}, {0, 1}, (2, 3))
    np.testing.assert_array_equal(mask, LABELS == 2)
    assert mask.dtype == bool


def test_a_black_and_white_mask_is_0_and_255(tmp_path) -> None:
    Image.fromarray(LABELS > 0).save(tmp_path / "m.png")
    np.testing.assert_array_equal(reading.read_mask(tmp_path / "m.png", {255}, {0}, (2, 3)), LABELS > 0)


def test_refuses_another_size_and_unknown_labels_by_name(tmp_path) -> None:
    path = write(tmp_path / "m.png", LABELS)
    with pytest.raises(
        InputError, match=r"m\.png: expected the mask to have its image's size 5x4, received 3x2"
    ):
        reading.read_mask(path, {2}, {0, 1}, (4, 5))
    with pytest.raises(InputError, match=r"m\.png: expected labels 0, 2, received 1"):
        reading.read_mask(path, {2}, {0}, (2, 3))


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n truncated"])
def test_refuses_a_file_that_is_no_image(tmp_path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png: expected an image, received a file that can't be read"):
        reading.read_grey(path)


def test_refuses_a_truncated_image_and_sixteen_bits(tmp_path) -> None:
    path = write(tmp_path / "a.png", np.random.default_rng(0).integers(0, 255, (64, 64), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"a\.png: expected an image, received"):
        reading.read_grey(path)
    deep = write(tmp_path / "deep.png", np.zeros((4, 4), np.uint16))
    with pytest.raises(InputError, match=r"deep\.png: expected an image of 8 bits a channel"):
        reading.read_grey(deep)


def test_refuses_masks_that_are_all_empty(tmp_path) -> None:
    with pytest.raises(InputError, match="expected masks with a vessel, received 2 empty ones"):
        reading.require_vessel(tmp_path, [np.zeros((2, 2), bool)] * 2)
    reading.require_vessel(tmp_path, [np.zeros((2, 2), bool), np.ones((2, 2), bool)])
