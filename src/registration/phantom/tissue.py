"""How strongly each place in the tissue scatters: layers, fascia and streaks, hard spots, vessel wall and lumen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt32

from registration.phantom.acoustics import Artefacts, Tissue
from registration.phantom.anatomy import Anatomy
from registration.phantom.layers import Layers, dither

LN_PER_DB = np.float32(np.log(10.0) / 20.0)
GEL_DB = -60.0
# Against the tissue around: walls are seldom darker or brighter all the way round.
MEDIA_DB = -8.0
ADVENTITIA_DB = 3.5
ADVENTITIA_MM = 0.9
# Blood attenuates 0.15 dB/cm/MHz against 0.5 of average tissue.
BLOOD_ATTENUATION = np.float32(0.3)
HARD_DB = 16.0
# Bone takes 15 dB/cm at 1 MHz, and a hard spot sends most of the rest back: some 20 dB are lost behind a small one.
HARD_ATTENUATION = np.float32(60.0)


@dataclass(frozen=True)
class Scattering:
    """Echo of each scatterer.

    Parameters
    ----------
    positions_mm : ndarray of float32, shape (n, 3)
        Positions in the tissue in mm.
    amplitude : ndarray of float32, shape (n,)
        Amplitude, 1 RMS in average tissue.
    smooth : ndarray of bool, shape (n,)
        Scatterers moved onto an interface, whose echoes add up in phase along it.
    attenuation : ndarray of float32, shape (n,)
        Attenuation of the tissue there, relative to average tissue.
    """

    positions_mm: Float32[np.ndarray, "n 3"]
    amplitude: Float32[np.ndarray, " n"]
    smooth: Bool[np.ndarray, " n"]
    attenuation: Float32[np.ndarray, " n"]


@dataclass(frozen=True)
class TissueModel:
    """Tissue of one phantom.

    Parameters
    ----------
    anatomy : Anatomy
        Vessel and skin.
    settings : Tissue
        Acoustic properties.
    artefacts : Artefacts
        Artefacts.
    seed : int
        Seed of the tissue.
    """

    anatomy: Anatomy
    settings: Tissue
    artefacts: Artefacts
    seed: int

    @cached_property
    def pitch_mm(self) -> float:
        """Side in mm of the lattice cell that holds one scatterer."""
        return float(self.settings.scatterers_per_mm3 ** (-1.0 / 3.0))

    @cached_property
    def layers(self) -> Layers:
        """Tissue around the vessel."""
        return Layers(self.settings, self.anatomy.skin_y_mm, self.pitch_mm, self.seed)

    @cached_property
    def hard_spots_mm(self) -> Float64[np.ndarray, "k 3"]:
        """Centres of calcified or gas-filled spots in mm, next to and in front of the vessel, never in it."""
        rng = np.random.default_rng([self.seed, 4])
        guide_mm, count = self.anatomy.guide_mm, self.artefacts.shadows
        spots_mm: list[Float64[np.ndarray, "3"]] = []
        while len(spots_mm) < count:
            base_mm = guide_mm[rng.integers(len(guide_mm))]
            spot_mm = base_mm + np.array(
                [rng.normal(0.0, 8.0), rng.uniform(-9.0, 6.0), rng.uniform(-1.0, 1.0)]
            )
            clear_mm = self.anatomy.distance.at(spot_mm[None])[0]
            if clear_mm > 0.5 * self.artefacts.shadow_mm and spot_mm[1] > self.anatomy.skin_y_mm + 3.0:
                spots_mm.append(spot_mm)
        return np.array(spots_mm).reshape(-1, 3)

    def scatter(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        strength: Float32[np.ndarray, " n"],
        bits: UInt32[np.ndarray, " n"],
        beam: Float[np.ndarray, "n 3"],
    ) -> Scattering:
        """Compute the echo of scatterers.

        Parameters
        ----------
        positions_mm : ndarray of float32, shape (n, 3)
            Positions in the tissue in mm.
        strength : ndarray of float32, shape (n,)
            Strength of each scatterer.
        bits : ndarray of uint32, shape (n,)
            Random bits of each scatterer.
        beam : ndarray, shape (n, 3)
            Unit direction of the beam at each scatterer, in the tissue's frame.

        Returns
        -------
        Scattering
            The echoes, with scatterers at interfaces moved onto them.
        """
        positions_mm = positions_mm.copy()
        distance_mm = self.anatomy.distance.at(positions_mm)
        level_db, smooth = self.layers.level_db(positions_mm, bits, distance_mm > 1.0)
        attenuation = np.where(distance_mm < 0, BLOOD_ATTENUATION, np.float32(1.0))
        self._harden(level_db, attenuation, smooth, positions_mm, distance_mm)
        self._line_vessel(level_db, smooth, distance_mm)
        self._line_intima((level_db, smooth, attenuation), positions_mm, distance_mm, beam)
        level_db[positions_mm[:, 1] < self.anatomy.skin_y_mm] = GEL_DB
        amplitude = strength * np.exp(level_db * LN_PER_DB)
        amplitude[smooth] = np.abs(amplitude[smooth]) * (np.float32(0.5) + dither(bits[smooth], 2))
        return Scattering(positions_mm, amplitude, smooth, attenuation)

    def _harden(
        self,
        level_db: Float32[np.ndarray, " n"],
        attenuation: Float32[np.ndarray, " n"],
        smooth: Bool[np.ndarray, " n"],
        positions_mm: Float32[np.ndarray, "n 3"],
        distance_mm: Float32[np.ndarray, " n"],
    ) -> None:
        radius_mm = 0.5 * self.artefacts.shadow_mm
        for spot_mm in self.hard_spots_mm.astype(np.float32):
            # Most spots lie outside the slice: one coordinate tells.
            near = np.flatnonzero(np.abs(positions_mm[:, 2] - spot_mm[2]) < radius_mm)
            # Flat, as plaques are.
            offset_mm = (positions_mm[near] - spot_mm) * np.array([1.0, 1.8, 1.0], dtype=np.float32)
            hard = near[((offset_mm * offset_mm).sum(axis=1) < radius_mm**2) & (distance_mm[near] > 0)]
            level_db[hard], attenuation[hard], smooth[hard] = HARD_DB, HARD_ATTENUATION, False

    def _line_vessel(
        self,
        level_db: Float32[np.ndarray, " n"],
        smooth: Bool[np.ndarray, " n"],
        distance_mm: Float32[np.ndarray, " n"],
    ) -> None:
        """The lumen, the dark media and the bright adventitia around it."""
        wall_mm = self.settings.wall_mm
        level_db[distance_mm < 0] = self.settings.lumen_db
        level_db[(distance_mm >= 0) & (distance_mm < wall_mm)] += MEDIA_DB
        outer = (distance_mm >= wall_mm) & (distance_mm < wall_mm + ADVENTITIA_MM)
        level_db[outer] += ADVENTITIA_DB
        smooth[distance_mm < wall_mm + ADVENTITIA_MM] = False

    def _line_intima(
        self,
        echoes: tuple[Float32[np.ndarray, " n"], Bool[np.ndarray, " n"], Float32[np.ndarray, " n"]],
        positions_mm: Float32[np.ndarray, "n 3"],
        distance_mm: Float32[np.ndarray, " n"],
        beam: Float[np.ndarray, "n 3"],
    ) -> None:
        """Move scatterers next to the lumen's border onto it; their echo falls with the angle of incidence.

        The fall ``|cos|**exponent`` stands for the interface's limited roughness: a mirror would vanish within a few
        degrees, a rough wall not at all. Where the beam grazes the wall, refraction takes energy away.
        """
        level_db, smooth, attenuation = echoes
        on_wall: Int64[np.ndarray, " m"] = np.flatnonzero(np.abs(distance_mm) < 0.5 * self.pitch_mm)
        if not len(on_wall):
            return
        normals = self.anatomy.distance.normals(positions_mm[on_wall])
        positions_mm[on_wall] -= normals * distance_mm[on_wall, None]
        cosine = np.abs(np.einsum("ni,ni->n", normals, beam[on_wall])).astype(np.float32)
        smooth[on_wall] = True
        fall_db = 20.0 * self.settings.wall_exponent * np.log10(np.maximum(cosine, 0.05))
        level_db[on_wall] = self.settings.wall_echo_db + fall_db
        attenuation[on_wall[cosine < 0.3]] *= np.float32(self.artefacts.edge_shadow)
