import dataclasses
from pathlib import Path

import pytest
import torch
import yaml
from discs import discs, generator
from earlier_augmentation import augmented

from models.errors import InputError
from models.training.augmentation import (
    DEFAULT_TRANSFORMS,
    Affine,
    Augmentation,
    Brightness,
    Elastic,
    Flip,
    Gamma,
    RandomDraws,
    Speckle,
    augmentation_of,
)

CONF = Path(__file__).resolve().parents[4] / "conf" / "augmentation"
STRONG = {
    "affine": 0.7,
    "rotation_deg": 15.0,
    "scale": 0.2,
    "shift": 0.1,
    "shear": 0.1,
    "elastic": 0.3,
    "brightness": 0.5,
    "contrast": 0.5,
    "gamma": 0.5,
    "speckle": 0.3,
    "depth_gain": 0.3,
}


def option(name: str) -> Augmentation:
    return augmentation_of(yaml.safe_load((CONF / f"{name}.yaml").read_text()))


@pytest.mark.parametrize(
    ("augmentation", "settings"),
    [(Augmentation(), {}), (option("default"), {}), (option("strong"), STRONG)],
    ids=["no settings", "default", "strong"],
)
@pytest.mark.parametrize("size", [(8, 32, 32), (5, 24, 40)])
def test_same_seed_same_batches_as_before_transforms_were_classes(
    augmentation: Augmentation, settings: dict[str, float], size: tuple[int, int, int]
) -> None:
    count, height, width = size
    images = torch.rand(count, 1, height, width, generator=generator(11))
    masks = discs(count, height, width, 8.0)
    ours, theirs = generator(3), generator(3)
    for _ in range(4):
        batch, expected = augmentation(images, masks, ours), augmented(images, masks, theirs, **settings)
        assert torch.equal(batch[0], expected[0]) and torch.equal(batch[1], expected[1])
    assert torch.equal(ours.get_state(), theirs.get_state())


def test_the_options_are_lists_of_transforms_the_default_among_them() -> None:
    assert option("default") == Augmentation() and option("none") == Augmentation(())
    assert [type(each) for each in option("strong").transforms] == [type(each) for each in DEFAULT_TRANSFORMS]


def test_random_numbers_come_from_the_generator_alone() -> None:
    images, masks = torch.rand(4, 1, 32, 32, generator=generator()), discs(4, 32, 32)
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
    everything = Augmentation(
        tuple(dataclasses.replace(each, probability=1.0) for each in DEFAULT_TRANSFORMS)
    )
    image = torch.rand(1, 1, 32, 32, generator=generator()).expand(8, 1, 32, 32)
    images, masks = everything(image, discs(8, 32, 32), generator())
    assert 0 <= float(images.min()) and float(images.max()) <= 1
    assert set(masks.unique().tolist()) == {0.0, 1.0}
    assert len({tuple(image.flatten().tolist()) for image in images}) == 8


def test_no_transform_changes_nothing_and_draws_nothing() -> None:
    images, masks = torch.rand(4, 1, 16, 16), discs(4, 16, 16, 4.0)
    chance = generator()
    changed = Augmentation(())(images, masks, chance)
    assert torch.equal(changed[0], images) and torch.equal(changed[1], masks)
    assert torch.equal(chance.get_state(), generator().get_state())


@pytest.mark.parametrize("order", [1, -1])
def test_grey_values_below_black_never_become_nan(order: int) -> None:
    images = torch.rand(64, 1, 8, 8, generator=generator())
    transforms = (Brightness(1.0, 0.9), Gamma(1.0, 1.0))[::order]
    changed = Augmentation(transforms)(images, images, generator())[0]
    assert bool(((changed >= 0) & (changed <= 1)).all())


def test_batches_given_are_left_as_they_are() -> None:
    images, masks = torch.rand(8, 1, 16, 16, generator=generator()), discs(8, 16, 16, 4.0)
    before = images.clone(), masks.clone()
    for transforms in (DEFAULT_TRANSFORMS, *((each,) for each in DEFAULT_TRANSFORMS)):
        Augmentation(transforms)(images, masks, generator())
        assert torch.equal(images, before[0]) and torch.equal(masks, before[1])


def test_a_transform_of_ones_own_goes_into_the_list() -> None:
    @dataclasses.dataclass(frozen=True)
    class Inversion:
        stage = "display"

        def __call__(self, images: torch.Tensor, draws: RandomDraws) -> torch.Tensor:
            return 1 - images

    images = torch.rand(3, 1, 8, 8, generator=generator())
    changed = Augmentation((Flip(0.0), Inversion()))(images, images, generator())[0]
    torch.testing.assert_close(changed, 1 - images)


@pytest.mark.parametrize(
    ("transforms", "message"),
    [
        ((Speckle(), Flip()), r"transforms\[1\]: expected spatial transforms before .* received Flip after"),
        (
            (Affine(), Gamma(), Elastic()),
            r"transforms\[2\]: expected spatial .* received Elastic after Gamma",
        ),
        ((Flip(), "speckle"), r"transforms\[1\]: expected a transform, received 'speckle'"),
    ],
)
def test_refuses_other_lists(transforms: tuple[object, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Augmentation(transforms)
