import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from dicom_files import write_dicom
from drawn_screens import cross_hairs, speckle
from PIL import Image
from stored_pngs import write_png
from torch.nn import Identity

from experiments.datasets.images import image_files
from experiments.errors import InputError
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing

LABELS = np.array([[0, 1, 2], [2, 0, 0]], dtype=np.uint8)


def write(path: Path, pixels: np.ndarray, mode: str | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels, mode).save(path)
    return path


def test_a_missing_root_says_where_the_data_comes_from_and_what_to_pass(tmp_path) -> None:
    with pytest.raises(
        InputError, match=r"data set x \(from y; layout z\), found no folder .*pass dataset\.root="
    ):
        image_files.require_root("x", tmp_path / "none", "from y", "z")
    assert image_files.require_root("x", str(tmp_path), "from y", "z") == tmp_path


def test_images_are_found_in_order_and_other_files_ignored(tmp_path) -> None:
    for name in ("b.png", "a.PNG", "c.jpg", "d.dcm", "notes.txt", "Thumbs.db", "._a.png"):
        (tmp_path / name).touch()
    (tmp_path / "e.png").mkdir()
    assert list(image_files.image_files(tmp_path)) == ["a", "b", "c", "d"]


def test_refuses_a_folder_that_is_missing_empty_or_has_a_name_twice(tmp_path) -> None:
    with pytest.raises(InputError, match="expected a folder of images, found none"):
        image_files.image_files(tmp_path / "none")
    with pytest.raises(InputError, match=r"expected images \(\.png"):
        image_files.image_files(tmp_path)
    for name in ("a.png", "a.bmp"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"a\.png: expected one image of each name, found a\.bmp as well"):
        image_files.image_files(tmp_path)


def test_colour_and_grey_images_give_the_same_grey(tmp_path) -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3) * 40
    for name, pixels in (
        ("l.png", grey),
        ("rgb.png", np.dstack([grey] * 3)),
        ("rgba.png", np.dstack([grey] * 3 + [np.full_like(grey, 255)])),
    ):
        np.testing.assert_array_equal(image_files.read_grey(write(tmp_path / name, pixels)), grey)


def test_labels_are_a_palettes_indices_not_its_colours(tmp_path) -> None:
    image = Image.fromarray(LABELS, "P")
    image.putpalette([0, 0, 0, 255, 0, 0, 0, 255, 0] + [0] * 759)
    image.save(tmp_path / "m.png")
    mask = image_files.read_mask(tmp_path / "m.png", {2}, {0, 1}, (2, 3))
    np.testing.assert_array_equal(mask, LABELS == 2)
    assert mask.dtype == bool


def test_a_black_and_white_mask_is_0_and_255(tmp_path) -> None:
    Image.fromarray(LABELS > 0).save(tmp_path / "m.png")
    np.testing.assert_array_equal(image_files.read_mask(tmp_path / "m.png", {255}, {0}, (2, 3)), LABELS > 0)


def test_refuses_another_size_and_unknown_labels_by_name(tmp_path) -> None:
    path = write(tmp_path / "m.png", LABELS)
    with pytest.raises(
        InputError, match=r"m\.png: expected the mask to have its image's size 5x4, received 3x2"
    ):
        image_files.read_mask(path, {2}, {0, 1}, (4, 5))
    with pytest.raises(InputError, match=r"m\.png: expected labels 0, 2, received 1"):
        image_files.read_mask(path, {2}, {0}, (2, 3))


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n truncated"])
def test_refuses_a_file_that_is_no_image(tmp_path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png: expected a.* image, "):
        image_files.read_grey(path)


def test_a_coloured_mark_does_not_become_a_bright_echo(tmp_path) -> None:
    tissue = speckle((60, 80))
    marked = cross_hairs(np.dstack([tissue] * 3), (30, 40), 10, (255, 255, 0))
    assert image_files.read_grey(write(tmp_path / "a.png", marked)).max() <= tissue.max()


def test_a_file_is_read_as_the_predictor_takes_its_colours(tmp_path) -> None:
    marked = cross_hairs(np.dstack([speckle((60, 80))] * 3), (30, 40), 10, (0, 255, 255))
    predictor = Predictor(Identity(), Preprocessing(32))
    from_file = image_files.read_grey(write(tmp_path / "a.png", marked))
    np.testing.assert_array_equal(predictor.probability(marked[None]), predictor.probability(from_file[None]))


def test_a_picture_with_a_palette_is_what_its_colours_show(tmp_path) -> None:
    image = Image.fromarray(LABELS, "P")
    image.putpalette([10, 10, 10, 90, 90, 90, 200, 200, 200] + [0] * 759)
    image.save(tmp_path / "a.png")
    shown = np.array([10, 90, 200], np.uint8)[LABELS]
    np.testing.assert_array_equal(image_files.read_grey(tmp_path / "a.png"), shown)


def test_a_picture_in_other_colours_is_read_as_it_is_shown(tmp_path) -> None:
    grey = np.full((16, 16), 120, np.uint8)
    for mode in ("CMYK", "YCbCr"):
        path = tmp_path / f"{mode}.jpg"
        Image.fromarray(np.dstack([grey] * 3)).convert(mode).save(path, quality=100)
        assert np.abs(image_files.read_grey(path).astype(int) - 120).max() <= 2


def test_reads_a_dicom_file_of_one_frame_and_refuses_a_film(tmp_path) -> None:
    tissue = speckle((20, 30))
    np.testing.assert_array_equal(image_files.read_grey(write_dicom(tmp_path / "a.dcm", tissue)), tissue)
    with pytest.raises(InputError, match=r"f\.dcm: expected one frame, received 2"):
        image_files.read_grey(write_dicom(tmp_path / "f.dcm", np.stack([tissue] * 2)))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tif"])
def test_refuses_a_truncated_image(tmp_path, suffix: str, share: float) -> None:
    path = write(tmp_path / f"a.{suffix}", speckle((64, 64)))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=rf"a\.{suffix}: expected a.* image, "):
        image_files.read_grey(path)
    with pytest.raises(InputError, match=rf"a\.{suffix}: expected a.* image, "):
        image_files.read_mask(path, {1}, {0}, (64, 64))


def test_refuses_an_image_that_is_not_there(tmp_path) -> None:
    for read in (image_files.read_grey, lambda path: image_files.read_mask(path, {1}, {0}, (4, 4))):
        with pytest.raises(InputError, match=r"none\.png: expected an image, found no file"):
            read(tmp_path / "none.png")


def test_few_bits_of_grey_are_scaled_and_eight_in_sixteen_are_taken(tmp_path) -> None:
    two = write_png(tmp_path / "two.png", LABELS, 2)
    np.testing.assert_array_equal(image_files.read_grey(two), LABELS * 85)
    tissue = speckle((20, 30))
    for factor in (256, 257):
        path = write(tmp_path / "deep.png", tissue.astype(np.uint16) * factor)
        np.testing.assert_array_equal(image_files.read_grey(path), tissue)
    deep = write(tmp_path / "deep.png", tissue.astype(np.uint16) * 16)
    with pytest.raises(
        InputError, match=r"deep\.png: expected an image of 8 bits a channel, received uint16"
    ):
        image_files.read_grey(deep)


def test_transparency_that_hides_echoes_is_refused_and_other_is_dropped(tmp_path) -> None:
    tissue = speckle((20, 30))
    tissue[:5] = 0
    clear = np.full_like(tissue, 255)
    clear[:5] = 0
    for planes in (
        [tissue, clear],
        [tissue] * 3 + [clear],
        [tissue, clear * 0],
        [tissue] * 3 + [clear * 0 + 9],
    ):
        path = write(tmp_path / "a.png", np.dstack(planes))
        np.testing.assert_array_equal(image_files.read_grey(path), tissue)
    clear[5:10] = 0
    for planes in ([tissue, clear], [tissue] * 3 + [clear]):
        with pytest.raises(
            InputError, match=r"a\.png: expected an opaque image, .* save it without an alpha"
        ):
            image_files.read_grey(write(tmp_path / "a.png", np.dstack(planes)))


def test_an_image_and_its_mask_are_turned_as_they_are_shown(tmp_path) -> None:
    """A camera's or a viewer's mark, as in the image alone, decides for both."""
    exif = Image.Exif()
    exif[274] = 3
    tissue = speckle((20, 30))
    Image.fromarray(np.ascontiguousarray(tissue[::-1, ::-1])).save(tmp_path / "a.png", exif=exif)
    np.testing.assert_array_equal(image_files.read_grey(tmp_path / "a.png"), tissue)


def test_files_that_are_no_images_are_known_apart(tmp_path) -> None:
    for name in ("a.png", "model.h5", "notes.txt", ".hidden", "Thumbs.db", "desktop.ini"):
        (tmp_path / name).touch()
    write_dicom(tmp_path / "IM_0001", speckle((4, 4)))
    assert list(image_files.image_files(tmp_path)) == ["IM_0001", "a"]
    assert [path.name for path in image_files.other_files(tmp_path)] == ["model.h5", "notes.txt"]
    np.testing.assert_array_equal(image_files.read_grey(tmp_path / "IM_0001"), speckle((4, 4)))


def test_refuses_sixteen_bits_and_numbers_that_are_no_grey_values(tmp_path) -> None:
    deep = write(tmp_path / "deep.png", np.full((4, 4), 700, np.uint16))
    real = write(tmp_path / "real.tif", np.zeros((4, 4), np.float32))
    for path, kind in ((deep, "uint16"), (real, "float32")):
        with pytest.raises(
            InputError, match=rf"{path.name}: expected an image of 8 bits a channel, received {kind}"
        ):
            image_files.read_grey(path)


def test_refuses_sixteen_bits_of_colour(tmp_path) -> None:
    (tmp_path / "deep.png").write_bytes(png_of_16_bit_colour(5, 3))
    with pytest.raises(InputError, match=r"deep\.png: expected an image of 8 bits a channel, received 16"):
        image_files.read_grey(tmp_path / "deep.png")


def test_labels_may_have_sixteen_bits(tmp_path) -> None:
    path = write(tmp_path / "m.png", LABELS.astype(np.uint16) * 300)
    np.testing.assert_array_equal(image_files.read_mask(path, {600}, {0, 300}, (2, 3)), LABELS == 2)


def test_refuses_a_stack_of_images(tmp_path) -> None:
    page = Image.fromarray(speckle((8, 8)))
    page.save(tmp_path / "a.tif", save_all=True, append_images=[page, page])
    with pytest.raises(InputError, match=r"a\.tif: expected one image, received a stack of 3"):
        image_files.read_grey(tmp_path / "a.tif")


def test_refuses_an_image_without_pixels(tmp_path) -> None:
    whole = png_of_16_bit_colour(5, 3)
    for width, height in ((0, 3), (5, 0)):
        (tmp_path / "a.png").write_bytes(whole.replace(header(5, 3), header(width, height)))
        with pytest.raises(InputError, match=r"a\.png: expected a.* image"):
            image_files.read_grey(tmp_path / "a.png")


def test_refuses_an_image_too_large_to_be_one(tmp_path, monkeypatch) -> None:
    path = write(tmp_path / "a.png", speckle((40, 40)))
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 700)
    with pytest.raises(InputError, match=r"a\.png: expected a.* image, "):
        image_files.read_grey(path)


def header(width: int, height: int) -> bytes:
    """The IHDR chunk of a PNG file with 16 bits a channel of RGB."""
    content = b"IHDR" + struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    return struct.pack(">I", 13) + content + struct.pack(">I", zlib.crc32(content))


def png_of_16_bit_colour(width: int, height: int) -> bytes:
    rows = zlib.compress((b"\0" + b"\x12\x34" * 3 * width) * height)
    chunks = [(b"IDAT", rows), (b"IEND", b"")]
    return (
        b"\x89PNG\r\n\x1a\n"
        + header(width, height)
        + b"".join(
            struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
            for name, content in chunks
        )
    )


def test_refuses_masks_that_are_all_empty(tmp_path) -> None:
    with pytest.raises(InputError, match="expected masks with a vessel, received 2 empty ones"):
        image_files.require_vessel(tmp_path, [np.zeros((2, 2), bool)] * 2)
    image_files.require_vessel(tmp_path, [np.zeros((2, 2), bool), np.ones((2, 2), bool)])
