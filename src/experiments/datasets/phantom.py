"""The simulated phantom as a data set: frames with exact masks, made when first asked for and kept on disk."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.paths import project_root
from models.labelled_frames import LabelledFrames
from registration.phantom.settings import SUBSETS, PhantomSettings

ALL = "all"


@dataclass(frozen=True)
class Phantom:
    """Labelled frames of simulated sweeps; each sweep is one group.

    ``subset`` is artificial, vein, artery, or all three. Sweeps number ``first_sweep`` to ``first_sweep + sweeps - 1``
    are made, of ``frames_per_sweep`` frames each, ``size_px`` high and wide. All else is as in ``settings``, whose own
    subset and number of frames are not used. ``cache`` is a folder, taken from the project's where it is relative; what
    lies in it is named by a hash of all settings and of the simulator's source, so that nothing outdated is ever read.
    """

    subset: str = ALL
    sweeps: int = 2
    frames_per_sweep: int = 30
    size_px: int = 256
    seed: int = 0
    first_sweep: int = 0
    cache: str = ".cache/phantom"
    settings: PhantomSettings = field(default_factory=PhantomSettings)

    def __post_init__(self) -> None:
        if self.subset not in (*SUBSETS, ALL):
            raise InputError(f"subset: expected {', '.join(SUBSETS)} or {ALL}, received {self.subset!r}")
        for name, least in (
            ("sweeps", 1),
            ("frames_per_sweep", 2),
            ("size_px", 16),
            ("seed", 0),
            ("first_sweep", 0),
        ):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected at least {least}, received {getattr(self, name)!r}")

    def __call__(self) -> LabelledFrames:
        """Simulate what is not in the cache and return all frames in order of subset, sweep and time."""
        images: list[np.ndarray] = []
        masks: list[np.ndarray] = []
        names: list[tuple[str, str]] = []
        spacing: list[tuple[float, float]] = []
        for subset in SUBSETS if self.subset == ALL else (self.subset,):
            settings = self.settings_of(subset)
            side_mm = settings.scanner.pixel_mm
            for sweep in range(self.first_sweep, self.first_sweep + self.sweeps):
                sweep_images, sweep_masks = labelled_sweep(settings, sweep, self._folder)
                images.extend(sweep_images)
                masks.extend(sweep_masks)
                group = f"{subset}-sweep{sweep}"
                names.extend((f"{group}-frame{frame:03d}", group) for frame in range(len(sweep_images)))
                spacing.extend([(side_mm, side_mm)] * len(sweep_images))
        return LabelledFrames(
            images=tuple(images),
            masks=tuple(masks),
            case_ids=tuple(case for case, _ in names),
            groups=tuple(group for _, group in names),
            spacing_mm=tuple(spacing),
            simulated=True,
        )

    def settings_of(self, subset: str) -> PhantomSettings:
        """The simulator's settings for one of the phantoms."""
        return dataclasses.replace(
            self.settings,
            subset=subset,
            seed=self.seed,
            scanner=dataclasses.replace(self.settings.scanner, height_px=self.size_px, width_px=self.size_px),
            motion=dataclasses.replace(self.settings.motion, frames=self.frames_per_sweep),
        )

    @property
    def _folder(self) -> Path:
        return project_root() / Path(self.cache).expanduser()


def labelled_sweep(settings: PhantomSettings, sweep: int, cache: Path) -> tuple[np.ndarray, np.ndarray]:
    """Images (n, height, width) uint8 and masks, bool, of one sweep: read from the cache, or simulated and put there.

    The arrays are mapped from disk, so that large sets need no memory until they are used. A cache entry that does
    not fit is made again.
    """
    entry = cache / sweep_hash(settings, sweep)
    shape = (settings.motion.frames, settings.scanner.height_px, settings.scanner.width_px)
    if (kept := _read(entry, shape)) is not None:
        return kept
    from registration.phantom.scan import simulate_sweep

    simulated = simulate_sweep(settings, sweep)
    with files.staged(entry) as folder:
        np.save(folder / "images.npy", simulated.sweep.images)
        np.save(folder / "masks.npy", simulated.masks)
    return simulated.sweep.images, simulated.masks


def sweep_hash(settings: PhantomSettings, sweep: int) -> str:
    """What decides a sweep's content: all settings, its number, and the simulator's source."""
    text = json.dumps([dataclasses.asdict(settings), sweep, _source_hash()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def _source_hash() -> str:
    digest = hashlib.sha256()
    for module in sorted(resources.files("registration.phantom").iterdir(), key=lambda item: item.name):
        if module.name.endswith(".py"):
            digest.update(module.name.encode() + module.read_bytes())
    return digest.hexdigest()


def _read(entry: Path, shape: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray] | None:
    try:
        images = np.load(entry / "images.npy", mmap_mode="r")
        masks = np.load(entry / "masks.npy", mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return None
    if images.shape != shape or masks.shape != shape or images.dtype != np.uint8 or masks.dtype != np.bool_:
        return None
    return np.asarray(images), np.asarray(masks)
