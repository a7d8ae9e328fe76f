from pathlib import Path

import pytest
import torch
from drawn_vessels import drawn_frames

from models.augmentation import Augmentation
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.evaluation import predict, score_cases
from models.losses import DiceCrossEntropy
from models.predictor import Predictor
from models.trainer_settings import TrainerSettings
from models.training import TrainedFold, initial_network, seed_of, train_fold
from models.unet import UNet

RECIPE = UNet(width=4, depth=3)
TRAIN, VALIDATION = drawn_frames(16, seed=0), drawn_frames(6, seed=1)


def trained(
    directory: Path, *, seed: int = 0, fold: int = 0, epochs: int = 2, **changes: object
) -> TrainedFold:
    settings = TrainerSettings(
        max_epochs=epochs, batch_size=4, image_size_px=32, learning_rate=0.01, patience=epochs
    )
    arguments = {
        "model": RECIPE,
        "train": TRAIN,
        "validation": VALIDATION,
        "trainer": settings,
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "seed": seed,
        "fold": fold,
        "directory": directory,
    }
    return train_fold(**{**arguments, **changes})


def weights(result: TrainedFold) -> dict[str, torch.Tensor]:
    return dict(Checkpoint.load(result.checkpoint).weights)


def same(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(first[name], second[name]) for name in first)


def test_a_network_learns_to_find_drawn_vessels(tmp_path) -> None:
    unseen = drawn_frames(8, seed=2, size=(60, 44))
    result = trained(tmp_path, epochs=14)
    rows = score_cases(unseen, dict(predict(Predictor.load(result.checkpoint), unseen)), {})
    assert sum(row["dsc"] for row in rows) / len(rows) > 0.8
    assert result.history[-1]["train_loss"] < result.history[0]["train_loss"]


def test_the_checkpoint_is_that_of_the_best_epoch(tmp_path) -> None:
    reports: list[dict[str, float]] = []
    result = trained(tmp_path, epochs=4, on_epoch=reports.append)
    by_epoch = [epoch["validation_dsc"] for epoch in result.history]
    assert list(result.history) == reports and len(reports) == 4
    assert result.best_validation_dsc == max(by_epoch) == by_epoch[result.best_epoch]
    checkpoint = Checkpoint.load(result.checkpoint)
    assert checkpoint.recipe == RECIPE
    assert checkpoint.notes == {
        "seed": 0,
        "fold": 0,
        "epoch": result.best_epoch,
        "validation_dsc": result.best_validation_dsc,
    }
    assert [path.name for path in tmp_path.iterdir()] == ["model.pt"]


def test_the_same_seed_gives_the_same_weights_and_others_do_not(tmp_path) -> None:
    first = weights(trained(tmp_path / "a"))
    torch.manual_seed(123)
    assert same(first, weights(trained(tmp_path / "b")))
    assert not same(first, weights(trained(tmp_path / "c", seed=1)))
    assert not same(first, weights(trained(tmp_path / "d", fold=1)))


def test_training_leaves_torch_as_it_was(tmp_path) -> None:
    torch.manual_seed(7)
    expected = torch.rand(2)
    torch.manual_seed(7)
    trained(tmp_path, epochs=1)
    assert torch.equal(torch.rand(2), expected)
    assert not torch.are_deterministic_algorithms_enabled()


def test_seed_zero_seeds_and_first_weights_depend_on_the_seed_alone() -> None:
    torch.manual_seed(1)
    first = initial_network(RECIPE, 0).state_dict()
    torch.manual_seed(2)
    assert same(first, initial_network(RECIPE, 0).state_dict())
    assert not same(first, initial_network(RECIPE, 1).state_dict())


def test_seeds_of_purposes_differ() -> None:
    seeds = {seed_of(seed, purpose, fold) for seed in (0, 1) for purpose in (0, 1) for fold in (0, 1, 2)}
    assert len(seeds) == 12
    with pytest.raises(InputError, match="seed: expected a number from 0, received -1"):
        seed_of(-1)


def test_training_stops_when_validation_no_longer_improves(tmp_path) -> None:
    settings = TrainerSettings(
        max_epochs=30, batch_size=8, image_size_px=32, learning_rate=1e-9, patience=2, warmup_epochs=0
    )
    result = trained(tmp_path, trainer=settings)
    assert len(result.history) < 30
    assert len(result.history) == result.best_epoch + 1 + 2


def test_refuses_a_size_the_network_does_not_take(tmp_path) -> None:
    settings = TrainerSettings(max_epochs=1, batch_size=4, image_size_px=30, learning_rate=0.01, patience=1)
    with pytest.raises(InputError, match="multiples of 4, 8 at least, received 30 x 30"):
        trained(tmp_path, trainer=settings)


def test_refuses_a_gpu_that_is_not_there(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    settings = TrainerSettings(
        max_epochs=1, batch_size=4, image_size_px=32, learning_rate=0.01, patience=1, accelerator="gpu"
    )
    with pytest.raises(InputError, match="accelerator: expected a machine with a GPU, found none"):
        trained(tmp_path, trainer=settings)


@pytest.mark.parametrize("side", ["train", "validation"])
def test_refuses_frames_without_any_vessel(tmp_path, side: str) -> None:
    with pytest.raises(
        InputError, match=f"{side}: expected frames with a vessel, received 4 frames without any"
    ):
        trained(tmp_path, **{side: drawn_frames(4, empty=4)})
