import pytest
import torch
from discs import discs, generator

from models.errors import InputError
from models.training.augmentation import Augmentation, Brightness, Contrast, DepthGain, Gamma, Speckle


def changed(images: torch.Tensor, *transforms: object) -> torch.Tensor:
    return Augmentation(transforms)(images, images, generator())[0]


@pytest.mark.parametrize(
    "transform",
    [Brightness(1.0, 0.0), Contrast(1.0, 0.0), Gamma(1.0, 0.0), Speckle(1.0, 0.0), DepthGain(1.0, 0.0)],
)
def test_an_amount_of_zero_changes_nothing(transform: object) -> None:
    images = torch.rand(4, 1, 24, 32)
    torch.testing.assert_close(changed(images, transform), images, atol=1e-5, rtol=0)


@pytest.mark.parametrize("kind", [Brightness, Contrast, Gamma, Speckle, DepthGain])
def test_about_the_probability_of_the_images_are_changed(kind: type) -> None:
    images = torch.rand(400, 1, 8, 8, generator=generator(1))
    is_changed = ~torch.isclose(changed(images, kind(0.3)), images, atol=1e-6).all(dim=(1, 2, 3))
    assert 0.22 < float(is_changed.float().mean()) < 0.38


def test_grey_changes_leave_masks_alone() -> None:
    images, masks = torch.rand(8, 1, 16, 16), discs(8, 16, 16, 4.0)
    grey = Augmentation((Speckle(1.0), DepthGain(1.0), Gamma(1.0), Contrast(1.0), Brightness(1.0)))
    after = grey(images, masks, generator())
    assert torch.equal(after[1], masks) and not torch.equal(after[0], images)


def test_brightness_adds_within_its_bound() -> None:
    images = torch.full((200, 1, 4, 4), 0.5)
    change = changed(images, Brightness(1.0, 0.1))[:, 0, 0, 0] - 0.5
    assert float(change.abs().max()) <= 0.1 + 1e-6
    assert float(change.min()) < -0.08 and float(change.max()) > 0.08


def test_contrast_stretches_about_the_mean_and_gamma_keeps_black_and_white() -> None:
    images = torch.tensor([0.4, 0.6]).reshape(1, 1, 1, 2).repeat(100, 1, 1, 1)
    stretched = changed(images, Contrast(1.0, 1.0))
    width = (stretched[..., 1] - stretched[..., 0]).flatten() / 0.2
    torch.testing.assert_close(stretched.mean(dim=(1, 2, 3)), torch.full((100,), 0.5))
    assert 0.5 - 1e-4 <= float(width.min()) < 0.6 and 1.7 < float(width.max()) <= 2.0 + 1e-4
    ends = torch.tensor([0.0, 0.25, 1.0]).reshape(1, 1, 1, 3).repeat(100, 1, 1, 1)
    curved = changed(ends, Gamma(1.0, 1.0))[:, 0, 0]
    assert bool((curved[:, 0] == 0).all() and (curved[:, 2] == 1).all())
    assert 0.25**2 - 1e-4 <= float(curved[:, 1].min()) < 0.1 and 0.4 < float(curved[:, 1].max()) <= 0.5 + 1e-4


def test_depth_gain_runs_evenly_down_the_image() -> None:
    images = torch.full((50, 1, 9, 4), 0.4)
    gain = changed(images, DepthGain(1.0, 1.0)) / 0.4
    torch.testing.assert_close(gain[..., :1].expand_as(gain), gain)
    torch.testing.assert_close(gain[:, :, 4], torch.ones(50, 1, 4))
    torch.testing.assert_close(gain[:, :, 0] * gain[:, :, 8], torch.ones(50, 1, 4))
    assert float(gain[:, :, 8].max()) > 1.7 and float(gain[:, :, 8].min()) < 0.6


def test_speckle_has_its_deviation_and_grain_and_spares_black() -> None:
    images = torch.full((20, 1, 64, 64), 0.5)
    images[:, :, :, :8] = 0
    noisy = changed(images, Speckle(1.0, 0.2, 1))
    assert float(noisy[:, :, :, :8].abs().max()) == 0
    assert float(noisy[:, :, :, 8:].std()) == pytest.approx(0.1, rel=0.05)
    flat = torch.full((40, 1, 96, 96), 0.5)
    for grain in (2, 3, 8):  # off the margin, where there is less to interpolate between
        grainy = changed(flat, Speckle(1.0, 0.2, grain))
        assert float(grainy[:, :, 4:-4, 4:-4].std()) == pytest.approx(0.1, rel=0.05)
    coarse = changed(images, Speckle(1.0, grain_px=8))[:, 0, 32, 8:]
    steps, spread = (coarse[:, 1:] - coarse[:, :-1]).std(), coarse.std()
    assert float(steps / spread) < 0.5  # white noise would have a ratio of 1.4


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (Gamma, {"probability": 1.5}, "Gamma.probability: expected a number from 0 to 1, received 1.5"),
        (Speckle, {"std": float("inf")}, "Speckle.std: expected a number of at least 0, received inf"),
        (Speckle, {"grain_px": 0}, "Speckle.grain_px: expected a number of at least 1, received 0"),
        (DepthGain, {"max_change": -1}, "DepthGain.max_change: expected a number of at least 0, received -1"),
    ],
)
def test_refuses_settings(kind: type, settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kind(**settings)
