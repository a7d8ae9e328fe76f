import pytest
import torch
from discs import discs, generator, moments
from torch.nn import functional

from models.errors import InputError
from models.training.augmentation import Affine, Augmentation, Elastic, Flip, RandomDraws


def moved(masks: torch.Tensor, *transforms: object) -> torch.Tensor:
    return Augmentation(transforms)(masks, masks, generator())[1]


@pytest.mark.parametrize("transform", [Affine(1.0, 0.0, 0.0, 0.0, 0.0), Elastic(1.0, 0.0), Flip(0.0)])
def test_an_amount_of_zero_changes_nothing(transform: object) -> None:
    images, masks = torch.rand(4, 1, 24, 32), discs(4, 24, 32, 6.0)
    changed = Augmentation((transform,))(images, masks, generator())
    torch.testing.assert_close(changed[0], images, atol=1e-5, rtol=0)
    assert torch.equal(changed[1], masks)


def test_flip_is_left_to_right_for_about_its_share() -> None:
    images = torch.rand(400, 1, 6, 8)
    masks = (images > 0.5).float()
    flipped, flipped_masks = Augmentation((Flip(0.3),))(images, masks, generator())
    is_flipped = torch.isclose(flipped, images.flip(-1), atol=1e-5).all(dim=(1, 2, 3))
    is_same = torch.isclose(flipped, images, atol=1e-5).all(dim=(1, 2, 3))
    assert bool((is_flipped ^ is_same).all())
    assert 0.22 < float(is_flipped.float().mean()) < 0.38
    assert torch.equal(flipped_masks[is_flipped], masks[is_flipped].flip(-1))


def test_two_flips_of_every_image_cancel() -> None:
    images = torch.rand(4, 1, 6, 8, generator=generator())
    changed = Augmentation((Flip(1.0), Flip(1.0)))(images, images, generator())[0]
    torch.testing.assert_close(changed, images, atol=1e-5, rtol=0)


def test_a_rotation_keeps_a_disc_round_where_pixels_are_square_but_the_image_is_not() -> None:
    masks = discs(12, 48, 96, 12.0)
    for mask in moved(masks, Affine(1.0, 60.0, 0.0, 0.0, 0.0)):
        area, row_px, column_px = moments(mask)
        assert area == pytest.approx(moments(masks[0])[0], rel=0.02)
        assert row_px == pytest.approx(column_px, rel=0.02)


def test_a_rotation_is_by_the_angle() -> None:
    bar = torch.zeros(30, 1, 64, 64)
    bar[:, :, 30:34, 12:52] = 1
    angles_deg = []
    for mask in moved(bar, Affine(1.0, 40.0, 0.0, 0.0, 0.0)):
        place = torch.argwhere(mask[0] > 0).double()
        _, axes = torch.linalg.eigh(torch.cov(place.T))
        angles_deg.append(float(torch.rad2deg(torch.atan(axes[0, 1] / axes[1, 1]))))
    assert max(map(abs, angles_deg)) <= 41
    assert max(angles_deg) > 20 and min(angles_deg) < -20


def test_scale_and_shift_stay_within_their_bounds_and_use_them() -> None:
    masks = discs(60, 64, 64, 12.0)
    area = moments(masks[0])[0]
    ratios = [moments(mask)[0] / area for mask in moved(masks, Affine(1.0, 0.0, 0.5, 0.0, 0.0))]
    assert 1 / 1.5**2 * 0.95 < min(ratios) < 0.6 and 1.7 < max(ratios) < 1.5**2 * 1.05
    shifted = moved(masks, Affine(1.0, 0.0, 0.0, 0.2, 0.0))
    offsets_px = torch.stack([torch.argwhere(mask[0] > 0).double().mean(dim=0) - 31.5 for mask in shifted])
    assert 9 < float(offsets_px.abs().max()) < 0.2 * 64 + 0.5
    assert bool((offsets_px.min(dim=0).values < -5).all() and (offsets_px.max(dim=0).values > 5).all())


def test_a_shear_moves_rows_along_themselves() -> None:
    bar = torch.zeros(20, 1, 65, 65)
    bar[:, :, 10:55, 30:35] = 1
    tangents = []
    for mask in moved(bar, Affine(1.0, 0.0, 0.0, 0.0, 0.4)):
        row, column = torch.argwhere(mask[0] > 0).double().T
        tangents.append(float(((row - 32) * (column - 32)).sum() / ((row - 32) ** 2).sum()))
    assert 0.3 < max(map(abs, tangents)) < 0.42 and min(tangents) < -0.2 and max(tangents) > 0.2


def test_image_and_mask_move_together() -> None:
    masks = discs(16)
    geometry = Augmentation((Flip(0.5), Affine(1.0), Elastic(1.0, 0.1)))
    images, after = geometry(masks, masks, generator())
    assert torch.equal((images >= 0.5).float(), after)
    assert not torch.equal(after, masks)


def test_elastic_bends_a_disc() -> None:
    after = moved(discs(8), Elastic(1.0, 0.1))
    assert max(abs(row - column) for _, row, column in map(moments, after)) > 0.3


def test_geometry_is_that_of_the_general_operations() -> None:
    images, masks = torch.rand(6, 1, 20, 36, generator=generator()), discs(6, 20, 36, 7.0)
    affine, flip, elastic = Affine(0.8), Flip(0.5), Elastic(0.6)
    draws = RandomDraws(6, images.device, generator(3))
    first, second = affine.linear(draws, 36 / 20), flip.linear(draws, 36 / 20)
    assert first.max_shift is not None and second.max_shift is None
    shift = first.max_shift[:, None] * draws.signed(2)
    theta = torch.cat([second.matrix @ first.matrix, shift[..., None]], dim=2)
    grid = functional.affine_grid(theta, [6, 1, 20, 36], align_corners=False)
    coarse = 2 * elastic.max_shift * draws.signed(2, 5, 5) * draws.chosen(0.6, 1, 1, 1)
    smooth = functional.interpolate(coarse, size=(20, 36), mode="bicubic", align_corners=True)
    expected = functional.grid_sample(images, grid + smooth.permute(0, 2, 3, 1), align_corners=False)
    changed = Augmentation((affine, flip, elastic))(images, masks, generator(3))[0]
    torch.testing.assert_close(changed, expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (Flip, {"probability": 1.5}, "Flip.probability: expected a number from 0 to 1, received 1.5"),
        (Elastic, {"probability": -0.1}, "Elastic.probability: expected a number from 0 to 1"),
        (
            Affine,
            {"max_scale_change": -1.0},
            "Affine.max_scale_change: expected a number of at least 0, received -1.0",
        ),
        (
            Affine,
            {"max_shift": float("nan")},
            "Affine.max_shift: expected a number of at least 0, received nan",
        ),
        (
            Elastic,
            {"control_points": 1},
            "Elastic.control_points: expected a number of at least 2, received 1",
        ),
    ],
)
def test_refuses_settings(kind: type, settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kind(**settings)
