import dataclasses

import pytest
import torch
from torch.nn import functional

from models.errors import InputError
from models.training.augmentation import PROBABILITIES, Augmentation, _Draw

NOTHING = Augmentation(**dict.fromkeys(PROBABILITIES, 0.0))


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def only(**settings: float) -> Augmentation:
    return dataclasses.replace(NOTHING, **settings)


def disc(count: int = 16, height: int = 48, width: int = 48, radius: float = 10.0) -> torch.Tensor:
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    inside = (row - height / 2) ** 2 + (column - width / 2) ** 2 < radius**2
    return inside.float().expand(count, 1, height, width).clone()


def moments(mask: torch.Tensor) -> tuple[float, float, float]:
    """Area, and deviation along rows and columns, in px."""
    place = torch.argwhere(mask[0] > 0).double()
    row_px, column_px = place.std(dim=0, unbiased=False).tolist()
    return float(mask.sum()), row_px, column_px


def test_chance_comes_from_the_generator_alone() -> None:
    images, masks = torch.rand(4, 1, 32, 32, generator=generator()), disc(4, 32, 32)
    augmentation = Augmentation()
    first = augmentation(images, masks, generator(3))
    torch.manual_seed(99)
    same = augmentation(images, masks, generator(3))
    other = augmentation(images, masks, generator(4))
    assert torch.equal(first[0], same[0]) and torch.equal(first[1], same[1])
    assert not torch.equal(first[0], other[0])
    again = generator(3)
    assert not torch.equal(augmentation(images, masks, again)[0], augmentation(images, masks, again)[0])


def test_images_stay_in_range_masks_stay_binary_and_images_of_a_batch_differ() -> None:
    everything = dataclasses.replace(Augmentation(), **dict.fromkeys(PROBABILITIES, 1.0))
    image = torch.rand(1, 1, 32, 32, generator=generator()).expand(8, 1, 32, 32)
    images, masks = everything(image, disc(8, 32, 32), generator())
    assert 0 <= float(images.min()) and float(images.max()) <= 1
    assert set(masks.unique().tolist()) == {0.0, 1.0}
    assert len({tuple(image.flatten().tolist()) for image in images}) == 8


def test_nothing_chosen_changes_nothing() -> None:
    images, masks = torch.rand(4, 1, 16, 16), disc(4, 16, 16, 4.0)
    assert all(
        torch.equal(a, b) for a, b in zip(NOTHING(images, masks, generator()), (images, masks), strict=True)
    )


@pytest.mark.parametrize(
    "settings",
    [
        {"affine": 1.0, "rotation_deg": 0.0, "scale": 0.0, "shift": 0.0, "shear": 0.0},
        {"elastic": 1.0, "elastic_shift": 0.0},
        {"brightness": 1.0, "brightness_shift": 0.0},
        {"contrast": 1.0, "contrast_factor": 0.0},
        {"gamma": 1.0, "gamma_factor": 0.0},
        {"speckle": 1.0, "speckle_deviation": 0.0},
        {"depth_gain": 1.0, "depth_gain_factor": 0.0},
    ],
)
def test_an_amount_of_zero_changes_nothing(settings: dict[str, float]) -> None:
    images, masks = torch.rand(4, 1, 24, 32), disc(4, 24, 32, 6.0)
    changed = only(**settings)(images, masks, generator())
    torch.testing.assert_close(changed[0], images, atol=1e-5, rtol=0)
    assert torch.equal(changed[1], masks)


def test_flip_is_left_to_right_for_about_its_share() -> None:
    images = torch.rand(400, 1, 6, 8)
    masks = (images > 0.5).float()
    flipped, flipped_masks = only(flip=0.3)(images, masks, generator())
    is_flipped = torch.isclose(flipped, images.flip(-1), atol=1e-5).all(dim=(1, 2, 3))
    is_same = torch.isclose(flipped, images, atol=1e-5).all(dim=(1, 2, 3))
    assert bool((is_flipped ^ is_same).all())
    assert 0.22 < float(is_flipped.float().mean()) < 0.38
    assert torch.equal(flipped_masks[is_flipped], masks[is_flipped].flip(-1))


def test_a_turn_keeps_a_disc_round_where_pixels_are_square_but_the_image_is_not() -> None:
    masks = disc(12, 48, 96, 12.0)
    moved = only(affine=1.0, rotation_deg=60.0, scale=0.0, shift=0.0, shear=0.0)(masks, masks, generator())[1]
    for mask in moved:
        area, row_px, column_px = moments(mask)
        assert area == pytest.approx(moments(masks[0])[0], rel=0.02)
        assert row_px == pytest.approx(column_px, rel=0.02)


def test_a_turn_is_by_the_angle() -> None:
    bar = torch.zeros(30, 1, 64, 64)
    bar[:, :, 30:34, 12:52] = 1
    moved = only(affine=1.0, rotation_deg=40.0, scale=0.0, shift=0.0, shear=0.0)(bar, bar, generator())[1]
    angles_deg = []
    for mask in moved:
        place = torch.argwhere(mask[0] > 0).double()
        _, axes = torch.linalg.eigh(torch.cov(place.T))
        angles_deg.append(float(torch.rad2deg(torch.atan(axes[0, 1] / axes[1, 1]))))
    assert max(map(abs, angles_deg)) <= 41
    assert max(angles_deg) > 20 and min(angles_deg) < -20


def test_scale_shift_and_shear_stay_within_their_bounds_and_use_them() -> None:
    masks = disc(60, 64, 64, 12.0)
    area = moments(masks[0])[0]
    scaled = only(affine=1.0, rotation_deg=0.0, scale=0.5, shift=0.0, shear=0.0)(masks, masks, generator())[1]
    ratios = [moments(mask)[0] / area for mask in scaled]
    assert 1 / 1.5**2 * 0.95 < min(ratios) < 0.6 and 1.7 < max(ratios) < 1.5**2 * 1.05
    shifted = only(affine=1.0, rotation_deg=0.0, scale=0.0, shift=0.2, shear=0.0)(masks, masks, generator())[
        1
    ]
    offsets_px = torch.stack([torch.argwhere(mask[0] > 0).double().mean(dim=0) - 31.5 for mask in shifted])
    assert 9 < float(offsets_px.abs().max()) < 0.2 * 64 + 0.5
    assert bool((offsets_px.min(dim=0).values < -5).all() and (offsets_px.max(dim=0).values > 5).all())


def test_image_and_mask_move_together() -> None:
    masks = disc(16)
    geometry = only(flip=0.5, affine=1.0, elastic=1.0, elastic_shift=0.1)
    images, moved = geometry(masks, masks, generator())
    assert torch.equal((images >= 0.5).float(), moved)
    assert not torch.equal(moved, masks)


def test_elastic_bends_a_disc() -> None:
    masks = disc(8)
    moved = only(elastic=1.0, elastic_shift=0.1)(masks, masks, generator())[1]
    assert max(abs(row - column) for _, row, column in map(moments, moved)) > 0.3


def test_geometry_is_that_of_the_general_operations() -> None:
    images, masks = torch.rand(6, 1, 20, 36, generator=generator()), disc(6, 20, 36, 7.0)
    geometry = only(flip=0.5, affine=0.8, elastic=0.6)
    draw = _Draw(6, images.device, generator(3))
    grid = functional.affine_grid(geometry._affine(draw, 36 / 20), [6, 1, 20, 36], align_corners=False)
    shifts = 2 * geometry.elastic_shift * draw.signed(2, 5, 5) * draw.chosen(0.6, 1, 1, 1)
    smooth = functional.interpolate(shifts, size=(20, 36), mode="bicubic", align_corners=True)
    expected = functional.grid_sample(images, grid + smooth.permute(0, 2, 3, 1), align_corners=False)
    torch.testing.assert_close(geometry(images, masks, generator(3))[0], expected, atol=1e-5, rtol=0)


def test_grey_changes_leave_masks_alone() -> None:
    images, masks = torch.rand(8, 1, 16, 16), disc(8, 16, 16, 4.0)
    grey = only(brightness=1.0, contrast=1.0, gamma=1.0, speckle=1.0, depth_gain=1.0)
    changed = grey(images, masks, generator())
    assert torch.equal(changed[1], masks) and not torch.equal(changed[0], images)


def test_brightness_adds_within_its_bound() -> None:
    images = torch.full((200, 1, 4, 4), 0.5)
    shift = only(brightness=1.0, brightness_shift=0.1)(images, images, generator())[0][:, 0, 0, 0] - 0.5
    assert float(shift.abs().max()) <= 0.1 + 1e-6
    assert float(shift.min()) < -0.08 and float(shift.max()) > 0.08


def test_contrast_stretches_about_the_mean_and_gamma_keeps_black_and_white() -> None:
    images = torch.tensor([0.4, 0.6]).reshape(1, 1, 1, 2).repeat(100, 1, 1, 1)
    stretched = only(contrast=1.0, contrast_factor=1.0)(images, images, generator())[0]
    width = (stretched[..., 1] - stretched[..., 0]).flatten() / 0.2
    torch.testing.assert_close(stretched.mean(dim=(1, 2, 3)), torch.full((100,), 0.5))
    assert 0.5 - 1e-4 <= float(width.min()) < 0.6 and 1.7 < float(width.max()) <= 2.0 + 1e-4
    ends = torch.tensor([0.0, 0.25, 1.0]).reshape(1, 1, 1, 3).repeat(100, 1, 1, 1)
    curved = only(gamma=1.0, gamma_factor=1.0)(ends, ends, generator())[0][:, 0, 0]
    assert bool((curved[:, 0] == 0).all() and (curved[:, 2] == 1).all())
    assert 0.25**2 - 1e-4 <= float(curved[:, 1].min()) < 0.1 and 0.4 < float(curved[:, 1].max()) <= 0.5 + 1e-4


def test_depth_gain_runs_evenly_down_the_image() -> None:
    images = torch.full((50, 1, 9, 4), 0.4)
    gain = only(depth_gain=1.0, depth_gain_factor=1.0)(images, images, generator())[0] / 0.4
    torch.testing.assert_close(gain[..., :1].expand_as(gain), gain)
    torch.testing.assert_close(gain[:, :, 4], torch.ones(50, 1, 4))
    torch.testing.assert_close(gain[:, :, 0] * gain[:, :, 8], torch.ones(50, 1, 4))
    assert float(gain[:, :, 8].max()) > 1.7 and float(gain[:, :, 8].min()) < 0.6


def test_speckle_has_its_deviation_and_grain_and_spares_black() -> None:
    images = torch.full((20, 1, 64, 64), 0.5)
    images[:, :, :, :8] = 0
    noisy = only(speckle=1.0, speckle_deviation=0.2, speckle_grain_px=1)(images, images, generator())[0]
    assert float(noisy[:, :, :, :8].abs().max()) == 0
    assert float(noisy[:, :, :, 8:].std()) == pytest.approx(0.1, rel=0.05)
    flat = torch.full((40, 1, 96, 96), 0.5)
    for grain in (2, 3, 8):  # off the margin, where there is less to interpolate between
        grainy = only(speckle=1.0, speckle_grain_px=grain, speckle_deviation=0.2)(flat, flat, generator())[0]
        assert float(grainy[:, :, 4:-4, 4:-4].std()) == pytest.approx(0.1, rel=0.05)
    coarse = only(speckle=1.0, speckle_grain_px=8)(images, images, generator())[0][:, 0, 32, 8:]
    steps, spread = (coarse[:, 1:] - coarse[:, :-1]).std(), coarse.std()
    assert float(steps / spread) < 0.5  # white noise would have a ratio of 1.4


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"flip": 1.5}, "flip: expected a probability 0 to 1, received 1.5"),
        ({"elastic": -0.1}, "elastic: expected a probability"),
        ({"scale": -1.0}, "scale: expected a number from 0, received -1.0"),
        ({"shift": float("nan")}, "shift: expected a number from 0, received nan"),
        ({"elastic_nodes": 1}, "elastic_nodes: expected at least 2, received 1"),
        ({"speckle_grain_px": 0}, "speckle_grain_px: expected at least 1, received 0"),
    ],
)
def test_refuses_settings(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Augmentation(**settings)
