"""The sweeps that every network segments: of vessels that no simulated data set has, each as another session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.registration.phantom_jobs import settings_of_job
from experiments.datasets.sweep_cache import SweepRecipe, cache_folder, labelled_sweep, prepare
from experiments.errors import InputError, require_count
from registration.phantom.random_anatomy import TEST_SEEDS_FROM
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import RANDOM, PhantomSettings

if TYPE_CHECKING:
    from registration.phantom.scan import SimulatedSweep
    from registration.phantom.session_variation import SessionVariation


@dataclass(frozen=True)
class Planned:
    """One sweep before it is simulated.

    Parameters
    ----------
    phantom : str
        Name of the phantom.
    vessel : str
        Name of the vessel, the independent unit: sweeps of one vessel are not independent.
    number : int
        Number of the sweep.
    settings : PhantomSettings
        Settings of its phantom and session.
    """

    phantom: str
    vessel: str
    number: int
    settings: PhantomSettings


@dataclass(frozen=True)
class Sweeps:
    """The sweeps of a run.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Names of the phantoms. Each sweep of ``random`` is of another vessel: the one with the sweep's number.
    first_sweep : int
        Number of the first sweep, from 1000 on.
    sweeps : int
        Number of sweeps of each phantom.
    sessions : SessionVariation or None
        What differs between the sweeps besides the vessel, as between sessions; None for nothing.
    cache : str
        Folder that keeps the pictures.

    Raises
    ------
    InputError
        If there is no phantom or sweep, or sweeps are of those that simulated data sets train on.
    """

    phantom: PhantomSettings
    phantoms: Sequence[str]
    first_sweep: int
    sweeps: int
    sessions: SessionVariation | None
    cache: str

    def __post_init__(self) -> None:
        if isinstance(self.phantoms, str) or not self.phantoms:
            raise InputError(f"phantoms: expected a list of phantoms, received {self.phantoms!r}")
        if len(set(self.phantoms)) < len(self.phantoms):
            raise InputError(f"phantoms: expected each once, received {list(self.phantoms)}")
        require_count("sweeps", self.sweeps, 1)
        require_count("first_sweep", self.first_sweep, 0)
        if self.first_sweep < TEST_SEEDS_FROM:
            raise InputError(
                f"first_sweep: expected {TEST_SEEDS_FROM} or more, as simulated data sets train on those before, "
                f"received {self.first_sweep}"
            )
        for name in self.phantoms:
            settings_of_job(self.phantom, [name])

    def planned(self) -> tuple[Planned, ...]:
        """List the sweeps with their settings.

        Returns
        -------
        tuple of Planned
            Sweeps by phantom, then by number.
        """
        numbers = range(self.first_sweep, self.first_sweep + self.sweeps)
        return tuple(self._one(name, number) for name in self.phantoms for number in numbers)

    def _one(self, name: str, number: int) -> Planned:
        settings = settings_of_job(self.phantom, [name])
        vessel = name
        if name == RANDOM:
            settings, vessel = replace(settings, anatomy_seed=number), f"{name} {number}"
        if self.sessions is not None:
            settings = self.sessions(settings, number)
        return Planned(name, vessel, number, settings)

    def simulated(self, one: Planned, pictures: bool) -> SimulatedSweep:
        """Simulate one sweep, its pictures from the cache.

        Parameters
        ----------
        one : Planned
            The sweep.
        pictures : bool
            False leaves all images black, within a hundredth of the time.

        Returns
        -------
        SimulatedSweep
            The sweep and its truth.
        """
        truth = simulate_sweep(one.settings, one.number, pictures=False)
        if not pictures:
            return truth
        images, _ = labelled_sweep(SweepRecipe(one.settings, one.number), cache_folder(self.cache))
        return replace(truth, sweep=replace(truth.sweep, images=np.array(images)))

    def prepare(self, workers: int) -> None:
        """Simulate the pictures that the cache does not have, by several processes.

        Parameters
        ----------
        workers : int
            Number of processes at most.
        """
        recipes = [SweepRecipe(one.settings, one.number) for one in self.planned()]
        prepare(recipes, cache_folder(self.cache), workers)
