import dataclasses

import pytest
import torch
from drawn_vessels import drawn_frames

from models.errors import InputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import DEFAULT_TRANSFORMS, Augmentation, Contrast, Flip, Gamma
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings
from models.training.spec import FoldTraining

SETTINGS = TrainerSettings(max_epochs=2, batch_size=4, learning_rate=0.01, patience=2)


def training(**changes: object) -> FoldTraining:
    given = {
        "model": UNet(width=4, depth=3),
        "train": drawn_frames(6),
        "validation": drawn_frames(3, seed=1),
        "preprocessing": Preprocessing(32),
        "trainer": SETTINGS,
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "seed": 0,
        "fold": 0,
    }
    return FoldTraining(**{**given, **changes})


def test_the_fingerprint_tells_every_other_training_apart() -> None:
    others = [
        training(),
        training(model=UNet(width=4, depth=2)),
        training(train=drawn_frames(6, seed=2)),
        training(validation=drawn_frames(3, seed=2)),
        training(train=drawn_frames(6).subset([0, 1, 2, 3, 5, 4])),
        training(preprocessing=Preprocessing(32, normalisation="unit")),
        training(augmentation=Augmentation((Flip(), *DEFAULT_TRANSFORMS[2:]))),
        training(augmentation=Augmentation((Gamma(0.5, 0.2),))),
        training(augmentation=Augmentation((Contrast(0.5, 0.2),))),
        training(loss=DiceCrossEntropy(smooth=2.0)),
        training(seed=1),
        training(fold=1),
        *(
            training(trainer=dataclasses.replace(SETTINGS, **{name: value}))
            for name, value in {
                "max_epochs": 3,
                "batch_size": 3,
                "learning_rate": 0.02,
                "patience": 1,
                "schedule": "one_cycle",
                "warmup_epochs": 2,
                "weight_decay": 0.1,
                "gradient_clip": 2.0,
                "deterministic": False,
                "threads": 2,
                "selection": "last",
                "selection_epochs": 3,
                "late_weights": "ema",
                "ema_epochs": 1.0,
                "swa_share": 0.5,
                "empty_weight": 2.0,
            }.items()
        ),
    ]
    assert len({each.fingerprint for each in others}) == len(others)


def test_the_fingerprint_is_the_same_however_far_the_training_goes() -> None:
    expected = training().fingerprint
    assert training(trainer=dataclasses.replace(SETTINGS, resume=True)).fingerprint == expected
    assert training(trainer=dataclasses.replace(SETTINGS, extend_epochs=5)).fingerprint == expected


def test_refuses_a_size_the_network_does_not_take() -> None:
    with pytest.raises(InputError, match="multiples of 4, 8 at least, received 30 x 30"):
        training(preprocessing=Preprocessing(30))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"accelerator": "gpu"}, "accelerator: expected a machine with a GPU, found none"),
        (
            {"accelerator": "auto", "precision": "bf16-mixed"},
            "precision: expected 32-true on this processor, which has no units for another, received 'bf16-mixed'",
        ),
        (
            {"precision": "bf16-mixed"},
            "precision: expected 32-true on this processor, which has no units for another, received 'bf16-mixed'",
        ),
    ],
)
def test_refuses_what_the_machine_does_not_have(monkeypatch, changes: dict[str, str], message: str) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": False})
    with pytest.raises(InputError, match=message):
        training(trainer=dataclasses.replace(SETTINGS, **changes))


def test_bfloat16_is_for_a_processor_with_units_for_it_and_float16_for_none(monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True})
    training(trainer=dataclasses.replace(SETTINGS, precision="bf16-mixed"))
    with pytest.raises(InputError, match="precision: expected 32-true or bf16-mixed on this processor"):
        training(trainer=dataclasses.replace(SETTINGS, accelerator="auto", precision="16-mixed"))


@pytest.mark.parametrize("side", ["train", "validation"])
def test_refuses_frames_without_any_vessel(side: str) -> None:
    with pytest.raises(
        InputError, match=f"{side}: expected frames with a vessel, received 4 frames without any"
    ):
        training(**{side: drawn_frames(4, empty=4)})
