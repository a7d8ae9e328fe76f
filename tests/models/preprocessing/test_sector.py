from pathlib import Path

import numpy as np
import pytest
from drawn_screens import disc, fan, rectangle, speckle, written
from PIL import Image

from models.errors import InputError
from models.preprocessing.grey import echo_grey
from models.preprocessing.sector import bounding_box, checked_corners, find_sector, sector_of

SIZE = (240, 320)
LINEAR = rectangle(SIZE, 20, 70, 210, 260)
CURVED = fan(SIZE, (-40.0, 160.0), (70.0, 260.0), 32.0)
PHASED = fan(SIZE, (8.0, 150.0), (0.0, 220.0), 40.0)
STEERED = np.array(
    [
        [20 <= row < 200 and 60 + row // 4 <= column < 200 + row // 4 for column in range(320)]
        for row in range(240)
    ]
)


def screen(inside: np.ndarray, ground: int = 0) -> np.ndarray:
    frame = np.where(inside, np.maximum(speckle(inside.shape), ground + 2), ground).astype(np.uint8)
    for place, text in (((4, 4), "CLINIC"), ((224, 232), "MI 0.8 TIS"), ((100, 4), "3 cm")):
        frame = written(frame, text, place)
    frame[40:200:20, 312:318] = 255  # depth scale
    frame[60:180, 300:304] = np.linspace(255, 0, 120, dtype=np.uint8)[:, None]  # grey bar
    return frame


def overlap(found: np.ndarray, truth: np.ndarray) -> float:
    return float((found & truth).sum() / (found | truth).sum())


@pytest.mark.parametrize("ground", [0, 16])
@pytest.mark.parametrize(
    "truth", [LINEAR, CURVED, PHASED, STEERED], ids=["linear", "curved", "phased", "steered"]
)
def test_finds_the_drawn_sector_and_nothing_of_the_text_around_it(truth: np.ndarray, ground: int) -> None:
    found = find_sector(screen(truth, ground), 0)
    assert overlap(found, truth) > 0.985
    # All echoes but for a pixel's width at the edge.
    assert (truth & ~found).sum() < 0.004 * truth.sum()


def test_a_rectangle_is_found_to_the_pixel() -> None:
    frame = np.where(LINEAR, speckle(SIZE), 0).astype(np.uint8)
    np.testing.assert_array_equal(find_sector(frame, 0), LINEAR)


def test_text_above_a_curved_face_is_outside() -> None:
    above = ~CURVED & fan(SIZE, (-40.0, 160.0), (0.0, 65.0), 20.0)
    assert above.sum() > 300
    assert not (find_sector(screen(CURVED), 0) & above).any()


@pytest.mark.parametrize("truth", [LINEAR, CURVED], ids=["linear", "curved"])
def test_anechoic_areas_belong_to_the_sector(truth: np.ndarray) -> None:
    frame = screen(truth)
    dark = truth & (disc(SIZE, (110, 150), 30) | disc(SIZE, (150, 190), 22))
    frame[dark] = 0
    found = find_sector(frame, 0)
    assert found[dark].all()
    assert overlap(found, truth) > 0.98


def test_a_shadow_through_the_whole_depth_does_not_divide_the_sector() -> None:
    frame = screen(LINEAR)
    frame[20:210, 200:225] = 0
    np.testing.assert_array_equal(find_sector(frame, 0), LINEAR)


def test_what_lies_below_a_dark_layer_is_kept() -> None:
    frame = np.where(LINEAR, speckle(SIZE), 0).astype(np.uint8)
    frame[110:190, 70:260] = 0
    frame[190:, :165] = 0
    assert find_sector(frame, 0)[195:209, 170:255].all()


def test_a_rectangle_keeps_its_dark_corner() -> None:
    frame = np.where(LINEAR, speckle(SIZE), 0).astype(np.uint8)
    frame[120:, 180:] = 0
    np.testing.assert_array_equal(find_sector(frame, 0), LINEAR)


def test_noise_of_a_grabbed_ground_is_not_echo_within_the_tolerance() -> None:
    noise = np.random.default_rng(1).integers(0, 7, SIZE).astype(np.uint8)
    frame = np.where(LINEAR, np.maximum(speckle(SIZE), 20), noise).astype(np.uint8)
    assert overlap(find_sector(frame, 8), LINEAR) > 0.99
    assert find_sector(frame, 0).all()


def test_a_frame_without_ground_or_without_echoes_is_all_sector() -> None:
    assert find_sector(speckle(SIZE), 0).all()
    assert find_sector(np.zeros(SIZE, np.uint8), 0).all()
    assert find_sector(written(np.zeros(SIZE, np.uint8), "no signal", (100, 100)), 0).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 40), (40, 3), (17, 23)])
def test_small_frames_are_taken(size: tuple[int, int]) -> None:
    assert find_sector(np.full(size, 90, np.uint8), 0).all()


def test_no_echo_of_real_frames_is_lost(real_data: Path) -> None:
    """Outside the sector there is nothing brighter than 6, but for the maker's sign at the upper left."""
    for path in sorted((real_data / "usgra" / "images").glob("*.png"))[::6]:
        frame = echo_grey(np.asarray(Image.open(path)))
        outside = ~find_sector(frame, 0)
        outside[:40, :80] = False
        assert frame[outside].max(initial=0) <= 6, path.name


def test_corners_are_shares_of_any_size() -> None:
    half = checked_corners([[0, 0.5], [0, 1], [1, 1], [1, 0.5]])
    for size in ((10, 20), (33, 64)):
        inside = sector_of(half, *size)
        assert inside[:, size[1] // 2 :].all() and not inside[:, : size[1] // 2].any()
    assert sector_of(checked_corners([[0, 0], [0, 1], [1, 1], [1, 0]]), 7, 9).all()
    assert sector_of(checked_corners([[0, 0], [0, 1], [1, 0]]), 100, 200).mean() == pytest.approx(
        0.5, abs=0.01
    )


def test_the_bounding_box_holds_every_pixel_of_the_sector() -> None:
    corners = checked_corners([[0.101, 0.5], [0.5, 0.25], [0.9, 0.52]])
    top, left, bottom, right = bounding_box(corners, 100, 200)
    assert (top, left, bottom, right) == (10, 50, 90, 104)
    assert sector_of(corners, 100, 200).sum() == sector_of(corners, 100, 200)[top:bottom, left:right].sum()
    assert bounding_box(checked_corners([[1, 1], [1, 0.999], [0.999, 1]]), 10, 10) == (9, 9, 10, 10)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ("fan", "expected none, auto or at least three corners"),
        ([[0, 0], [1, 1]], "at least three corners"),
        ([[0, 0, 0], [1, 1, 1], [0, 1, 0]], r"corners \[row, column\]"),
        ([[0, 0], [1], [0, 1]], "at least three corners"),
        ([[0, 0], [1, float("nan")], [0, 1]], "at least three corners"),
        ([[0, 0], [100, 0], [100, 100]], "as shares 0 to 1"),
        ([[0, 0], [0.5, 0.5], [1, 1]], "enclose an area"),
    ],
)
def test_refuses_corners(corners: object, message: str) -> None:
    with pytest.raises(InputError, match=f"sector: .*{message}"):
        checked_corners(corners)
