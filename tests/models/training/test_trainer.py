import os

import pytest
import torch

from models.training.settings import TrainerSettings
from models.training.trainer import reproducible

SETTINGS = {"max_epochs": 1, "batch_size": 1, "learning_rate": 0.1, "patience": 1}


def switches() -> tuple[bool, bool, bool, bool]:
    return (
        torch.are_deterministic_algorithms_enabled(),
        torch.is_deterministic_algorithms_warn_only_enabled(),
        torch.utils.deterministic.fill_uninitialized_memory,
        torch.backends.cudnn.benchmark,
    )


@pytest.mark.parametrize(
    ("changes", "thrown"),
    [
        ({}, (True, False, False, False)),
        ({"accelerator": "auto"}, (True, True, False, False)),
        ({"deterministic": False}, (False, False, False, True)),
    ],
)
def test_switches_are_thrown_and_put_back(monkeypatch, changes: dict[str, object], thrown: tuple) -> None:
    monkeypatch.delenv("CUBLAS_WORKSPACE_CONFIG", raising=False)
    before = switches()
    with pytest.raises(KeyError), reproducible(TrainerSettings(**SETTINGS, **changes)):
        assert switches() == thrown
        assert ("CUBLAS_WORKSPACE_CONFIG" in os.environ) == thrown[0]
        raise KeyError
    assert switches() == before


def test_the_random_stream_is_as_it_was() -> None:
    torch.manual_seed(3)
    expected = torch.rand(1)
    torch.manual_seed(3)
    with reproducible(TrainerSettings(**SETTINGS)):
        torch.manual_seed(9)
        torch.rand(5)
    assert torch.equal(torch.rand(1), expected)
