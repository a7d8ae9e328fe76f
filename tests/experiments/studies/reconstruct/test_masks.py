"""Masks go to the frames they belong to, whatever they are called; what does not fit is refused by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sweeps import known_sweep

from experiments.errors import InputError
from experiments.studies.reconstruct.masks import read_masks
from registration.readers.folder import write_folder
from registration.sweep import TrackedSweep

SWEEP: TrackedSweep = known_sweep(frame_count=12)


def frame(index: int) -> np.ndarray:
    """A mask that tells its number: so many pixels are vessel."""
    mask = np.zeros(SWEEP.images.shape[1:], dtype=np.uint8)
    mask.flat[: index + 1] = 255
    return mask


def counted(folder: Path, sweep_path: Path) -> list[int]:
    masks = read_masks(folder, sweep_path, SWEEP)
    assert masks.dtype == np.bool_
    return masks.sum(axis=(1, 2)).tolist()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "masks").mkdir()
    return tmp_path / "masks"


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    write_folder(tmp_path / "plain", SWEEP)
    return tmp_path / "plain"


def test_masks_of_unnamed_frames_follow_their_numbers(folder: Path) -> None:
    for index in range(12):
        Image.fromarray(frame(index)).save(folder / f"mask_{index}.png")
    # As text, mask_10 would come before mask_2.
    assert counted(folder, Path("a.igs.mha")) == list(range(1, 13))


@pytest.mark.parametrize("name", ["{:06d}", "vessel {}", "{:03d}"])
def test_masks_of_a_plain_folder_have_their_frames_name_or_number(
    folder: Path, plain: Path, name: str
) -> None:
    for index in range(12):
        Image.fromarray(frame(index)).save(folder / f"{name.format(index)}.png")
    assert counted(folder, plain) == list(range(1, 13))
    # The order of the frames counts, not that of the names.
    rows = (plain / "frames.csv").read_text().splitlines()
    (plain / "frames.csv").write_text("\n".join([rows[0], *rows[:0:-1]]))
    assert counted(folder, plain) == list(range(12, 0, -1))


FORMS = {
    "palette, white first": lambda mask: palette(mask == 0, [255, 255, 255, 0, 0, 0]),
    "palette, red": lambda mask: palette(mask > 0, [0, 0, 0, 255, 0, 0]),
    "1 bit": lambda mask: Image.fromarray(mask > 0),
    "16 bits": lambda mask: Image.fromarray(mask.astype(np.uint16) * 257),
    "red": lambda mask: Image.fromarray(np.dstack([mask, mask * 0, mask * 0])),
    "alpha": lambda mask: Image.fromarray(np.dstack([mask * 0 + 255, mask])),
}


def palette(indices: np.ndarray, colours: list[int]) -> Image.Image:
    image = Image.fromarray(indices.astype(np.uint8), "P")
    image.putpalette(colours)
    return image


@pytest.mark.parametrize("form", FORMS)
def test_masks_are_the_same_in_every_form(folder: Path, form: str) -> None:
    for index in range(12):
        FORMS[form](frame(index)).save(folder / f"{index}.png")
    assert counted(folder, Path("a.igs.mha")) == list(range(1, 13))
    # Empty masks next to them, in yet another form.
    Image.fromarray(frame(3) * 0).save(folder / "3.png")
    assert counted(folder, Path("a.igs.mha"))[3] == 0


def test_probabilities_of_16_bits_and_labels_in_colour(folder: Path) -> None:
    for index in range(12):
        values = np.where(frame(index) > 0, 60000, 9000).astype(np.uint16)
        Image.fromarray(values).save(folder / f"{index}.png")
    probability = read_masks(folder, Path("a.igs.mha"), SWEEP)
    np.testing.assert_allclose(np.unique(probability), [9000 / 65535, 60000 / 65535], rtol=1e-6)
    labels = np.zeros(SWEEP.images.shape[1:], np.uint8)
    labels.flat[:2] = 1, 2
    palette(labels, [0, 0, 0, 255, 0, 0, 0, 255, 0]).save(folder / "0.png")
    with pytest.raises(InputError, match=r"0\.png: expected labels 0, 1, 255, received 2"):
        read_masks(folder, Path("a.igs.mha"), SWEEP)


def test_masks_of_1_and_of_255_together_are_refused(folder: Path) -> None:
    for index in range(12):
        Image.fromarray(frame(index) // (255 if index == 4 else 1)).save(folder / f"{index}.png")
    with pytest.raises(InputError, match=r"masks: expected values 0 and 1, 0 and 255, .* received 1 and 255"):
        read_masks(folder, Path("a.igs.mha"), SWEEP)


def test_an_accent_does_not_part_a_mask_from_its_frame(folder: Path, plain: Path) -> None:
    rows = (plain / "frames.csv").read_text().splitlines()
    (plain / "frames.csv").write_text("\n".join([rows[0], *(f"e\u0301_{row}" for row in rows[1:])]))
    for index in range(12):
        Image.fromarray(frame(index)).save(folder / f"\u00e9_{index:06d}.png")
    assert counted(folder, plain) == list(range(1, 13))


def test_a_mask_of_another_name_is_refused(folder: Path, plain: Path) -> None:
    for index in range(1, 13):
        Image.fromarray(frame(index)).save(folder / f"{index:06d}.png")
    with pytest.raises(InputError, match="masks: expected one of the same name or number as frame 000000"):
        read_masks(folder, plain, SWEEP)


def test_arrays_and_values_are_taken_as_what_they_are(tmp_path: Path, folder: Path) -> None:
    stack = np.stack([frame(index) for index in range(12)])
    path = tmp_path / "all.npy"
    for values in (stack, stack // 255, stack > 0, (stack > 0).astype(np.float64)):
        np.save(path, values)
        masks = read_masks(path, Path("a.igs.mha"), SWEEP)
        assert masks.dtype == np.bool_
        np.testing.assert_array_equal(masks, stack > 0)
    grey = np.where(stack > 0, 200, 51).astype(np.uint8)
    for index, values in enumerate(grey):
        np.save(folder / f"{index}.npy", values)
    for source in (folder, path):
        np.save(path, grey / np.float32(255))
        probability = read_masks(source, Path("a.igs.mha"), SWEEP)
        assert probability.dtype == np.float32
        np.testing.assert_allclose(probability, np.where(stack > 0, 200 / 255, 0.2), rtol=1e-6)


def test_what_does_not_fit_is_refused(tmp_path: Path, folder: Path) -> None:
    path, unnamed = tmp_path / "all.npy", Path("a.igs.mha")
    with pytest.raises(
        InputError, match=r"masks: expected a folder of masks or a \.npy file, received 'absent'"
    ):
        read_masks(Path("absent"), unnamed, SWEEP)
    empty = np.zeros(SWEEP.images.shape, np.uint8)
    refusals = {
        "received 12 empty ones": empty,
        "received labels up to 2": empty + np.uint8(2),
        "probabilities from 0 to 1": empty + np.float32(1.5),
        "expected an array of shape": empty[:, 1:],
        "expected bool, uint8 or float values, received int64": empty.astype(np.int64),
    }
    for message, values in refusals.items():
        np.save(path, values)
        with pytest.raises(InputError, match=message):
            read_masks(path, unnamed, SWEEP)
    path.write_bytes(b"no array")
    with pytest.raises(InputError, match=r"all\.npy: expected a \.npy file of numbers"):
        read_masks(path, unnamed, SWEEP)
    for index in range(12):
        Image.fromarray(frame(index)).save(folder / f"{index}.png")
    lost = replace(known_sweep(frame_count=11), dropped={"INVALID": 3})
    with pytest.raises(
        InputError, match=r"each of 11 frames \(3 more were dropped on reading\), received 12"
    ):
        read_masks(folder, unnamed, lost)
    Image.fromarray(frame(0)[:, 1:]).save(folder / "7.png")
    with pytest.raises(InputError, match=r"7\.png: expected a mask of its frame's 11x8, received 10x8"):
        read_masks(folder, unnamed, SWEEP)


@pytest.mark.parametrize("bright", [1, 128, 150, 254, 255])
def test_two_values_are_a_mask_whatever_the_brighter_one_is(folder: Path, bright: int) -> None:
    for index in range(12):
        Image.fromarray((frame(index) > 0).astype(np.uint8) * np.uint8(bright)).save(folder / f"{index}.png")
    assert counted(folder, Path("a.igs.mha")) == list(range(1, 13))


def test_masks_of_the_background_are_refused(folder: Path) -> None:
    for index in range(12):
        Image.fromarray(255 - frame(index)).save(folder / f"{index}.png")
    with pytest.raises(InputError, match=r"cover \d\d% of the picture and its border: are vessel and"):
        read_masks(folder, Path("a.igs.mha"), SWEEP)


def test_a_vessel_that_fills_the_picture_up_to_its_border_alone_is_one(folder: Path) -> None:
    height, width = SWEEP.images.shape[1:]
    large = np.zeros((height, width), dtype=np.uint8)
    large[1:-1, 1:-1] = 255
    for index in range(12):
        Image.fromarray(large).save(folder / f"{index}.png")
    assert read_masks(folder, Path("a.igs.mha"), SWEEP).sum() == 12 * (height - 2) * (width - 2)


def test_pictures_in_place_of_masks_are_refused(folder: Path) -> None:
    rng = np.random.default_rng(0)
    for index in range(12):
        noisy = rng.rayleigh(40, SWEEP.images.shape[1:]).clip(0, 255).astype(np.uint8)
        Image.fromarray(noisy).save(folder / f"{index}.png")
    with pytest.raises(
        InputError, match=r"received pictures in .*: \d\d% of the pixels are neither dark nor"
    ):
        read_masks(folder, Path("a.igs.mha"), SWEEP)


def test_probabilities_with_a_soft_edge_stay_probabilities(folder: Path) -> None:
    for index in range(12):
        soft = frame(index)
        soft.flat[index + 1] = 128
        Image.fromarray(soft).save(folder / f"{index}.png")
    masks = read_masks(folder, Path("a.igs.mha"), SWEEP)
    assert masks.dtype == np.float32 and np.unique(masks).tolist() == pytest.approx([0, 128 / 255, 1])


def test_the_frame_without_a_mask_and_the_mask_without_a_frame_are_named(folder: Path, plain: Path) -> None:
    for index in range(12):
        Image.fromarray(frame(index)).save(folder / f"mask {index}.png")
    (folder / "mask 7.png").unlink()
    with pytest.raises(
        InputError, match=r"12 frames, received 11 in .* \(no mask for frame 0*7\); a frame without"
    ):
        read_masks(folder, plain, SWEEP)
    for index in (7, 40):
        Image.fromarray(frame(1)).save(folder / f"mask {index}.png")
    with pytest.raises(InputError, match=r"received 13 in .* \(no frame for mask mask 40\)"):
        read_masks(folder, plain, SWEEP)
    # Numbered from 1 in place of 0: both first names show it.
    (folder / "mask 40.png").unlink()
    (folder / "mask 0.png").rename(folder / "mask 12.png")
    with pytest.raises(
        InputError, match=r"frame 0*0 in .* \(the first mask is mask 1, the first frame 0*0\)"
    ):
        read_masks(folder, plain, SWEEP)
