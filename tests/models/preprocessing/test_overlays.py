from pathlib import Path

import numpy as np
import pytest
from drawn_screens import cross_hairs, disc, speckle, written
from PIL import Image
from scipy.ndimage import gaussian_filter

from models.preprocessing.grey import echo_grey, to_grey
from models.preprocessing.overlays import without_colour_marks, without_white_strokes

SIZE = (160, 200)
TISSUE = speckle(SIZE)


def ink(marked: np.ndarray, clean: np.ndarray = TISSUE) -> np.ndarray:
    return marked.astype(int) - clean > 40


@pytest.mark.parametrize(
    "marked",
    [
        cross_hairs(TISSUE, (80, 100), 20),
        np.where(np.add.outer(np.arange(160), np.arange(200)) % 320 == 150, 255, TISSUE).astype(np.uint8),
    ],
    ids=["cross-hairs", "diagonal line"],
)
def test_white_graphics_give_way_to_speckle_of_the_same_statistics(marked: np.ndarray) -> None:
    clean = without_white_strokes(marked)
    where = ink(marked)
    assert where.sum() > 50
    # Mean within three standard errors (a grain has about 6 pixels), deviation alike, nothing white left.
    error = TISSUE.std() / np.sqrt(where.sum() / 6)
    assert clean[where].mean() == pytest.approx(TISSUE.mean(), abs=3 * error)
    assert 0.6 < clean[where].std() / TISSUE.std() < 1.4
    assert clean.max() <= TISSUE.max()
    assert (clean != TISSUE).mean() < 0.06


@pytest.mark.parametrize("size", [14, 20, 28])
def test_most_of_a_letter_goes_with_its_soft_edges(size: int) -> None:
    marked = written(TISSUE, "CCA L 3.2", (60, 40), size)
    excess = [
        (frame.astype(int) - TISSUE)[ink(marked)].clip(0).sum()
        for frame in (marked, without_white_strokes(marked))
    ]
    assert excess[1] < 0.4 * excess[0]


def test_only_the_graphic_and_its_edge_are_touched() -> None:
    clean = without_white_strokes(cross_hairs(TISSUE, (80, 100), 20))
    row, column = np.nonzero(clean != TISSUE)
    assert np.minimum(np.abs(row - 80), np.abs(column - 100)).max() <= 2
    assert np.abs(row - 80).max() <= 22 and np.abs(column - 100).max() <= 22


def test_a_frame_without_graphics_is_the_same_object() -> None:
    assert without_white_strokes(TISSUE) is TISSUE
    colours = np.dstack([TISSUE] * 3)
    assert without_colour_marks(colours) is colours


@pytest.mark.parametrize("thick_px", [2, 4, 9])
def test_a_specular_echo_stays_although_it_saturates(thick_px: int) -> None:
    row = np.arange(160)[:, None] - 80 - 0.1 * np.arange(200)
    echo = gaussian_filter(np.where(np.abs(row) < thick_px, 3000.0 / thick_px, 0.0), 2)
    frame = np.clip(TISSUE + echo, 0, 255).astype(np.uint8)
    assert (frame == 255).sum() > 300
    np.testing.assert_array_equal(without_white_strokes(frame), frame)


def test_a_broad_white_area_stays() -> None:
    frame = TISSUE.copy()
    frame[40:60, 40:60] = 255
    np.testing.assert_array_equal(without_white_strokes(frame), frame)


def test_a_white_frame_stays() -> None:
    white = np.full((20, 30), 255, np.uint8)
    np.testing.assert_array_equal(without_white_strokes(white), white)
    np.testing.assert_array_equal(without_white_strokes(white[:1, :1]), white[:1, :1])


def test_nothing_of_real_frames_is_taken_for_white_graphics(real_data: Path) -> None:
    saturated = 0
    for path in sorted((real_data / "usgra" / "images").glob("*.png"))[::3]:
        frame = echo_grey(np.asarray(Image.open(path)))
        saturated += int((frame >= 250).any())
        np.testing.assert_array_equal(without_white_strokes(frame), frame)
    assert saturated >= 3


@pytest.mark.parametrize("colour", [(255, 255, 0), (0, 255, 255), (0, 160, 0)])
def test_coloured_marks_give_way_to_the_speckle_around_them(colour: tuple[int, int, int]) -> None:
    marked = cross_hairs(np.dstack([TISSUE] * 3), (80, 100), 15, colour)
    clean = to_grey(without_colour_marks(marked))
    where = (marked != TISSUE[..., None]).any(axis=2)
    assert where.sum() == 61
    assert clean[where].mean() == pytest.approx(TISSUE.mean(), abs=3 * TISSUE.std() / np.sqrt(61 / 6))
    row, column = np.nonzero(clean != TISSUE)
    assert np.minimum(np.abs(row - 80), np.abs(column - 100)).max() <= 2


def test_a_colour_doppler_area_is_no_mark() -> None:
    frame = np.dstack([TISSUE] * 3)
    frame[disc(SIZE, (80, 100), 25)] = (200, 30, 20)
    np.testing.assert_array_equal(without_colour_marks(frame), frame)


def test_a_tinted_screen_says_nothing_by_its_colour() -> None:
    sepia = np.rint(TISSUE[..., None] * np.array([1.0, 0.75, 0.3])).astype(np.uint8)
    assert ((sepia.max(axis=2) - sepia.min(axis=2)) >= 64).any()
    np.testing.assert_array_equal(without_colour_marks(sepia), sepia)


def test_the_makers_sign_on_real_frames_goes_and_all_else_stays(real_data: Path) -> None:
    for name, signed in (("0083", True), ("0227", False), ("0050", False)):
        frame = np.asarray(Image.open(real_data / "usgra" / "images" / f"{name}.png"))
        changed = echo_grey(frame) != to_grey(frame)
        assert bool(changed.any()) == signed
        assert not changed[40:].any() and not changed[:, 80:].any()
