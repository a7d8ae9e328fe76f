import numpy as np
import pytest
import torch
from drawn_screens import cross_hairs, rectangle, speckle
from torch import nn

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.labelled_frames import LabelledFrames
from models.networks.unet import UNet
from models.predictor import Predictor, StageTimes
from models.preprocessing.grey import echo_grey
from models.preprocessing.preprocessing import Preprocessing
from models.training.datamodule import prepared


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


CLEANING = Preprocessing(32, "standard_sector", sector="auto", overlays="auto")


class Spy(nn.Module):
    """Keeps what it was given."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        self.seen = images.clone()
        return images


def marked_screen(seed: int = 0) -> np.ndarray:
    frame = np.where(rectangle((60, 80), 8, 10, 52, 70), speckle((60, 80), seed=seed), 0).astype(np.uint8)
    return cross_hairs(frame, (30, 40), 8)


@pytest.mark.parametrize("stage", [Preprocessing(32), CLEANING], ids=["plain", "cleaning"])
def test_the_network_sees_in_use_what_it_saw_in_training(stage: Preprocessing) -> None:
    images = tuple(marked_screen(seed) for seed in range(3))
    masks = tuple(image > 100 for image in images)
    frames = LabelledFrames(images, masks, ("a", "b", "c"), ("p", "p", "q"), (None,) * 3, simulated=True)
    trained_on = stage.normalise(prepared(frames, stage).tensors[0])
    spy = Spy()
    Predictor(spy, stage)(np.stack(images))
    assert torch.equal(spy.seen, trained_on)


def test_colour_frames_lose_their_coloured_marks_on_the_way() -> None:
    tissue = speckle((60, 80))
    colour = cross_hairs(np.dstack([tissue] * 3), (30, 40), 8, (255, 255, 0))
    spies = Spy(), Spy()
    for spy, frames in zip(
        spies, (np.stack([colour, colour]), np.stack([echo_grey(colour)] * 2)), strict=True
    ):
        result = Predictor(spy, CLEANING).timed(frames)
        assert result.masks.shape == result.probability.shape == (2, 60, 80)
    assert torch.equal(spies[0].seen, spies[1].seen)


def test_timed_gives_the_same_masks_and_where_the_time_went(monkeypatch) -> None:
    frames = np.stack([marked_screen(seed) for seed in range(5)])
    predictor = Predictor(BrightIsVessel(), CLEANING, batch_size=2)
    result = predictor.timed(frames)
    np.testing.assert_array_equal(result.masks, predictor(frames))
    np.testing.assert_array_equal(result.probability, predictor.probability(frames))
    # A clock that steps on by one: each of 3 batches has one step a stage, and the masks take one more.
    steps = iter(range(100))
    monkeypatch.setattr("models.predictor.time.perf_counter", lambda: float(next(steps)))
    assert predictor.timed(frames).times == StageTimes(5, 3.0, 3.0, 4.0)
    assert predictor.timed(frames[:0]).times.frames == 0


def test_times_add_up() -> None:
    total = StageTimes(2, 1.0, 2.0, 3.0) + StageTimes(1, 0.5, 0.25, 0.125)
    assert total == StageTimes(3, 1.5, 2.25, 3.125) and total.total_s == 6.875


def test_a_crop_is_put_back_where_it_was_cut() -> None:
    stage = Preprocessing(48, "unit", sector=[[0, 0.5], [0, 1], [1, 1], [1, 0.5]], crop=True)
    frame = np.zeros((96, 192), np.uint8)
    frame[24:48, 130:160] = frame[24:48, 20:50] = 255
    mask = Predictor(BrightIsVessel(), stage)(frame[None])[0]
    right = (frame > 0) & (np.arange(192) >= 96)
    assert 2 * (mask & right).sum() / (mask.sum() + right.sum()) > 0.93
    assert not mask[:, :96].any()


def test_read_only_frames_and_none_at_all_are_fine() -> None:
    frames = np.stack([bright_square(64, 64)])
    frames.flags.writeable = False
    assert BRIGHT(frames).any()
    assert BRIGHT(np.zeros((0, 20, 30), np.uint8)).shape == (0, 20, 30)


def test_refuses_frames_without_pixels_and_settings() -> None:
    with pytest.raises(InputError, match=r"frames: expected uint8 of shape .* received uint8 \(2, 0, 5\)"):
        BRIGHT(np.zeros((2, 0, 5), np.uint8))
    for size in ((50, 60, 3), (2, 8, 8, 2)):
        for call in (BRIGHT, BRIGHT.probability, BRIGHT.timed):
            with pytest.raises(
                InputError, match=r"frames: expected uint8 of shape .* or \(n, height, width, 3\)"
            ):
                call(np.zeros(size, np.uint8))
    with pytest.raises(InputError, match="batch_size: expected at least 1, received 0"):
        Predictor(BrightIsVessel(), Preprocessing(32), batch_size=0)
    with pytest.raises(InputError, match="threshold: expected 0 to 1, received 2"):
        Predictor(BrightIsVessel(), Preprocessing(32), threshold=2.0)


def test_flipped_and_turned_frames_are_taken_like_their_copies() -> None:
    frames = np.random.default_rng(3).integers(0, 256, (3, 40, 40), dtype=np.uint8)
    views = (
        frames[:, ::-1],
        frames[..., ::-1],
        frames[::-1],
        np.rot90(frames, 1, (1, 2)),
        frames[:, ::2, ::-1],
    )
    for view in views:
        np.testing.assert_array_equal(BRIGHT.probability(view), BRIGHT.probability(view.copy()))
        np.testing.assert_array_equal(BRIGHT(view), BRIGHT(view.copy()))
    colour = np.stack([frames] * 3, axis=-1)[:, ::-1]
    np.testing.assert_array_equal(BRIGHT(colour), BRIGHT(colour.copy()))


def test_flipped_frames_train_like_their_copies() -> None:
    image = np.random.default_rng(3).integers(0, 256, (40, 40), dtype=np.uint8)
    found = [
        prepared(
            LabelledFrames(
                images=(shown,),
                masks=(shown > 128,),
                case_ids=("a",),
                groups=("g",),
                spacing_mm=(None,),
                simulated=True,
            ),
            Preprocessing(32, "unit"),
        ).tensors
        for shown in (image[::-1, ::-1], image[::-1, ::-1].copy())
    ]
    for first, second in zip(*found, strict=True):
        assert torch.equal(first, second)
