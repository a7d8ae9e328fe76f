"""The simulated phantom as a data set: frames with exact masks, made when first asked for and kept on disk."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from experiments.datasets.sweep_cache import SweepRecipe, cache_folder, labelled_sweep, prepare
from experiments.errors import InputError, require_count
from models.labelled_frames import LabelledFrames
from registration.phantom.settings import SUBSETS, PhantomSettings

ALL = "all"


@dataclass(frozen=True)
class Phantom:
    """Labelled frames of simulated sweeps; each sweep is one group.

    Parameters
    ----------
    subset : {'artificial', 'vein', 'artery', 'all'}
        The phantom, or all three.
    sweeps : int
        Sweeps of each phantom.
    frames_per_sweep : int
        Frames of each sweep, at least 2.
    size_px : int
        Height and width of a frame, at least 16.
    seed : int
        Seed of the simulated images.
    first_sweep : int
        Number of the first sweep.
    workers : int
        Processes that share what is not in the cache.
    cache : str
        Folder for simulated sweeps, relative to the project's. Entries are named by a hash of all settings
        and of the simulator's version, so that nothing outdated is read.
    settings : PhantomSettings
        All other settings; its own subset, seed, size and number of frames are not used.

    Raises
    ------
    InputError
        If a setting is out of range.
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
        minimum = {
            "sweeps": 1,
            "frames_per_sweep": 2,
            "size_px": 16,
            "seed": 0,
            "first_sweep": 0,
            "workers": 1,
        }
        for name, smallest in minimum.items():
            require_count(name, getattr(self, name), smallest)

    def __call__(self) -> LabelledFrames:
        """Simulate what is not in the cache.

        Returns
        -------
        LabelledFrames
            All frames in order of subset, sweep and time.
        """
        sweeps = [
            SweepRecipe(self.settings_of(subset), sweep)
            for subset in (SUBSETS if self.subset == ALL else (self.subset,))
            for sweep in range(self.first_sweep, self.first_sweep + self.sweeps)
        ]
        cache = cache_folder(self.cache)
        prepare(sweeps, cache, self.workers)
        images: list[np.ndarray] = []
        masks: list[np.ndarray] = []
        cases: list[tuple[str, str, float]] = []
        for recipe in sweeps:
            sweep_images, sweep_masks = labelled_sweep(recipe, cache)
            images.extend(sweep_images)
            masks.extend(sweep_masks)
            group = f"{recipe.settings.subset}-sweep{recipe.number}"
            side_mm = recipe.settings.scanner.pixel_mm
            cases.extend((f"{group}-frame{frame:03d}", group, side_mm) for frame in range(len(sweep_images)))
        return LabelledFrames(
            images=tuple(images),
            masks=tuple(masks),
            case_ids=tuple(case for case, _, _ in cases),
            groups=tuple(group for _, group, _ in cases),
            spacing_mm=tuple((side_mm, side_mm) for _, _, side_mm in cases),
            simulated=True,
        )

    def notes(self) -> tuple[str, ...]:
        """Return what a reader of the results must know of the data.

        Returns
        -------
        tuple of str
            One sentence.
        """
        return ("Simulated by the built-in phantom simulator; each sweep is one group.",)

    def settings_of(self, subset: str) -> PhantomSettings:
        """Return the simulator's settings for one of the phantoms.

        Parameters
        ----------
        subset : {'artificial', 'vein', 'artery'}
            The phantom.

        Returns
        -------
        PhantomSettings
            Settings with the subset, seed, size and number of frames of this data set.
        """
        return dataclasses.replace(
            self.settings,
            subset=subset,
            seed=self.seed,
            scanner=dataclasses.replace(self.settings.scanner, height_px=self.size_px, width_px=self.size_px),
            motion=dataclasses.replace(self.settings.motion, frames=self.frames_per_sweep),
        )
