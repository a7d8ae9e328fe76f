import numpy as np
import pytest
import torch
from torch import nn

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.predictor import Predictor
from models.preprocessing import Preprocessing
from models.unet import UNet


class BrightIsVessel(nn.Module):
    """Logit 20 times the grey value above one half: what the right answer is can be seen in the image."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return 20 * (images - 0.5)


BRIGHT = Predictor(BrightIsVessel(), Preprocessing(32, "unit"), batch_size=2)


def bright_square(height: int, width: int) -> np.ndarray:
    frame = np.zeros((height, width), np.uint8)
    frame[height // 4 : height // 2, width // 2 : 3 * width // 4] = 255
    return frame


@pytest.mark.parametrize("size", [(32, 32), (96, 96), (128, 64), (40, 100)])
def test_masks_lie_where_the_vessel_is_at_the_frames_own_size(size: tuple[int, int]) -> None:
    frames = np.stack([bright_square(*size), bright_square(*size)[::-1, ::-1], np.zeros(size, np.uint8)])
    masks = BRIGHT(frames)
    assert masks.shape == frames.shape and masks.dtype == bool
    for frame, mask in zip(frames[:2] > 0, masks[:2], strict=True):
        assert 2 * (frame & mask).sum() / (frame.sum() + mask.sum()) > 0.93
    assert not masks[2].any()


def test_probability_is_between_zero_and_one_and_agrees_with_the_masks() -> None:
    frames = np.random.default_rng(0).integers(0, 256, (5, 50, 70), dtype=np.uint8)
    probability = BRIGHT.probability(frames)
    assert probability.dtype == np.float32 and probability.min() >= 0 and probability.max() <= 1
    np.testing.assert_array_equal(BRIGHT(frames), probability >= 0.5)


def test_threshold_is_where_vessel_begins() -> None:
    frames = np.stack([bright_square(64, 64)])
    sizes = [
        int(Predictor(BrightIsVessel(), BRIGHT.preprocessing, threshold=t)(frames).sum())
        for t in (0.01, 0.5, 0.99)
    ]
    assert sizes[0] > sizes[1] > sizes[2] > 0


def test_batches_change_nothing() -> None:
    torch.manual_seed(0)
    network = UNet(width=4, depth=3)()
    frames = np.random.default_rng(0).integers(0, 256, (7, 40, 56), dtype=np.uint8)
    results = [Predictor(network, Preprocessing(32), batch_size=n).probability(frames) for n in (1, 3, 16)]
    np.testing.assert_allclose(results[0], results[1], atol=1e-6)
    np.testing.assert_allclose(results[0], results[2], atol=1e-6)


def test_a_loaded_checkpoint_predicts_as_its_network(tmp_path) -> None:
    recipe = UNet(width=4, depth=2)
    network = recipe()
    Checkpoint(recipe, network.state_dict(), Preprocessing(16)).save(tmp_path / "model.pt")
    frames = np.random.default_rng(0).integers(0, 256, (3, 20, 30), dtype=np.uint8)
    loaded = Predictor.load(tmp_path / "model.pt")
    np.testing.assert_allclose(
        loaded.probability(frames), Predictor(network, Preprocessing(16)).probability(frames), atol=1e-6
    )
    assert not loaded.network.training


def test_read_only_frames_and_none_at_all_are_fine() -> None:
    frames = np.stack([bright_square(64, 64)])
    frames.flags.writeable = False
    assert BRIGHT(frames).any()
    assert BRIGHT(np.zeros((0, 20, 30), np.uint8)).shape == (0, 20, 30)


def test_refuses_frames_without_pixels_and_settings() -> None:
    with pytest.raises(InputError, match=r"frames: expected uint8 of shape .* received uint8 \(2, 0, 5\)"):
        BRIGHT(np.zeros((2, 0, 5), np.uint8))
    with pytest.raises(InputError, match="batch_size: expected at least 1, received 0"):
        Predictor(BrightIsVessel(), Preprocessing(32), batch_size=0)
    with pytest.raises(InputError, match="threshold: expected 0 to 1, received 2"):
        Predictor(BrightIsVessel(), Preprocessing(32), threshold=2.0)
