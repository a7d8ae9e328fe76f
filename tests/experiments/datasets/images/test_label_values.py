"""Masks in every form that programs write them in: the same labels, or one sentence why not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from stored_pngs import PALETTE, write_png

from experiments.datasets.images.image_files import read_mask
from experiments.errors import InputError

VESSEL = np.zeros((40, 60), dtype=bool)
VESSEL[10:22, 20:35] = True
LABELS = VESSEL.astype(np.uint8)
LABELS[5:9, 40:50] = 2
LABELS[30:35, 3:9] = 3
BINARY: tuple[tuple[Sequence[int], Sequence[int]], ...] = (((1, 255), (0,)), ((255,), (0,)), ((1,), (0,)))
COLOURS = [(0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0)]


def palette_image(
    path: Path, indices: np.ndarray, colours: Sequence[tuple[int, ...]], **info: object
) -> Path:
    image = Image.fromarray(indices.astype(np.uint8), "P")
    image.putpalette([level for colour in colours for level in colour])
    image.save(path, **info)  # type: ignore[arg-type]
    return path


def saved(path: Path, pixels: np.ndarray, **more: object) -> Path:
    Image.fromarray(pixels).save(path, **more)  # type: ignore[arg-type]
    return path


def filled(colour: Sequence[int], alpha: np.ndarray) -> np.ndarray:
    """One colour everywhere, and the mask in the alpha channel."""
    return np.dstack([*(np.full(alpha.shape, level, np.uint8) for level in colour), alpha.astype(np.uint8)])


FULL = VESSEL.astype(np.uint8) * 255
FORMS = {
    "palette, black first": lambda path: palette_image(path, VESSEL, [(0, 0, 0), (255, 255, 255)]),
    "palette, white first": lambda path: palette_image(path, ~VESSEL, [(255, 255, 255), (0, 0, 0)]),
    "palette of 1 bit, white first": lambda path: palette_image(
        path, ~VESSEL, [(255, 255, 255), (0, 0, 0)], bits=1
    ),
    "palette, red on black": lambda path: palette_image(path, VESSEL, [(0, 0, 0), (255, 0, 0)]),
    "palette, red first": lambda path: palette_image(path, ~VESSEL, [(255, 0, 0), (0, 0, 0)]),
    "palette, background transparent": lambda path: palette_image(
        path, VESSEL, [(255, 255, 255), (255, 0, 0)], transparency=0
    ),
    "palette, one colour, transparent": lambda path: palette_image(
        path, VESSEL, [(255, 255, 255), (255, 255, 255)], transparency=0
    ),
    "1 bit": lambda path: saved(path, VESSEL),
    "2 bits, black and white": lambda path: write_png(path, VESSEL * 3, 2),
    "16 bits, black and white": lambda path: saved(path, VESSEL.astype(np.uint16) * 65535),
    "red on black": lambda path: saved(path, np.dstack([FULL, FULL * 0, FULL * 0])),
    "alpha of white": lambda path: saved(path, filled((255, 255, 255), FULL)),
    "alpha of black": lambda path: saved(path, filled((0, 0, 0), FULL)),
    "alpha of grey": lambda path: saved(path, filled((255,), FULL)),
    "red on transparent white": lambda path: saved(
        path, np.dstack([np.full_like(FULL, 255), ~FULL, ~FULL, FULL])
    ),
    "red on black, alpha unused": lambda path: saved(path, np.dstack([FULL, FULL * 0, FULL * 0, FULL * 0])),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("vessel", "others"), BINARY)
def test_a_mask_of_one_vessel_is_the_same_in_every_form(
    tmp_path: Path, form: str, vessel: Sequence[int], others: Sequence[int]
) -> None:
    path = FORMS[form](tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(path, vessel, others, VESSEL.shape), VESSEL)


@pytest.mark.parametrize("bits", [2, 4, 8, 16])
@pytest.mark.parametrize("label", [1, 2, 3])
def test_labels_of_few_bits_are_the_numbers_that_are_stored(tmp_path: Path, bits: int, label: int) -> None:
    path = write_png(tmp_path / "m.png", LABELS.astype(np.uint16), bits)
    np.testing.assert_array_equal(read_mask(path, {label}, {0, 1, 2, 3} - {label}), LABELS == label)


def test_a_label_map_of_one_bit_holds_label_1(tmp_path: Path) -> None:
    path = saved(tmp_path / "m.png", VESSEL)
    np.testing.assert_array_equal(read_mask(path, {1}, {0, 2}), VESSEL)
    assert not read_mask(path, {2}, {0, 1}).any()


@pytest.mark.parametrize("bits", [2, 4, 8])
def test_a_palette_of_distinct_colours_holds_its_indices(tmp_path: Path, bits: int) -> None:
    path = write_png(
        tmp_path / "m.png", LABELS, bits, PALETTE, PLTE=b"".join(bytes(colour) for colour in COLOURS)
    )
    for label in (1, 2, 3):
        np.testing.assert_array_equal(read_mask(path, {label}, {0, 1, 2, 3} - {label}), LABELS == label)


def test_grey_colours_of_a_palette_that_are_labels_go_before_indices(tmp_path: Path) -> None:
    """What a program that packs PNG files makes of a label image: the same greys, other indices."""
    order = [3, 0, 2, 1]
    path = palette_image(tmp_path / "m.png", np.argsort(order)[LABELS], [(grey,) * 3 for grey in order])
    np.testing.assert_array_equal(read_mask(path, {2}, {0, 1, 3}), LABELS == 2)
    ramp = palette_image(tmp_path / "r.png", LABELS, [(grey,) * 3 for grey in (0, 85, 170, 255)])
    np.testing.assert_array_equal(read_mask(ramp, {2}, {0, 1, 3}), LABELS == 2)


@pytest.mark.parametrize(
    ("colours", "found"),
    [
        ([(128, 0, 0), (0, 0, 0), (0, 128, 0), (128, 128, 0)], r"first colour \(128, 0, 0\)"),
        ([(255, 255, 255), (128, 0, 0), (0, 128, 0), (128, 128, 0)], r"first colour \(255, 255, 255\)"),
        (
            [(0, 0, 0), (128, 0, 0), (128, 0, 0), (128, 128, 0)],
            r"first colour \(0, 0, 0\) and 4 entries in use",
        ),
    ],
)
def test_a_palette_whose_indices_may_have_been_sorted_anew_is_refused(
    tmp_path: Path, colours: list[tuple[int, ...]], found: str
) -> None:
    path = palette_image(tmp_path / "m.png", LABELS, colours)
    with pytest.raises(
        InputError, match=rf"m\.png: expected a palette whose first colour is black .*{found}.*grey"
    ):
        read_mask(path, {2}, {0, 1, 3})


def test_a_black_and_white_mask_is_no_answer_where_several_labels_could_be_meant(tmp_path: Path) -> None:
    path = palette_image(tmp_path / "m.png", ~VESSEL, [(255, 255, 255), (0, 0, 0)])
    with pytest.raises(InputError, match=r"m\.png: expected a palette whose first colour is black"):
        read_mask(path, {2}, {0, 1})
    for name, pixels in (("l.png", FULL), ("deep.png", VESSEL.astype(np.uint16) * 65535)):
        with pytest.raises(InputError, match=rf"{name}: expected labels 0, 1, 2, received {pixels.max()}"):
            read_mask(saved(tmp_path / name, pixels), {2}, {0, 1})


def test_colours_without_a_rule_are_refused(tmp_path: Path) -> None:
    colours = np.array(COLOURS, dtype=np.uint8)[LABELS]
    with pytest.raises(
        InputError, match=r"m\.png: expected a mask in grey values, .* received 4 colours .*grey image"
    ):
        read_mask(saved(tmp_path / "m.png", colours), {1, 255}, {0})
    soft = FULL.copy()
    soft[9, 20:35] = 128
    with pytest.raises(
        InputError, match=r"a\.png: expected a mask with pixels either opaque .*an alpha of 128"
    ):
        read_mask(saved(tmp_path / "a.png", filled((255, 255, 255), soft)), {1, 255}, {0})
    hidden = np.dstack([~FULL, FULL * 0, FULL * 0, FULL])
    with pytest.raises(InputError, match=r"h\.png: expected a mask in colours or in transparency"):
        read_mask(saved(tmp_path / "h.png", hidden), {1, 255}, {0})


def test_a_black_and_white_mask_survives_jpeg_and_nothing_else_does(tmp_path: Path) -> None:
    for vessel, others in BINARY:
        path = saved(tmp_path / "m.jpg", FULL, quality=80)
        assert len(np.unique(np.asarray(Image.open(path)))) > 2
        np.testing.assert_array_equal(read_mask(path, vessel, others), VESSEL)
    assert not read_mask(saved(tmp_path / "empty.jpg", FULL * 0), {255}, {0}).any()
    for pixels, vessel, others in (
        (FULL, {2}, {0, 1}),
        (VESSEL.astype(np.uint8) * 9, {1, 255}, {0}),
        (FULL // 2, {1, 255}, {0}),
    ):
        path = saved(tmp_path / "m.jpg", pixels)
        with pytest.raises(InputError, match=r"m\.jpg: expected labels in a file format that keeps values"):
            read_mask(path, vessel, others)


def test_1_and_255_in_one_mask_are_not_both_the_vessel(tmp_path: Path) -> None:
    labels = LABELS.copy()
    labels[labels > 1] = 255
    path = saved(tmp_path / "m.png", labels)
    with pytest.raises(
        InputError, match=r"m\.png: expected a mask of 0 and 1 or of 0 and 255, received one with both"
    ):
        read_mask(path, (1, 255), (0,))
    np.testing.assert_array_equal(read_mask(path, (1,), (0, 255)), VESSEL)


def test_a_mask_lies_on_its_image_however_both_are_turned(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6
    path = saved(tmp_path / "m.png", np.ascontiguousarray(np.rot90(FULL)), exif=exif)
    np.testing.assert_array_equal(read_mask(path, (255,), (0,), VESSEL.shape), VESSEL)
