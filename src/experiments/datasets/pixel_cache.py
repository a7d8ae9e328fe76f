"""Grey images and masks of a data set on disk: decoded once, then mapped from one file.

Decoding 1100 pairs of 709x749 pixels takes half a minute or more in every process that trains on them; mapping what
was decoded takes a fraction of a second.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np

from experiments import files
from experiments.datasets.images import image_files
from experiments.datasets.sweep_cache import cache_folder

Arrays = tuple[np.ndarray, ...]
OWN = ("models.", "experiments.")


def read_pairs(
    images: Sequence[Path],
    masks: Sequence[Path],
    vessel: Sequence[int],
    others: Sequence[int],
    cache: str | None,
) -> tuple[Arrays, Arrays]:
    """Images, uint8, and masks, bool, of paired files; the first that can't be taken is an InputError by name.

    ``vessel`` and ``others`` are the labels that a mask may hold. What was read is kept in the folder ``cache`` (None:
    nowhere) under the files' names, sizes and times of change, and read again once one of them differs. A folder that
    can't be written to is no failure.
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
    """The masks alone, of images of these sizes, as ``read_pairs`` reads and keeps them."""
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
    """The arrays of an entry, mapped from disk; None if it is not there or damaged."""
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
    """What decides the content: each file's name, size and time of change, and the source of what reads it."""
    digest = hashlib.sha256(f"{what} {_source_hash()}".encode())
    for path in paths:
        about = path.stat()
        digest.update(f"{path.absolute()} {about.st_size} {about.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:32]


@lru_cache(maxsize=1)
def _source_hash() -> str:
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources())).hexdigest()


def sources() -> tuple[Path, ...]:
    """The files of ``reading`` and of all modules of this project whose functions and classes it draws on."""
    found: dict[str, ModuleType] = {}
    waiting = [image_files]
    while waiting:
        module = waiting.pop()
        found[module.__name__] = module
        owners = {str(getattr(value, "__module__", "")) for value in vars(module).values()}
        owned = [name for name in owners - found.keys() if name.startswith(OWN) and name in sys.modules]
        waiting.extend(sys.modules[name] for name in owned)
    return tuple(Path(str(found[name].__file__)) for name in sorted(found))
