"""Grey images and masks of a data set on disk: decoded once, then mapped from one file.

Decoding 1100 pairs of 709x749 pixels takes half a minute or more in every process that trains on them; mapping what
was decoded takes a fraction of a second.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from experiments import files
from experiments.datasets.content_key import content_key
from experiments.datasets.images import image_files
from experiments.datasets.sweep_cache import cache_folder

Arrays = tuple[np.ndarray, ...]
# Raise it by one whenever a file is decoded to other pixels than before (``datasets.images``, or
# ``models.preprocessing.grey``): entries of the version before are then never read again. A test of this module
# decodes known files and fails when the pixels change without it.
CACHE_VERSION = 1


def read_pairs(
    images: Sequence[Path],
    masks: Sequence[Path],
    vessel: Sequence[int],
    others: Sequence[int],
    cache: str | None,
) -> tuple[Arrays, Arrays]:
    """Read images and masks of paired files.

    Parameters
    ----------
    images : sequence of Path
        n image files.
    masks : sequence of Path
        Their n mask files.
    vessel : sequence of int
        Labels of the vessel.
    others : sequence of int
        Further labels that a mask may hold.
    cache : str or None
        Folder for decoded pixels; None: they are not stored. One that can't be written to is no failure.

    Returns
    -------
    (tuple of ndarray of uint8, tuple of ndarray of bool)
        Images and masks, each of shape (h, w).

    Raises
    ------
    InputError
        If a file can't be read as expected; the message names the first.

    Notes
    -----
    Entries are named by the files' paths, sizes and times of change, and files are read again once one of
    these differs.
    """
    folder = cache_folder(cache) if cache else None
    grey = _kept(
        folder, _key(images, "grey"), np.uint8, lambda: [image_files.read_grey(path) for path in images]
    )
    return grey, read_masks(masks, [image.shape for image in grey], vessel, others, cache)


def read_masks(
    masks: Sequence[Path],
    sizes: Sequence[tuple[int, ...]],
    vessel: Sequence[int],
    others: Sequence[int],
    cache: str | None,
) -> Arrays:
    """Read masks alone, as ``read_pairs`` does.

    Parameters
    ----------
    masks : sequence of Path
        n mask files.
    sizes : sequence of tuple of int
        Height and width of their images in px.
    vessel : sequence of int
        Labels of the vessel.
    others : sequence of int
        Further labels that a mask may hold.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.

    Returns
    -------
    tuple of ndarray of bool, shape (h, w)
        The masks.

    Raises
    ------
    InputError
        If a file can't be read as expected; the message names the first.
    """
    folder = cache_folder(cache) if cache else None
    labels = sorted(vessel), sorted(others)
    return _kept(
        folder,
        _key(masks, f"mask {labels} {list(sizes)}"),
        np.bool_,
        lambda: [image_files.read_mask(path, *labels, size) for path, size in zip(masks, sizes, strict=True)],
    )


def _kept(folder: Path | None, key: str, kind: type, read: Callable[[], list[np.ndarray]]) -> Arrays:
    if folder is None:
        return tuple(read())
    kept = _mapped(folder / key, kind)
    if kept is not None:
        return kept
    fresh = tuple(read())
    try:
        with files.staged(folder / key) as stage:
            np.save(stage / "sizes.npy", np.array([one.shape for one in fresh]))
            with (stage / "pixels.bin").open("wb") as stream:
                for one in fresh:
                    stream.write(one.tobytes())
    except OSError:
        # The cache only saves time: without room for it the images are as good.
        return fresh
    return _mapped(folder / key, kind) or fresh


def _mapped(entry: Path, kind: type) -> Arrays | None:
    """Return the arrays of an entry, mapped from disk; None if it is not there or damaged."""
    try:
        sizes = np.load(entry / "sizes.npy")
        pixels = np.memmap(entry / "pixels.bin", dtype=kind, mode="r")
    except (OSError, ValueError, EOFError):
        return None
    ends = np.cumsum(sizes.prod(axis=1))
    if pixels.size != ends[-1]:
        return None
    flat = np.asarray(pixels)
    return tuple(
        flat[end - height * width : end].reshape(height, width)
        for end, (height, width) in zip(ends.tolist(), sizes.tolist(), strict=True)
    )


def _key(paths: Sequence[Path], what: str) -> str:
    """Hash what decides the content: the state of each file, and the version of the decoding."""
    return content_key(paths, f"{what} {CACHE_VERSION}")
