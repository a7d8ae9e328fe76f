import itertools

import pytest
import torch
from discs import discs, generator
from earlier_augmentation import augmented

from models.errors import InputError
from models.training.augmentation import Affine, Augmentation, Flip, Speckle, augmentation_of

PROBABILITIES = ("flip", "affine", "elastic", "brightness", "contrast", "gamma", "speckle", "depth_gain")


@pytest.mark.parametrize(
    "settings",
    [
        [{"name": "Affine", "max_shift": 0.2}, {"name": "Speckle"}],
        [{"_target_": "models.training.augmentation.Affine", "max_shift": 0.2}, {"name": "Speckle"}],
        {
            "_target_": "models.training.augmentation.Augmentation",
            "transforms": [
                {"_target_": "models.training.augmentation.Affine", "max_shift": 0.2},
                {"_target_": "models.training.augmentation.Speckle"},
            ],
        },
    ],
)
def test_a_list_of_transforms_is_read(settings: object) -> None:
    assert augmentation_of(settings) == Augmentation((Affine(max_shift=0.2), Speckle()))


def test_nothing_said_is_the_default_and_an_empty_list_is_none() -> None:
    assert augmentation_of({}) == Augmentation() and augmentation_of([]) == Augmentation(())


def test_flat_settings_of_earlier_configurations_give_the_same_batches() -> None:
    images, masks = torch.rand(6, 1, 12, 20, generator=generator()), discs(6, 12, 20, 4.0)
    for chosen in itertools.product((0, 0.6), repeat=len(PROBABILITIES)):
        settings = dict(zip(PROBABILITIES, chosen, strict=True))
        ours, theirs = generator(1), generator(1)
        batch, expected = (
            augmentation_of(settings)(images, masks, ours),
            augmented(images, masks, theirs, **settings),
        )
        assert torch.equal(batch[0], expected[0]) and torch.equal(batch[1], expected[1]), settings
        assert torch.equal(ours.get_state(), theirs.get_state()), settings


def test_flat_settings_with_a_target_are_those_of_an_exported_run() -> None:
    settings = {"_target_": "models.training.augmentation.Augmentation", "flip": 0.2, "rotation_deg": 3.0}
    read = augmentation_of(settings).transforms
    assert read[:2] == (Affine(max_rotation_deg=3.0), Flip(0.2)) and len(read) == 8


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"turn": 0.5}, "augmentation: expected a list of transforms, received settings turn"),
        ([{"name": "Turn"}], r"augmentation\[0\]: expected a transform \(Affine, .*\), received 'Turn'"),
        ([{"_target_": "os.system"}], r"augmentation\[0\]: expected a transform .* received 'os.system'"),
        (["Flip"], r"augmentation\[0\]: expected a mapping with a transform's name, received 'Flip'"),
        (
            [{"name": "Flip", "speed": 1}],
            r"augmentation\[0\]: expected settings of Flip .* received speed",
        ),
        (
            [{"name": "Flip", "probability": "x"}],
            r"augmentation\[0\].probability: expected a number, received 'x'",
        ),
        ([{"name": "Flip", "probability": 2}], "Flip.probability: expected a number from 0 to 1, received 2"),
        ({"transforms": [], "flip": 1}, "augmentation: expected transforms alone, received flip, transforms"),
        ("strong", "augmentation: expected a list of transforms, received 'strong'"),
        (None, "augmentation: expected a list of transforms, received None"),
    ],
)
def test_refuses_other_settings(settings: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        augmentation_of(settings)
