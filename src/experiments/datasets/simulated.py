"""Simulated substitutes for real data sets that are not there, made only when the user asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.datasets.sweep_cache import SweepRecipe, cache_folder, labelled_sweep, prepare
from registration.checks import require_count, require_positive
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.random_anatomy import TEST_SEEDS_FROM
from registration.phantom.session_variation import SessionVariation
from registration.phantom.settings import RANDOM, PhantomSettings

# A poor recording: the array hardly touches, hard spots throw shadows, noise drowns the depth.
POOR_STRENGTH = 1.5
POOR_CONTACT_LOSS_MM = 14.0
POOR_SHADOWS = 16
POOR_NOISE_DB = 10.0
# What differs between recordings: part of the settings, setting, its name for a reader, its unit.
VARIED = (
    ("scanner", "frequency_mhz", "frequency", "MHz"),
    ("scanner", "depth_mm", "imaging depth", "mm"),
    ("scanner", "gain_db", "gain", "dB"),
    ("tissue", "compensation_db_cm_mhz", "depth gain", "dB/(cm MHz)"),
    ("scanner", "dynamic_range_db", "dynamic range", "dB"),
    ("scanner", "gamma", "exponent of the grey curve", ""),
    ("scanner", "noise_db", "noise", "dB"),
    ("scanner", "looks", "compounded looks (speckle contrast)", ""),
    ("scanner", "pulse_cycles", "pulse length (axial speckle size)", "cycles"),
    ("scanner", "f_number", "f-number (lateral speckle size)", ""),
    ("tissue", "lumen_db", "echo of the lumen", "dB"),
    ("tissue", "wall_echo_db", "echo of the wall", "dB"),
    ("tissue", "mottle_db", "mottle of the tissue", "dB"),
    ("artefacts", "clutter_db", "haze", "dB"),
    ("artefacts", "contact_loss_mm", "width without contact", "mm"),
    ("artefacts", "shadows", "hard spots that cast shadows", ""),
)


@dataclass(frozen=True)
class Recorded:
    """One simulated recording.

    Parameters
    ----------
    images : ndarray of uint8, shape (n, h, w)
        Grey values.
    masks : ndarray, shape (n, h, w)
        Masks, or labels where there are two vessels.
    side_mm : float
        Side of a square pixel.
    """

    images: np.ndarray
    masks: np.ndarray
    side_mm: float

    @property
    def spacing_mm(self) -> tuple[float, float]:
        """Vertical and horizontal size of a pixel."""
        return self.side_mm, self.side_mm


@dataclass(frozen=True)
class SimulatedSubstitute:
    """Size of a simulated substitute, and how much its recordings differ.

    Parameters
    ----------
    subjects : int
        Subjects, each with a vessel drawn from the anatomies for development; at least 2.
    recordings : int
        Recordings of each subject.
    frames : int
        Frames of each recording; at least 2.
    size_px : int
        Height and width of a frame; at least 16.
    strength : float
        Scale of what differs between sessions (scanner, depth, gain, speckle, contrast); above 0, at most
        1.5.
    seed : int
        Seed of all random choices.
    workers : int
        Processes that share what is not in the cache.
    cache : str
        Folder for simulated recordings, relative to the project's.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    subjects: int = 8
    recordings: int = 2
    frames: int = 10
    size_px: int = 256
    strength: float = 1.0
    seed: int = 0
    workers: int = 1
    cache: str = ".cache/phantom"

    def __post_init__(self) -> None:
        minimum = {"subjects": 2, "recordings": 1, "frames": 2, "size_px": 16, "seed": 0, "workers": 1}
        for name, smallest in minimum.items():
            require_count(name, getattr(self, name), smallest)
        require_positive("strength", self.strength, POOR_STRENGTH)

    def recipe(
        self,
        subject: int,
        session: int,
        *,
        sweep: int = 0,
        times: int = 1,
        district: str = "",
        poor: bool = False,
    ) -> SweepRecipe:
        """Return the recipe of one recording of a subject.

        Parameters
        ----------
        subject : int
            Number of the subject, from 0.
        session : int
            Number of the session; recordings of one session share the scanner and its settings.
        sweep : int
            Number of the recording.
        times : int
            How many times the usual number of frames it has.
        district : str
            ``carotid`` or ``femoral`` puts an artery and a vein next to each other; empty: one vessel.
        poor : bool
            Whether it has little contact, many shadows and much noise.

        Returns
        -------
        SweepRecipe
            All that decides the recording.
        """
        anatomies = np.random.default_rng([self.seed, 60]).permutation(TEST_SEEDS_FROM)
        base = PhantomSettings(
            subset=RANDOM,
            seed=self.seed,
            anatomy_seed=int(anatomies[subject % TEST_SEEDS_FROM]),
            scanner=Scanner(height_px=self.size_px, width_px=self.size_px),
            motion=Motion(frames=times * self.frames),
        )
        varied = SessionVariation(shape=False, strength=POOR_STRENGTH if poor else self.strength)
        settings = varied(base, session)
        if poor:
            settings = replace(
                settings,
                scanner=replace(settings.scanner, noise_db=settings.scanner.noise_db + POOR_NOISE_DB),
                artefacts=replace(
                    settings.artefacts, contact_loss_mm=POOR_CONTACT_LOSS_MM, shadows=POOR_SHADOWS
                ),
            )
        return SweepRecipe(settings, sweep, district)

    def __call__(self, recipes: Sequence[SweepRecipe]) -> tuple[Recorded, ...]:
        """Simulate recordings, or read them from the cache.

        Parameters
        ----------
        recipes : sequence of SweepRecipe
            The recordings.

        Returns
        -------
        tuple of Recorded
            One for each recipe.
        """
        cache = cache_folder(self.cache)
        prepare(recipes, cache, self.workers)
        return tuple(
            Recorded(*labelled_sweep(recipe, cache), recipe.settings.scanner.pixel_mm) for recipe in recipes
        )

    def note(self, dataset: str) -> str:
        """Return the sentence that accompanies every result of it.

        Parameters
        ----------
        dataset : str
            The data set that it substitutes for.

        Returns
        -------
        str
            The sentence.
        """
        return (
            f"Simulated: no image of {dataset} was used, but a substitute made by the built-in simulator "
            f"(subjects: {self.subjects}, recordings: {self.recordings}, frames: {self.frames}, "
            f"strength of variation: {self.strength:g})."
        )


def variation_note(recipes: Sequence[SweepRecipe]) -> str:
    """State what differs between simulated recordings, with its range, as read from their settings.

    Parameters
    ----------
    recipes : sequence of SweepRecipe
        The recordings.

    Returns
    -------
    str
        One sentence: physical settings alone, since which recordings are put together changes no image.
    """
    settings = [recipe.settings for recipe in recipes]
    ranges = []
    for part, name, words, unit in VARIED:
        values = [float(getattr(getattr(one, part), name)) for one in settings]
        if min(values) < max(values):
            ranges.append(f"{words} {min(values):.3g} to {max(values):.3g} {unit}".strip())
    vessels = len(
        {(one.anatomy_seed, recipe.district) for one, recipe in zip(settings, recipes, strict=True)}
    )
    return (
        f"Varied between the {len(recipes)} simulated recordings: vessel shape ({vessels} anatomies), tissue, "
        f"probe path, {', '.join(ranges)}."
    )
