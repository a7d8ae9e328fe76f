"""Simulated sweeps kept on disk: made when first asked for, never read once outdated."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.paths import project_root
from experiments.process_pool import process_pool
from registration.phantom.settings import PhantomSettings

if TYPE_CHECKING:
    from registration.phantom.simulator import SweepSimulator

# Raise it by one whenever the simulator (``registration.phantom``, ``datasets.vessel_pair``) makes other frames or
# masks of the same settings than before: entries of the version before are then never read again. A test of this module
# simulates known sweeps and fails when they change without it.
CACHE_VERSION = 1
# Starting a process takes about as long as simulating this many frames.
WORTH_A_PROCESS = 60


@dataclass(frozen=True)
class SweepRecipe:
    """All that decides a simulated sweep.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.
    number : int
        Number of the sweep.
    district : str
        ``carotid`` or ``femoral``: an artery and a vein next to each other, drawn by the settings' anatomy
        seed; masks hold labels (0 background, 1 vein, 2 artery). Empty: the vessel of the settings; masks are
        bool.
    """

    settings: PhantomSettings
    number: int
    district: str = ""

    @property
    def mask_kind(self) -> np.dtype:
        """What the masks are made of."""
        return np.dtype(np.uint8) if self.district else np.dtype(np.bool_)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, height and width."""
        scanner = self.settings.scanner
        return self.settings.motion.frames, scanner.height_px, scanner.width_px

    def maker(self) -> SweepSimulator:
        """Return what makes the frames.

        Returns
        -------
        SweepSimulator
            The simulator of this sweep.
        """
        if self.district:
            from experiments.datasets.vessel_pair import PairSimulator

            return PairSimulator(self.settings, self.number, self.district)
        from registration.phantom.simulator import SweepSimulator

        return SweepSimulator(self.settings, self.number)


def cache_folder(cache: str) -> Path:
    """Return the folder that a setting ``cache`` names.

    Parameters
    ----------
    cache : str
        A path, relative to the project's folder unless it is absolute.

    Returns
    -------
    Path
        The folder.
    """
    return project_root() / Path(cache).expanduser()


def labelled_sweep(recipe: SweepRecipe, cache: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read one sweep from the cache, or simulate it and store it there.

    Parameters
    ----------
    recipe : SweepRecipe
        The sweep.
    cache : Path
        Folder of the cache; an entry that does not fit is made again.

    Returns
    -------
    (ndarray of uint8, ndarray)
        Images and masks, each of shape (n, h, w), mapped from disk: large sets need no memory until they are
        used.

    Raises
    ------
    InputError
        If the folder does not keep what is written to it.
    """
    kept = _read(recipe, cache)
    if kept is None:
        fill_cache(recipe, cache)
        kept = _read(recipe, cache)
    if kept is None:
        raise InputError(f"cache: expected a folder that keeps what is written to it, {cache} did not")
    return kept


def prepare(recipes: Sequence[SweepRecipe], cache: Path, workers: int) -> None:
    """Fill the cache by several processes, where there are several sweeps to make and it pays.

    Parameters
    ----------
    recipes : sequence of SweepRecipe
        The sweeps.
    cache : Path
        Folder of the cache.
    workers : int
        Number of processes at most.
    """
    missing = [recipe for recipe in recipes if _read(recipe, cache) is None]
    frames = sum(recipe.shape[0] for recipe in missing)
    if workers == 1 or len(missing) < 2 or frames < WORTH_A_PROCESS:
        return
    with process_pool(min(workers, len(missing))) as pool:
        made = [pool.submit(fill_cache, recipe, cache) for recipe in missing]
        for one in made:
            one.result()


def fill_cache(recipe: SweepRecipe, cache: Path) -> None:
    """Simulate one sweep and store its frames and masks in the cache, both or neither.

    Parameters
    ----------
    recipe : SweepRecipe
        The sweep.
    cache : Path
        Folder of the cache.

    Notes
    -----
    Each frame is written as it is made: a long sweep needs no more memory than a short one.
    """
    maker = recipe.maker()
    with (
        files.staged(cache / sweep_hash(recipe)) as folder,
        (folder / "images.npy").open("wb") as images,
        (folder / "masks.npy").open("wb") as masks,
    ):
        _write_header(images, np.dtype(np.uint8), recipe.shape)
        _write_header(masks, recipe.mask_kind, recipe.shape)
        for frame in range(recipe.shape[0]):
            picture, mask, _ = maker.frame(frame, maker.view(frame))
            images.write(picture.tobytes())
            masks.write(mask.astype(recipe.mask_kind).tobytes())


def _write_header(stream: BinaryIO, kind: np.dtype, shape: tuple[int, ...]) -> None:
    header = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)


def sweep_hash(recipe: SweepRecipe) -> str:
    """Hash what decides a sweep's content: all settings, its number, and the version of the simulator.

    Parameters
    ----------
    recipe : SweepRecipe
        The sweep.

    Returns
    -------
    str
        32 hexadecimal digits, the name of the sweep's folder in the cache.
    """
    text = f"{recipe.settings.digest()} {recipe.number} {recipe.district} {CACHE_VERSION}"
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _read(recipe: SweepRecipe, cache: Path) -> tuple[np.ndarray, np.ndarray] | None:
    entry = cache / sweep_hash(recipe)
    try:
        images = np.load(entry / "images.npy", mmap_mode="r")
        masks = np.load(entry / "masks.npy", mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return None
    if images.shape != recipe.shape or masks.shape != recipe.shape:
        return None
    if images.dtype != np.uint8 or masks.dtype != recipe.mask_kind:
        return None
    return np.asarray(images), np.asarray(masks)
