import numpy as np
import pytest
import torch
from drawn_screens import cross_hairs, rectangle, speckle, written

from models.errors import InputError
from models.preprocessing.preprocessing import Placement, Preprocessing
from models.preprocessing.sector import find_sector


@pytest.mark.parametrize(
    ("native", "expected"),
    [
        ((512, 534), Placement((512, 534), (92, 96), (2, 0), (0, 0, 512, 534))),
        ((200, 50), Placement((200, 50), (96, 24), (0, 36), (0, 0, 200, 50))),
        ((96, 96), Placement((96, 96), (96, 96), (0, 0), (0, 0, 96, 96))),
        ((10, 20), Placement((10, 20), (48, 96), (24, 0), (0, 0, 10, 20))),
        ((1, 2000), Placement((1, 2000), (1, 96), (47, 0), (0, 0, 1, 2000))),
    ],
)
def test_placement_keeps_the_aspect_and_centres(native: tuple[int, int], expected: Placement) -> None:
    assert Preprocessing(96).placement(*native) == expected


def test_a_frame_of_the_networks_size_passes_unchanged() -> None:
    frames = torch.randint(0, 256, (2, 16, 16), dtype=torch.uint8)
    torch.testing.assert_close(Preprocessing(16)(frames)[:, 0], frames.float() / 255)


def test_halving_averages_and_padding_is_black() -> None:
    frames = torch.zeros(1, 8, 16, dtype=torch.uint8)
    frames[:, :, 8:] = 200
    square = Preprocessing(8)(frames)[0, 0]
    assert float(square[:2].abs().max()) == float(square[-2:].abs().max()) == 0
    assert square[2:6, 0].tolist() == pytest.approx([0] * 4)
    assert square[2:6, 7].tolist() == pytest.approx([200 / 255] * 4)


def test_masks_follow_their_frames() -> None:
    masks = torch.zeros(1, 40, 80, dtype=torch.bool)
    masks[:, 10:20, 40:60] = True
    frames = masks.to(torch.uint8) * 255
    stage = Preprocessing(40)
    mask = stage.mask(masks)
    assert mask[0, 0, 15:20, 20:30].min() == 1 and mask.sum() == 50
    assert torch.equal(mask, (stage(frames) >= 0.5).float())


def test_standard_normalisation_is_of_each_image_and_survives_a_uniform_one() -> None:
    images = torch.rand(3, 1, 8, 8) * torch.tensor([1.0, 0.1, 0.0]).reshape(3, 1, 1, 1) + 0.2
    result = Preprocessing(8).normalise(images)
    assert result.mean(dim=(1, 2, 3)).abs().max() < 1e-4
    assert result[:2].std(dim=(1, 2, 3), unbiased=False).tolist() == pytest.approx([1, 1], rel=1e-3)
    assert result[2].abs().max() < 1e-3
    assert torch.equal(Preprocessing(8, "unit").normalise(images), images)


@pytest.mark.parametrize("native", [(30, 50), (200, 90), (64, 64), (513, 301)])
def test_restoring_brings_a_mask_back_to_where_it_was(native: tuple[int, int]) -> None:
    stage = Preprocessing(64)
    row, column = np.mgrid[: native[0], : native[1]]
    centre = (0.4 * native[0], 0.6 * native[1])
    radius = 0.25 * min(native)
    mask = torch.from_numpy((row - centre[0]) ** 2 + (column - centre[1]) ** 2 < radius**2)[None]
    maps = stage.restore(stage(mask.to(torch.uint8) * 255), stage.placement(*native))
    assert maps.shape == (1, *native)
    back = (maps >= 0.5)[0].numpy()
    overlap = 2 * (back & mask[0].numpy()).sum() / (back.sum() + mask.sum())
    assert float(overlap) > 0.97
    # A shift of half a network pixel would show in the centre of mass.
    pixel = max(native) / 64
    for axis, place in enumerate(centre):
        assert np.argwhere(back).mean(axis=0)[axis] == pytest.approx(place, abs=0.2 * max(pixel, 1))


def screen() -> np.ndarray:
    frame = np.where(INSIDE, speckle(INSIDE.shape), 0).astype(np.uint8)
    return written(cross_hairs(frame, (50, 90), 12), "TEXT", (85, 10))


INSIDE = rectangle((100, 150), 10, 40, 80, 140)
HALF = ((0.0, 0.5), (0.0, 1.0), (1.0, 1.0), (1.0, 0.5))


def test_nothing_is_cleaned_unless_asked_for() -> None:
    frames = screen()[None]
    assert Preprocessing(64).clean(frames) is frames
    # What an image was before there was any cleaning.
    plain = torch.nn.functional.interpolate(
        torch.tensor(frames)[:, None].float() / 255, size=(43, 64), mode="bilinear", antialias=True
    )
    assert torch.equal(Preprocessing(64)(torch.tensor(frames))[:, :, 10:53], plain.clamp(0, 1))


def test_cleaning_blanks_all_outside_the_sector_and_paints_over_the_cross_hairs() -> None:
    frame = screen()
    clean = Preprocessing(64, sector="auto", overlays="auto").clean(frame[None])[0]
    assert frame[~INSIDE].max() == 255 and clean[~INSIDE].max() == 0
    assert frame[INSIDE].max() == 255 and clean[INSIDE].max() <= 200
    only = Preprocessing(64, sector="auto").clean(frame[None])[0]
    np.testing.assert_array_equal(only, np.where(find_sector(frame, 0), frame, 0))
    given = Preprocessing(64, sector=[[0.1, 40 / 150], [0.8, 40 / 150], [0.8, 140 / 150], [0.1, 140 / 150]])
    np.testing.assert_array_equal(given.clean(frame[None])[0], only)


def test_each_frame_is_cleaned_by_itself() -> None:
    frames = np.stack([screen(), screen()[:, ::-1], speckle((100, 150))])
    stage = Preprocessing(64, sector="auto", overlays="auto")
    together = stage(torch.tensor(frames))
    for frame, result in zip(frames, together, strict=True):
        assert torch.equal(stage(torch.tensor(frame[None]))[0], result)
    assert stage(torch.zeros(0, 20, 30, dtype=torch.uint8)).shape == (0, 1, 64, 64)


def test_cleaning_leaves_the_frames_it_was_given_alone() -> None:
    frames = screen()[None]
    before = frames.copy()
    frames.flags.writeable = False
    Preprocessing(64, sector="auto", overlays="auto").clean(frames)
    np.testing.assert_array_equal(frames, before)


def test_a_crop_gives_the_sector_the_whole_square_and_masks_follow() -> None:
    stage = Preprocessing(50, "unit", sector=HALF, crop=True)
    assert stage.placement(100, 100) == Placement((100, 100), (50, 25), (0, 12), (0, 50, 100, 100))
    mask = torch.zeros(1, 100, 100, dtype=torch.bool)
    mask[0, 20:40, 60:80] = True
    mask[0, 60:80, 10:30] = True  # cut off
    square = stage.mask(mask)
    assert square[0, 0, 10:20, 17:27].min() == 1 and square.sum() == 100
    assert torch.equal(square, (stage(mask.to(torch.uint8) * 255) >= 0.5).float())
    back = stage.restore(square, stage.placement(100, 100))
    assert back.shape == (1, 100, 100) and float(back[0, :, :50].abs().max()) == 0
    kept = mask.clone()
    kept[0, :, :50] = False
    assert torch.equal(back >= 0.5, kept)


@pytest.mark.parametrize("native", [(90, 240), (301, 77)])
def test_restoring_a_crop_brings_a_mask_back_to_where_it_was(native: tuple[int, int]) -> None:
    stage = Preprocessing(64, sector=[[0.2, 0.1], [0.9, 0.1], [0.9, 0.95], [0.2, 0.95]], crop=True)
    row, column = np.mgrid[: native[0], : native[1]]
    centre, radius = (0.55 * native[0], 0.6 * native[1]), 0.2 * min(native)
    mask = (row - centre[0]) ** 2 + (column - centre[1]) ** 2 < radius**2
    square = stage.mask(torch.from_numpy(mask)[None])
    back = (stage.restore(square, stage.placement(*native)) >= 0.5)[0].numpy()
    assert 2 * (back & mask).sum() / (back.sum() + mask.sum()) > 0.9
    for axis, place in enumerate(centre):
        assert np.argwhere(back).mean(axis=0)[axis] == pytest.approx(place, abs=1.0)


def test_statistics_of_the_sector_do_not_count_the_black_around_it() -> None:
    stage = Preprocessing(32, "standard_sector")
    lit = torch.rand(2, 1, 32, 20) * 0.4 + 0.2
    framed = torch.zeros(2, 1, 32, 32)
    framed[..., 6:26] = lit
    whole = torch.nn.functional.pad(lit, (0, 12), value=0.0)
    result = stage.normalise(framed)[..., 6:26]
    assert result.mean(dim=(1, 2, 3)).abs().max() < 1e-4
    assert result.std(dim=(1, 2, 3), unbiased=False).tolist() == pytest.approx([1, 1], rel=1e-3)
    # Where in the square the sector lies, and what augmentation adds to all grey values, changes nothing.
    torch.testing.assert_close(stage.normalise(whole)[..., :20], result)
    torch.testing.assert_close(stage.normalise(framed * 1.2 + 0.1)[..., 6:26], result, rtol=1e-3, atol=1e-4)
    assert stage.normalise(torch.full((1, 1, 8, 8), 0.3)).abs().max() < 1e-3


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"image_size_px": 0}, "image_size_px: expected a positive size, received 0"),
        (
            {"image_size_px": 8, "normalisation": "max"},
            "normalisation: expected one of standard, standard_sector",
        ),
        ({"image_size_px": 8, "overlays": "all"}, "overlays: expected one of none, auto, received 'all'"),
        ({"image_size_px": 8, "sector": "fan"}, "sector: expected none, auto or at least three corners"),
        ({"image_size_px": 8, "sector": [[0, 0], [1, 1]]}, "sector: expected none, auto or at least three"),
        (
            {"image_size_px": 8, "crop": True},
            "crop: expected a sector given by its corners, received sector none",
        ),
        ({"image_size_px": 8, "sector": "auto", "crop": True}, "crop: .* received sector auto"),
        ({"image_size_px": 8, "ground_tolerance": -1}, "ground_tolerance: expected 0 to 255 grey levels"),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Preprocessing(**settings)
