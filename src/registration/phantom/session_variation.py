"""Sessions that differ, as recordings of different days, patients and machines do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.checks import require_count, require_positive
from registration.phantom.acoustics import Artefacts, Scanner, Tissue
from registration.phantom.settings import RANDOM, PhantomSettings


@dataclass(frozen=True)
class SessionVariation:
    """What changes from one session to the next; each switch turns on one source of variation.

    Parameters
    ----------
    scanner : bool, optional
        Frequency, compounding, noise, dynamic range and grey curve.
    depth : bool, optional
        Imaging depth.
    gain : bool, optional
        Overall and depth gain.
    speckle : bool, optional
        Pulse length and aperture.
    contrast : bool, optional
        Lumen, haze, wall and texture.
    shape : bool, optional
        The vessel itself, drawn at random.
    strength : float, optional
        Factor on all ranges, above 0 to 1.5.

    Raises
    ------
    InputError
        If the strength is out of range.
    """

    scanner: bool = True
    depth: bool = True
    gain: bool = True
    speckle: bool = True
    contrast: bool = True
    shape: bool = True
    strength: float = 1.0

    def __post_init__(self) -> None:
        require_positive("strength", self.strength, 1.5)

    def __call__(self, settings: PhantomSettings, session: int) -> PhantomSettings:
        """Vary the settings for one session.

        Parameters
        ----------
        settings : PhantomSettings
            Settings to vary.
        session : int
            Number of the session, from 0. The same number gives the same draws, whichever sources are
            switched on.

        Returns
        -------
        PhantomSettings
            Settings of the session.

        Raises
        ------
        InputError
            If the number is negative.
        """
        require_count("session", session, 0)
        rng = np.random.default_rng([*settings.entropy, 50, session])
        # Always the same number of draws, so that switching one source leaves the others as they are.
        draws = self.strength * rng.uniform(-1.0, 1.0, 16)
        looks = int(rng.choice([1, 3, 5]))
        scanner, tissue, artefacts = settings.scanner, settings.tissue, settings.artefacts
        scanner = self._machine(scanner, draws, looks)
        tissue, artefacts = self._echoes(tissue, artefacts, draws)
        if self.shape:
            settings = replace(settings, subset=RANDOM, mesh="", anatomy_seed=int(rng.integers(0, 1000)))
        # Another session is another piece of tissue.
        seed = int(rng.integers(0, 2**31))
        return replace(settings, seed=seed, scanner=scanner, tissue=tissue, artefacts=artefacts)

    def _machine(self, scanner: Scanner, draws: Float64[np.ndarray, "16"], looks: int) -> Scanner:
        if self.scanner:
            scanner = replace(
                scanner,
                frequency_mhz=scanner.frequency_mhz * (1.0 + 0.25 * draws[0]),
                noise_db=scanner.noise_db + 5.0 * draws[1],
                dynamic_range_db=scanner.dynamic_range_db + 9.0 * draws[2],
                gamma=scanner.gamma + 0.4 * draws[3],
                looks=looks,
            )
        if self.depth:
            scanner = replace(scanner, depth_mm=scanner.depth_mm * (1.1 + 0.25 * draws[4]))
        if self.gain:
            scanner = replace(scanner, gain_db=scanner.gain_db + 7.0 * draws[5])
        if self.speckle:
            scanner = replace(
                scanner,
                pulse_cycles=scanner.pulse_cycles * (1.0 + 0.3 * draws[7]),
                f_number=scanner.f_number * (1.0 + 0.25 * draws[8]),
            )
        return scanner

    def _echoes(
        self, tissue: Tissue, artefacts: Artefacts, draws: Float64[np.ndarray, "16"]
    ) -> tuple[Tissue, Artefacts]:
        if self.gain:
            compensation = max(0.0, tissue.compensation_db_cm_mhz + 0.08 * draws[6])
            tissue = replace(tissue, compensation_db_cm_mhz=compensation)
        if self.contrast:
            tissue = replace(
                tissue,
                lumen_db=tissue.lumen_db + 8.0 * draws[9],
                wall_echo_db=tissue.wall_echo_db + 6.0 * draws[10],
                mottle_db=max(0.0, tissue.mottle_db + 2.0 * draws[11]),
            )
            artefacts = replace(artefacts, clutter_db=artefacts.clutter_db + 5.0 * draws[12])
        return tissue, artefacts
