import numpy as np
import pytest
import torch
from drawn_screens import cross_hairs, rectangle, speckle
from torch import nn

from models.calibration.temperature import TemperatureScaling
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.labelled_frames import LabelledFrames
from models.model_file import ModelMember, SegmentationModel
from models.networks.outputs import SideOutputs
from models.networks.unet import UNet
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.predictor import Frame, Predictor, StageTimes
from models.preprocessing.grey import echo_grey
from models.preprocessing.preprocessing import Preprocessing
from models.training.datamodule import prepared


class BrightIsVessel(nn.Module):
    """Logit 20 times the grey value above one half: what the right answer is can be seen in the image."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return 20 * (images - 0.5)


BRIGHT = Predictor(BrightIsVessel(), Preprocessing(32, "unit"), batch_size=2)


def threshold(value: float) -> Option:
    return Option(Hysteresis(value, value), Morphology())


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
        int(Predictor(BrightIsVessel(), BRIGHT.preprocessing, postprocessing=threshold(t))(frames).sum())
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
    assert not any(network.training for network in loaded.networks)


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
    # A clock that steps on by one: each of 3 batches has one step a stage, and each of 5 masks one.
    steps = iter(range(100))
    monkeypatch.setattr("models.predictor.time.perf_counter", lambda: float(next(steps)))
    assert predictor.timed(frames).times == StageTimes(5, 3.0, 3.0, 3.0, 3.0, 5.0)
    assert predictor.timed(frames[:0]).times.frames == 0


def test_times_add_up() -> None:
    total = StageTimes(2, 1.0, 2.0, 3.0) + StageTimes(1, 0.5, 0.25, 0.125, postprocessing_s=2.0)
    assert total == StageTimes(3, 1.5, 2.25, 3.125, 0.0, 2.0) and total.total_s == 8.875
    assert StageTimes(4, 1.0, 2.0).share(4) == StageTimes(1, 0.25, 0.5)


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
    for wrong in (np.zeros((2, 8, 8, 2), np.uint8), np.zeros((4, 4)), [np.zeros((2, 8, 8), np.uint8)]):
        for call in (BRIGHT, BRIGHT.probability, BRIGHT.soft_masks, BRIGHT.timed):
            with pytest.raises(InputError, match=r"frames: expected uint8 of shape \(height, width\)"):
                call(wrong)
    with pytest.raises(InputError, match="frames: expected a numpy array or a list, received a str"):
        BRIGHT("frame.png")
    with pytest.raises(InputError, match="frames: expected numpy arrays, received a list"):
        BRIGHT([[1, 2], [3, 4]])
    with pytest.raises(InputError, match="batch_size: expected at least 1, received 0"):
        Predictor(BrightIsVessel(), Preprocessing(32), batch_size=0)
    with pytest.raises(InputError, match="min_presence: expected 0 to 1, received 2"):
        Predictor(BrightIsVessel(), Preprocessing(32), min_presence=2.0)
    with pytest.raises(InputError, match=r"engine: expected one of auto, .* received 'tensorrt'"):
        Predictor(BrightIsVessel(), Preprocessing(32), engine="tensorrt")


NOISE = np.random.default_rng(0).integers(0, 256, (4, 40, 56), dtype=np.uint8)


def member(seed: int, width: int = 2) -> ModelMember:
    torch.manual_seed(seed)
    recipe = UNet(width=width, depth=2, normalisation="none")
    return ModelMember(f"network {seed}", recipe, recipe().state_dict())


def model(*seeds: int, **settings: object) -> SegmentationModel:
    return SegmentationModel(tuple(member(seed) for seed in seeds), Preprocessing(32), **settings)


def test_frames_of_mixed_sizes_and_colours_give_what_each_gives_alone() -> None:
    colour = cross_hairs(np.dstack([speckle((60, 80))] * 3), (30, 40), 8, (255, 255, 0))
    frames = [NOISE[0], NOISE[1, :, :33], colour, NOISE[2], NOISE[3]]
    predictor = Predictor.from_model(model(0), batch_size=3)
    for call in (predictor.probability, predictor, predictor.soft_masks):
        together = call(frames)
        assert [each.shape for each in together] == [frame.shape[:2] for frame in frames]
        for frame, found in zip(frames, together, strict=True):
            np.testing.assert_allclose(call(frame), found, atol=1e-6)
            np.testing.assert_allclose(call(frame[None])[0], found, atol=1e-6)
    assert predictor([]) == []


def test_a_stream_holds_no_more_than_a_batch_and_gives_what_a_stack_gives() -> None:
    read: list[int] = []

    def frames():
        for index, frame in enumerate(NOISE):
            read.append(index)
            yield frame

    predictor = Predictor.from_model(model(0), batch_size=2)
    stream = predictor.stream(frames())
    first = next(stream)
    assert read == [0, 1]
    found = [first, *stream]
    np.testing.assert_array_equal([each.mask for each in found], predictor(NOISE))
    np.testing.assert_array_equal([each.probability for each in found], predictor.probability(NOISE))


def test_an_ensemble_is_the_mean_of_its_networks_and_of_one_that_one() -> None:
    singles = [Predictor.from_model(model(seed)).probability(NOISE) for seed in (0, 1)]
    both = Predictor.from_model(model(0, 1)).probability(NOISE)
    assert np.abs(singles[0] - singles[1]).max() > 0.05
    np.testing.assert_allclose(both, np.mean(singles, axis=0), atol=1e-6)
    network = member(0).network()
    np.testing.assert_allclose(
        Predictor((network,), Preprocessing(32)).probability(NOISE), singles[0], atol=1e-6
    )


def test_flips_take_the_mean_with_the_mirror_image() -> None:
    plain = Predictor.from_model(model(0))
    mirrored = plain.probability(NOISE[..., ::-1])[..., ::-1]
    flipped = Predictor.from_model(model(0, flips=True))
    expected = (plain.probability(NOISE) + mirrored) / 2
    np.testing.assert_allclose(flipped.probability(NOISE), expected, atol=1e-5)
    np.testing.assert_allclose(
        flipped.probability(NOISE[..., ::-1]), flipped.probability(NOISE)[..., ::-1], atol=1e-5
    )


def test_calibration_acts_on_the_logit_and_the_neutral_one_not_at_all() -> None:
    raw = Predictor.from_model(model(0, 1)).probability(NOISE)
    neutral = Predictor.from_model(model(0, 1, calibration=TemperatureScaling()))
    np.testing.assert_allclose(neutral.probability(NOISE), raw, atol=1e-6)
    platt = Predictor.from_model(model(0, 1, calibration=TemperatureScaling(2.0, 1.0)))
    logit = np.log(raw.astype(np.float64) / (1 - raw)) / 2 + 1
    np.testing.assert_allclose(platt.probability(NOISE), 1 / (1 + np.exp(-logit)), atol=1e-6)


@pytest.mark.parametrize("temperature", [0.3, 1.0, 7.0])
def test_a_temperature_alone_does_not_change_the_mask_at_one_half(temperature: float) -> None:
    raw = Predictor.from_model(model(0, 1))
    scaled = Predictor.from_model(model(0, 1, calibration=TemperatureScaling(temperature)))
    assert 0 < raw(NOISE).sum() < NOISE.size
    np.testing.assert_array_equal(scaled(NOISE), raw(NOISE))


OPTION = Option(Hysteresis(0.3, 0.6), Morphology(min_area_mm2=30.0, min_area_px=12.0, fill_holes=True))


def test_thresholds_and_morphology_are_the_models_own_with_the_frames_spacing() -> None:
    predictor = Predictor(BrightIsVessel(), BRIGHT.preprocessing, postprocessing=OPTION)
    frame = bright_square(64, 64)
    (found,) = predictor.stream([Frame(frame, (0.1, 0.1))])
    assert found.probability.max() > 0.9 and not found.mask.any()
    (found,) = predictor.stream([Frame(frame, (1.0, 1.0))])
    np.testing.assert_array_equal(found.mask, OPTION(found.probability, (1.0, 1.0)))
    assert found.area_px == found.mask.sum() > 200
    assert found.confidence == pytest.approx(float(found.probability[found.mask].mean()))
    np.testing.assert_array_equal(predictor(frame), predictor(frame, (1.0, 1.0)))
    assert not predictor(frame, (0.1, 0.1)).any()


class Absent(nn.Module):
    """Finds a vessel in the bright and is sure that there is one where the image is bright on average."""

    def forward(self, images: torch.Tensor) -> SideOutputs:
        return SideOutputs(20 * (images - 0.5), (), 100 * (images.mean(dim=(1, 2, 3)) - 0.02))


def test_the_presence_gate_empties_masks_of_frames_without_a_vessel() -> None:
    faint = np.zeros((64, 64), np.uint8)
    faint[30:34, 30:34] = 255
    frames = [Frame(bright_square(64, 64)), Frame(faint)]
    gated = Predictor(Absent(), BRIGHT.preprocessing, min_presence=0.5)
    open_gate = Predictor(Absent(), BRIGHT.preprocessing)
    shown, empty = gated.stream(frames)
    assert shown.presence > 0.9 and empty.presence < 0.3
    assert shown.mask.any() and not empty.mask.any() and not empty.soft_mask.max() >= 0.5
    assert all(found.mask.any() for found in open_gate.stream(frames))
    assert [found.presence for found in BRIGHT.stream(frames)] == [None, None]


def test_a_model_file_predicts_as_its_model(tmp_path) -> None:
    whole = model(0, 1, calibration=TemperatureScaling(1.4, -0.2), postprocessing=threshold(0.4), flips=True)
    whole.save(tmp_path / "model.pt")
    loaded, before = Predictor.load(tmp_path / "model.pt"), Predictor.from_model(whole)
    np.testing.assert_array_equal(loaded.probability(NOISE), before.probability(NOISE))
    np.testing.assert_array_equal(loaded(NOISE), before.probability(NOISE) >= np.float32(0.4))


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
