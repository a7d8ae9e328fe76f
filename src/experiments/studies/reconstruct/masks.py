"""Masks of a tracked sweep from a user's files: one for each frame, binary or as probabilities."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.datasets.images.image_files import image_files, read_mask_values
from experiments.errors import InputError, reading
from experiments.unicode_names import same_name
from registration.input_files import require_regular
from registration.natural_order import natural_key
from registration.readers.folder import frame_names

if TYPE_CHECKING:
    from registration.sweep import TrackedSweep

# Of a picture more than this share of the pixels is neither dark nor white (a quarter and more of real B-mode frames),
PICTURE_SHARE = 0.15
# and it has more grey values than this.
PICTURE_LEVELS = 32


def read_masks(path: Path, sweep_path: Path, sweep: TrackedSweep) -> np.ndarray:
    """Read the masks of all frames of a sweep.

    The frames of a plain folder have names: their masks have the same ones, or the same numbers in them.
    Frames of other files are in order: masks follow in the order of their names, numbers compared as numbers.
    What an image's colours, bits and transparency mean is defined in ``label_values``; grey values of 0 and
    1, or of 0 and one in the brighter half, are masks; others are probabilities as fractions of white.

    Parameters
    ----------
    path : Path
        Folder with an image or a .npy array for each frame, or one .npy file of all.
    sweep_path : Path
        Path of the sweep.
    sweep : TrackedSweep
        Tracked sweep.

    Returns
    -------
    ndarray, shape (n, height, width)
        Masks as bool, or probabilities between 0 and 1 as float32.

    Raises
    ------
    InputError
        If a count, name, size or value does not fit, no mask shows a vessel, vessel and background are exchanged, or
        the masks are pictures.
    """
    if path.is_file():
        stack = _array(path)
        if stack.shape != sweep.images.shape:
            raise InputError(
                f"masks: expected an array of shape {sweep.images.shape} as the frames in {path}, "
                f"received {stack.shape}"
            )
    elif path.is_dir():
        stack = _read_folder(path, sweep_path, sweep)
    else:
        raise InputError(f"masks: expected a folder of masks or a .npy file, received {str(path)!r}")
    values = _values(stack, path)
    _require_vessel(values, path)
    return values


def _read_folder(path: Path, sweep_path: Path, sweep: TrackedSweep) -> np.ndarray:
    arrays = {same_name(file.stem): file for file in path.glob("*.npy")}
    files = arrays or image_files(path)
    if len(files) != len(sweep.images):
        lost = sweep.frames_dropped
        hint = f" ({lost} more were dropped on reading)" if lost else ""
        raise InputError(
            f"masks: expected one for each of {len(sweep.images)} frames{hint}, received {len(files)} in {path}"
            f"{_one_apart(files, frame_names(sweep_path))}; a frame without a vessel has an empty mask"
        )
    height, width = sweep.images.shape[1:]
    stack = []
    for name in _in_order_of(files, frame_names(sweep_path), path):
        values = _array(files[name]) if arrays else read_mask_values(files[name])
        if values.shape != (height, width):
            size = "x".join(str(side) for side in values.shape[::-1])
            raise InputError(
                f"{files[name]}: expected a mask of its frame's {width}x{height}, received {size}"
            )
        stack.append(values)
    return _stacked(stack)


def _one_apart(files: Collection[str], frames: tuple[str, ...] | None) -> str:
    """The first frame without a mask or mask without a frame, where both have names or numbers."""
    if frames is None:
        return ""
    for own, others, what in ((frames, files, "no mask for frame"), (files, frames, "no frame for mask")):
        names = {same_name(name) for name in others}
        numbers = {_number(name) for name in names}
        for name in sorted(own, key=natural_key):
            if same_name(name) not in names and _number(same_name(name)) not in numbers:
                return f" ({what} {name})"
    return ""


def _stacked(masks: Sequence[np.ndarray]) -> np.ndarray:
    """Masks of one kind in one array; black-and-white ones go with grey ones of any depth."""
    grey = {mask.dtype for mask in masks if mask.dtype != np.bool_}
    if len(grey) != 1:
        return np.stack([np.asarray(mask, dtype=np.float32) for mask in masks] if grey else masks)
    kind = grey.pop()
    by_one = kind.kind == "f" or max(mask.max() for mask in masks) <= 1
    white = 1 if by_one else np.iinfo(kind).max
    return np.stack([mask * kind.type(white) if mask.dtype == np.bool_ else mask for mask in masks])


def _in_order_of(files: dict[str, Path], frames: tuple[str, ...] | None, path: Path) -> list[str]:
    """The masks' names in the order of the frames, whose names are None where they have none."""
    if frames is None:
        return sorted(files, key=natural_key)
    frames = tuple(same_name(name) for name in frames)
    if set(frames) == set(files):
        return list(frames)
    numbered = {_number(name): name for name in files}
    missing = next((name for name in frames if _number(name) not in numbered), None)
    if missing is not None or None in numbered or len(numbered) < len(files):
        raise InputError(
            f"masks: expected one of the same name or number as frame {missing or frames[0]} in {path}, received none "
            f"(the first mask is {min(files, key=natural_key)}, the first frame {min(frames, key=natural_key)})"
        )
    return [numbered[_number(name)] for name in frames]


def _number(name: str) -> int | None:
    """The last number in a name."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else None


def _array(path: Path) -> np.ndarray:
    with reading(path, "a .npy file of numbers"):
        values: np.ndarray = np.load(require_regular(path), allow_pickle=False)
    if values.dtype != np.bool_ and values.dtype != np.uint8 and values.dtype.kind != "f":
        raise InputError(f"{path}: expected bool, uint8 or float values, received {values.dtype}")
    return values


def _from_grey(stack: np.ndarray, path: Path) -> np.ndarray:
    full = int(np.iinfo(stack.dtype).max)
    found = np.flatnonzero(np.bincount(stack.ravel(), minlength=full + 1))
    # Two values are a mask whatever the brighter one is: an image editor writes 254 or 200 as well.
    if (
        set(found) <= {0, 1}
        or set(found) == {full}
        or (len(found) == 2 and not found[0] and found[1] > full // 2)
    ):
        return stack > 0
    if found[-1] <= full // 2 or set(found) <= {0, 1, full}:
        raise InputError(
            f"masks: expected values 0 and 1, 0 and {full}, or probabilities up to {full} in {path}, "
            f"received {'1 and ' if found[-1] > full // 2 else 'labels up to '}{found[-1]}"
        )
    shares = stack.astype(np.float32) / full
    undecided = float(np.median([((each > 0.05) & (each < 0.95)).mean() for each in shares]))
    if undecided > PICTURE_SHARE and len(found) > PICTURE_LEVELS:
        raise InputError(
            f"masks: expected masks or probabilities, received pictures in {path}: {undecided:.0%} of the pixels are "
            "neither dark nor white"
        )
    return shares


def _require_vessel(values: np.ndarray, path: Path) -> None:
    """Refuse masks that show no vessel, and those of the background."""
    vessel = values >= 0.5
    if not vessel.any():
        raise InputError(f"masks: expected masks with a vessel, received {len(values)} empty ones in {path}")
    share = float(np.median(vessel.mean(axis=(1, 2))))
    border = np.concatenate([vessel[:, 0], vessel[:, -1], vessel[:, :, 0], vessel[:, :, -1]], axis=1)
    if share > 0.5 and float(np.median(border.mean(axis=1))) > 0.5:
        raise InputError(
            f"masks: expected the vessel bright and all else 0, received masks in {path} that cover {share:.0%} of "
            "the picture and its border: are vessel and background exchanged?"
        )


def _values(stack: np.ndarray, path: Path) -> np.ndarray:
    """Grey values or floats as masks or probabilities."""
    if stack.dtype == np.bool_:
        return stack
    if stack.dtype.kind == "u":
        return _from_grey(stack, path)
    if not (np.isfinite(stack).all() and stack.min() >= 0 and stack.max() <= 1):
        raise InputError(f"masks: expected probabilities from 0 to 1 in {path}, received others")
    # Without a value in between there is no contour below a pixel to be found, and a mask is what it is.
    binary = bool(((stack == 0) | (stack == 1)).all())
    return stack > 0 if binary else stack.astype(np.float32)
