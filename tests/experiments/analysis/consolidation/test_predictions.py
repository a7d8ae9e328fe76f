"""Logits on disk: those of the network, and the mean probability of several."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from drawn_vessels import drawn_frames
from known_predictions import disc, known_prediction

from experiments.analysis.consolidation.predictions import ensemble, predict, prepare
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing


@pytest.mark.parametrize("size", [(40, 48), (20, 33)])
def test_native_probabilities_are_those_of_the_predictor(size: tuple[int, int], tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = UNet(width=2, depth=2, normalisation="batch")().eval()
    frames = drawn_frames(5, size=size)
    cases = prepare(frames, Preprocessing(32), tmp_path / "cases")
    found = predict(network, cases, tmp_path / "logits.npy", batch_size=2)
    expected = Predictor(network, Preprocessing(32)).probability(np.stack(frames.images))
    for index in range(len(frames)):
        # Logits are kept in 16 bits.
        np.testing.assert_allclose(found.native(index), expected[index], atol=2e-3)
    assert found.seconds_per_frame > 0 and cases.seconds_per_frame > 0


def test_an_ensemble_is_the_mean_probability_not_the_mean_logit(tmp_path: Path) -> None:
    mask = disc(16, 8, 8, 4)
    sure, unsure = (known_prediction([np.full((16, 16), value)], [mask], ["a"]) for value in (6.0, -1.0))
    both = ensemble([sure, unsure], tmp_path / "mean.npy")
    expected = np.mean([1 / (1 + np.exp(-6.0)), 1 / (1 + np.exp(1.0))])
    np.testing.assert_allclose(both.probability(0), expected, atol=1e-3)
    assert both.seconds_per_frame == pytest.approx(0.2)


def test_windows_leave_out_what_is_no_image(tmp_path: Path) -> None:
    frames = drawn_frames(2, size=(20, 40))
    cases = prepare(frames, Preprocessing(32), tmp_path / "cases")
    found = predict(UNet(width=2, depth=2)(), cases, tmp_path / "logits.npy", batch_size=1)
    assert [logits.shape for logits, _, _ in found.windows()] == [(16, 32)] * 2
