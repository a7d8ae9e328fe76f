"""Where masks come from: the truth itself, or a file with its own thresholds."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from experiments.studies.propagation import networks
from models.checkpoint import Checkpoint
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.settings import TrainerSettings

FRAMES = np.random.default_rng(0).integers(0, 255, (3, 40, 40)).astype(np.uint8)
SWEEP: Any = SimpleNamespace(
    masks=np.zeros((3, 40, 40), bool),
    sweep=SimpleNamespace(images=FRAMES, calibration=SimpleNamespace(spacing_mm=(0.5, 0.5))),
)
TRAINER = TrainerSettings(max_epochs=1, batch_size=4, learning_rate=0.01, patience=1, threads=1)


def test_the_reference_is_the_truth_and_needs_no_picture() -> None:
    source = networks.reference()
    assert source.values_of(SWEEP) is SWEEP.masks
    assert (source.model, source.pictures) == ("", False)


def test_a_file_segments_frames_at_their_own_size(tmp_path: Path) -> None:
    recipe = UNet(width=4, depth=2)
    torch.manual_seed(0)
    Checkpoint(recipe, recipe().state_dict(), Preprocessing(32)).save(tmp_path / "model.pt")
    source = networks.of_file(tmp_path / "model.pt", TRAINER)
    assert (source.model, source.pictures, source.inputs) == ("unet", True, ())
    values = source.values_of(SWEEP)
    assert values.shape == SWEEP.masks.shape
    assert ((values >= 0) & (values <= 1)).all()
    assert np.array_equal(values, source.values_of(SWEEP))
