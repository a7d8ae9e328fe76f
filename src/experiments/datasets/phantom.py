"""The simulated phantom as a data set: frames with exact masks, made when first asked for and kept on disk."""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import BinaryIO

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.paths import project_root
from experiments.processes import process_pool
from models.labelled_frames import LabelledFrames
from registration.phantom.settings import SUBSETS, PhantomSettings

ALL = "all"
# Starting a process takes about as long as simulating this many frames.
WORTH_A_PROCESS = 60


@dataclass(frozen=True)
class Phantom:
    """Labelled frames of simulated sweeps; each sweep is one group.

    ``subset`` is artificial, vein, artery, or all three. Sweeps number ``first_sweep`` to ``first_sweep + sweeps - 1``
    are made, of ``frames_per_sweep`` frames each, ``size_px`` high and wide. All else is as in ``settings``, whose own
    subset, seed, size and number of frames are not used. ``workers`` processes share what is to be made. ``cache`` is a
    folder, taken from the project's where it is relative; what lies in it is named by a hash of all settings and of the
    simulator's source, so that nothing outdated is ever read.
    """

    subset: str = ALL
    sweeps: int = 2
    frames_per_sweep: int = 30
    size_px: int = 256
    seed: int = 0
    first_sweep: int = 0
    workers: int = 1
    cache: str = ".cache/phantom"
    settings: PhantomSettings = field(default_factory=PhantomSettings)

    def __post_init__(self) -> None:
        if self.subset not in (*SUBSETS, ALL):
            raise InputError(f"subset: expected {', '.join(SUBSETS)} or {ALL}, received {self.subset!r}")
        least = {"sweeps": 1, "frames_per_sweep": 2, "size_px": 16, "seed": 0, "first_sweep": 0, "workers": 1}
        for name, smallest in least.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
                raise InputError(
                    f"{name}: expected a whole number of at least {smallest}, received {value!r}"
                )

    def __call__(self) -> LabelledFrames:
        """Simulate what is not in the cache and return all frames in order of subset, sweep and time."""
        sweeps = [
            (self.settings_of(subset), sweep)
            for subset in (SUBSETS if self.subset == ALL else (self.subset,))
            for sweep in range(self.first_sweep, self.first_sweep + self.sweeps)
        ]
        self._prepare(sweeps)
        images: list[np.ndarray] = []
        masks: list[np.ndarray] = []
        cases: list[tuple[str, str, float]] = []
        for settings, sweep in sweeps:
            sweep_images, sweep_masks = labelled_sweep(settings, sweep, self._folder)
            images.extend(sweep_images)
            masks.extend(sweep_masks)
            group = f"{settings.subset}-sweep{sweep}"
            side_mm = settings.scanner.pixel_mm
            cases.extend((f"{group}-frame{frame:03d}", group, side_mm) for frame in range(len(sweep_images)))
        return LabelledFrames(
            images=tuple(images),
            masks=tuple(masks),
            case_ids=tuple(case for case, _, _ in cases),
            groups=tuple(group for _, group, _ in cases),
            spacing_mm=tuple((side_mm, side_mm) for _, _, side_mm in cases),
            simulated=True,
        )

    def _prepare(self, sweeps: list[tuple[PhantomSettings, int]]) -> None:
        """Fill the cache by several processes, where there are several sweeps to make and it pays."""
        missing = [one for one in sweeps if not is_cached(*one, self._folder)]
        if self.workers == 1 or len(missing) < 2 or len(missing) * self.frames_per_sweep < WORTH_A_PROCESS:
            return
        with process_pool(min(self.workers, len(missing))) as pool:
            made = [pool.submit(fill_cache, settings, sweep, self._folder) for settings, sweep in missing]
            for one in made:
                one.result()

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
    kept = _read(settings, sweep, cache)
    if kept is None:
        fill_cache(settings, sweep, cache)
        kept = _read(settings, sweep, cache)
    if kept is None:
        raise InputError(f"cache: expected a folder that keeps what is written to it, {cache} did not")
    return kept


def is_cached(settings: PhantomSettings, sweep: int, cache: Path) -> bool:
    """Whether a sweep can be read from the cache as it should be."""
    return _read(settings, sweep, cache) is not None


def fill_cache(settings: PhantomSettings, sweep: int, cache: Path) -> None:
    """Simulate one sweep and put its frames and masks into the cache, both or neither.

    Each frame is written as it is made: a long sweep needs no more memory than a short one.
    """
    from registration.phantom.simulator import SweepSimulator

    maker = SweepSimulator(settings, sweep)
    count = settings.motion.frames
    shape = (count, settings.scanner.height_px, settings.scanner.width_px)
    with (
        files.staged(cache / sweep_hash(settings, sweep)) as folder,
        (folder / "images.npy").open("wb") as images,
        (folder / "masks.npy").open("wb") as masks,
    ):
        _write_header(images, np.dtype(np.uint8), shape)
        _write_header(masks, np.dtype(np.bool_), shape)
        for frame in range(count):
            picture, mask, _ = maker.frame(frame, maker.view(frame))
            images.write(picture.tobytes())
            masks.write(mask.tobytes())


def _write_header(stream: BinaryIO, kind: np.dtype, shape: tuple[int, ...]) -> None:
    about = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, about)


def sweep_hash(settings: PhantomSettings, sweep: int) -> str:
    """What decides a sweep's content: all settings, its number, and the simulator's source."""
    return hashlib.sha256(f"{settings.digest()} {sweep} {_source_hash()}".encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def _source_hash() -> str:
    digest = hashlib.sha256()
    for module in sorted(resources.files("registration.phantom").iterdir(), key=lambda item: item.name):
        if module.name.endswith(".py"):
            digest.update(module.name.encode() + module.read_bytes())
    return digest.hexdigest()


def _read(settings: PhantomSettings, sweep: int, cache: Path) -> tuple[np.ndarray, np.ndarray] | None:
    entry = cache / sweep_hash(settings, sweep)
    shape = (settings.motion.frames, settings.scanner.height_px, settings.scanner.width_px)
    try:
        images = np.load(entry / "images.npy", mmap_mode="r")
        masks = np.load(entry / "masks.npy", mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return None
    if images.shape != shape or masks.shape != shape or images.dtype != np.uint8 or masks.dtype != np.bool_:
        return None
    return np.asarray(images), np.asarray(masks)
