import numpy as np
import pytest
import torch

from models.errors import InputError
from models.preprocessing import Placement, Preprocessing, to_grey


def test_grey_of_a_grey_screen_is_itself_in_any_number_of_channels() -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert to_grey(grey) is grey
    np.testing.assert_array_equal(to_grey(np.stack([grey] * 3, axis=-1)), grey)
    np.testing.assert_array_equal(to_grey(np.dstack([grey] * 3 + [np.full_like(grey, 9)])), grey)


def test_grey_of_colours_is_their_luma() -> None:
    colours = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], dtype=np.uint8)
    assert to_grey(colours).tolist() == [[76, 150, 29, 255]]


def test_refuses_other_shapes() -> None:
    with pytest.raises(InputError, match=r"image: expected shape .* received \(3, 4, 2\)"):
        to_grey(np.zeros((3, 4, 2), np.uint8))


@pytest.mark.parametrize(
    ("native", "expected"),
    [
        ((512, 534), Placement((512, 534), (92, 96), (2, 0))),
        ((200, 50), Placement((200, 50), (96, 24), (0, 36))),
        ((96, 96), Placement((96, 96), (96, 96), (0, 0))),
        ((10, 20), Placement((10, 20), (48, 96), (24, 0))),
        ((1, 2000), Placement((1, 2000), (1, 96), (47, 0))),
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


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"image_size_px": 0}, "image_size_px: expected a positive size, received 0"),
        ({"image_size_px": 8, "normalisation": "max"}, "normalisation: expected one of standard, unit"),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Preprocessing(**settings)
