"""The tissue around the vessel: skin, fat and muscle in layers, fascia between them, short streaks within."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64, UInt32

from registration.phantom.acoustics import Tissue
from registration.phantom.lattice_noise import smooth_noise

DEEPEST_MM = 130.0
LOOKUP_MM = 0.05
CELLS = 64
# Sheets crowd towards the skin, where fat lies in thin layers.
FASCIA_DEPTH_MM = (3.5, 34.0)
SKIN_MM = 1.5
SKIN_DB = 5.0


def dither(bits: UInt32[np.ndarray, " n"], place: int) -> Float32[np.ndarray, " n"]:
    """Make a number from 0 to 1 of ten of a scatterer's random bits.

    Parameters
    ----------
    bits : ndarray of uint32, shape (n,)
        Random bits of each scatterer.
    place : {0, 1, 2}
        Which ten bits are used.

    Returns
    -------
    ndarray of float32, shape (n,)
        Numbers from 0 (included) to 1 (excluded).
    """
    return ((bits >> np.uint32(10 * place)) & np.uint32(1023)).astype(np.float32) / np.float32(1024.0)


@dataclass(frozen=True)
class Layers:
    """Echogenicity outside the vessel, fixed in the tissue by a seed.

    Parameters
    ----------
    settings : Tissue
        Acoustic properties.
    skin_y_mm : float
        Height y of the skin plane in mm, in the bed frame.
    pitch_mm : float
        Side of the lattice cell that holds one scatterer, in mm.
    seed : int
        Seed of the tissue.
    """

    settings: Tissue
    skin_y_mm: float
    pitch_mm: float
    seed: int

    def level_db(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        bits: UInt32[np.ndarray, " n"],
        free: Bool[np.ndarray, " n"],
    ) -> tuple[Float32[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Compute the level of each scatterer, and whether it lies on a sheet.

        Parameters
        ----------
        positions_mm : ndarray of float32, shape (n, 3)
            Scatterers in the bed frame in mm; those on a sheet are moved onto it in place.
        bits : ndarray of uint32, shape (n,)
            Random bits of each scatterer.
        free : ndarray of bool, shape (n,)
            Scatterers that may be moved onto a sheet; the others are too near the vessel.

        Returns
        -------
        level_db : ndarray of float32, shape (n,)
            Level in dB against average tissue.
        smooth : ndarray of bool, shape (n,)
            Whether the scatterer lies on a sheet.
        """
        settings = self.settings
        level_db = np.float32(settings.texture_db) * self._texture(positions_mm, bits, (1.4, 0.7, 1.4))
        level_db += np.float32(settings.mottle_db) * self._texture(positions_mm, bits, (4.0, 2.2, 5.0), 17)
        depth_mm = self._warped_depth_mm(positions_mm)
        entry = np.clip(depth_mm / LOOKUP_MM, 0, len(self._layer_db) - 1).astype(np.int32)
        level_db += self._layer_db[entry]
        sheet = self._nearest_sheet[entry]
        offset_mm = (depth_mm - self._sheets_mm.astype(np.float32)[sheet]).astype(np.float32)
        smooth = (np.abs(offset_mm) < 0.5 * self.pitch_mm) & free
        chosen = np.flatnonzero(smooth)
        echo_db = self._sheet_db(positions_mm[chosen], bits[chosen], sheet[chosen])
        present = echo_db > level_db[chosen]
        smooth[chosen[~present]] = False
        level_db[chosen[present]] = echo_db[present]
        positions_mm[chosen[present], 1] -= offset_mm[chosen[present]]
        return level_db, smooth

    @cached_property
    def _noise(self) -> Float32[np.ndarray, "c c c"]:
        return smooth_noise(self.seed, CELLS)

    @cached_property
    def _fascia(self) -> int:
        return self.settings.fascia_count

    @cached_property
    def _sheets_mm(self) -> Float[np.ndarray, " s"]:
        """Depths of the fasciae first, then of the layers that streaks lie in."""
        rng = np.random.default_rng([self.seed, 1])
        low, high = FASCIA_DEPTH_MM
        fascia_mm = low + (high - low) * np.sort(rng.random(self._fascia) ** 1.4)
        count = round(self.settings.streaks_per_mm * DEEPEST_MM)
        streaks_mm = SKIN_MM + (DEEPEST_MM - SKIN_MM) * (np.arange(count) + rng.random(count)) / max(count, 1)
        return np.concatenate([[SKIN_MM * 0.2], fascia_mm, streaks_mm])

    @cached_property
    def _nearest_sheet(self) -> Int64[np.ndarray, " d"]:
        depths_mm = np.arange(0.0, DEEPEST_MM, LOOKUP_MM)
        return np.abs(depths_mm[:, None] - self._sheets_mm[None]).argmin(axis=1)

    @cached_property
    def _layer_db(self) -> Float32[np.ndarray, " d"]:
        """Skin is bright; the layers between fasciae differ."""
        rng = np.random.default_rng([self.seed, 2])
        spread_db = self.settings.mottle_db if self._fascia else 0.0
        levels_db = np.concatenate([[0.0], spread_db * rng.uniform(-1.0, 1.0, self._fascia)])
        depths_mm = np.arange(0.0, DEEPEST_MM, LOOKUP_MM)
        level_db = levels_db[np.searchsorted(self._sheets_mm[1 : 1 + self._fascia], depths_mm)]
        if self._fascia:
            level_db[depths_mm < SKIN_MM] += SKIN_DB
        return level_db.astype(np.float32)

    def _texture(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        bits: UInt32[np.ndarray, " n"],
        cell_mm: tuple[float, float, float],
        shift: int = 0,
    ) -> Float32[np.ndarray, " n"]:
        """Noise of unit deviation, correlated over about three cells, each axis with its own size of cell.

        The cell is drawn among the two nearest by the scatterer's own bits, which interpolates at no cost.
        """
        index = np.empty((len(positions_mm), 3), dtype=np.int32)
        for axis in range(3):
            steps = positions_mm[:, axis] / np.float32(cell_mm[axis]) + dither(bits, axis)
            index[:, axis] = np.floor(steps).astype(np.int32) + shift
        index &= CELLS - 1
        return self._noise.reshape(-1)[(index[:, 0] * CELLS + index[:, 1]) * CELLS + index[:, 2]]

    def _sheet_db(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        bits: UInt32[np.ndarray, " n"],
        sheet: Int64[np.ndarray, " n"],
    ) -> Float32[np.ndarray, " n"]:
        """Echo of each sheet where it is present: fasciae nearly everywhere, streaks in patches some mm long."""
        settings = self.settings
        lifted = positions_mm.copy()
        # Each sheet reads a section of the noise of its own.
        lifted[:, 1] = np.float32(9.7) * sheet
        wide = self._texture(lifted, bits, (2.4, 1.0, 2.4))
        short = self._texture(lifted, bits, (0.6, 1.0, 0.9), 29)
        fascia_db = np.float32(settings.fascia_db) + 5.0 * np.minimum(wide, 0.8)
        presence = 0.5 * wide + short
        streak_db = settings.streak_db + 5.0 * (np.clip(presence, 0.0, 2.2) - 1.6)
        streak_db = np.where(presence > 1.2, streak_db, -200.0)
        is_fascia = (sheet > 0) & (sheet <= self._fascia)
        echo_db = np.where(is_fascia, fascia_db, streak_db)
        return np.where(sheet == 0, fascia_db if self._fascia else -200.0, echo_db).astype(np.float32)

    def _warped_depth_mm(self, positions_mm: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Depth below the skin along layers that undulate more the deeper they lie."""
        x, y, z = positions_mm.T
        phase = np.random.default_rng([self.seed, 3]).uniform(0.0, 2 * np.pi, 6).astype(np.float32)
        depth_mm = y - np.float32(self.skin_y_mm)
        near = np.clip(depth_mm / np.float32(8.0), 0.0, 1.0)
        deep = np.clip(depth_mm / np.float32(30.0), 0.0, 1.0)
        wave = 0.35 * np.sin(x / 2.9 + z / 7.0 + phase[0]) + 0.7 * np.sin(x / 6.3 - z / 13.0 + phase[1])
        slope = 2.4 * np.sin(x / 11.0 + z / 23.0 + phase[2]) + 1.6 * np.sin(z / 17.0 - x / 19.0 + phase[3])
        slope += 0.8 * np.sin(x / 4.1 + depth_mm / 4.0 + phase[4])
        return np.asarray(depth_mm + near * wave + deep * slope, dtype=np.float32)
