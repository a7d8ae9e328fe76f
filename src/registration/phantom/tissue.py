"""How strongly each place in the tissue scatters: layered tissue, fascia, vessel wall and lumen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64, UInt32

from registration.phantom.anatomy import Anatomy
from registration.phantom.hashing import smooth_noise
from registration.phantom.settings import Tissue

DEEPEST_MM = 90.0
LOOKUP_MM = 0.05
CELLS = 64


@dataclass(frozen=True)
class Scattering:
    """What each scatterer sends back.

    ``positions_mm`` (n, 3) in the tissue; ``amplitude`` (n,), 1 RMS in average tissue; ``smooth`` (n,) marks those on
    an interface, whose echoes add up in phase along it; ``attenuation`` (n,) of the tissue there, against average.
    """

    positions_mm: Float32[np.ndarray, "n 3"]
    amplitude: Float32[np.ndarray, "n"]
    smooth: Bool[np.ndarray, "n"]
    attenuation: Float32[np.ndarray, "n"]


@dataclass(frozen=True)
class TissueModel:
    """The tissue of one phantom: an anatomy, its acoustic settings and a seed."""

    anatomy: Anatomy
    settings: Tissue
    seed: int

    @cached_property
    def pitch_mm(self) -> float:
        """Side of the lattice cell that holds one scatterer."""
        return float(self.settings.scatterers_per_mm3 ** (-1.0 / 3.0))

    @cached_property
    def noise(self) -> Float32[np.ndarray, "c c c"]:
        """The random texture that modulates echogenicity."""
        return smooth_noise(self.seed, CELLS)

    @cached_property
    def _sheets_mm(self) -> Float[np.ndarray, "s"]:
        # The skin's lower border comes first; the others crowd a little towards the skin, as fat and fascia do.
        rng = np.random.default_rng([self.seed, 1])
        count = self.settings.fascia_count
        return np.concatenate([[1.6], np.sort(3.0 + 42.0 * rng.random(count) ** 1.2)])

    @cached_property
    def _nearest_sheet(self) -> Int64[np.ndarray, "d"]:
        depths_mm = np.arange(0.0, DEEPEST_MM, LOOKUP_MM)
        return np.abs(depths_mm[:, None] - self._sheets_mm[None]).argmin(axis=1)

    @cached_property
    def _layer_db(self) -> Float32[np.ndarray, "d"]:
        # Skin is bright; below it, layers between fasciae differ by a few dB.
        rng = np.random.default_rng([self.seed, 2])
        levels_db = np.concatenate([[7.0], rng.normal(0.0, 2.0, len(self._sheets_mm))])
        depths_mm = np.arange(0.0, DEEPEST_MM, LOOKUP_MM)
        return levels_db[np.searchsorted(self._sheets_mm, depths_mm)].astype(np.float32)

    def scatter(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        strength: Float32[np.ndarray, "n"],
        bits: UInt32[np.ndarray, "n"],
        beam: Float[np.ndarray, "3"],
    ) -> Scattering:
        """Echo of scatterers at given places, seen along the unit direction ``beam`` in the tissue's frame."""
        positions_mm = positions_mm.copy()
        distance_mm = self.anatomy.distance.at(positions_mm)
        level_db, smooth = self._background(positions_mm, distance_mm)
        level_db = self._vessel(level_db, positions_mm, distance_mm)
        level_db += self._intima(positions_mm, distance_mm, smooth, beam)
        amplitude = strength * np.exp(level_db * np.float32(np.log(10.0) / 20.0))
        jitter = (bits >> np.uint32(20)).astype(np.float32) / np.float32(4096)
        amplitude[smooth] = np.abs(amplitude[smooth]) * (0.5 + jitter[smooth])
        attenuation = np.where(distance_mm < 0, np.float32(0.15), np.float32(1.0))
        return Scattering(positions_mm, amplitude, smooth, attenuation)

    def _texture(self, positions_mm: Float32[np.ndarray, "n 3"], scale_mm: float) -> Float32[np.ndarray, "n"]:
        # Muscle and fat lie along the skin: texture is coarser sideways and along than in depth.
        steps = np.array([2.2, 0.8, 2.2], dtype=np.float32) * np.float32(scale_mm / 3.0)
        index = (positions_mm / steps).astype(np.int32) & (CELLS - 1)
        return self.noise.reshape(-1)[(index[:, 0] * CELLS + index[:, 1]) * CELLS + index[:, 2]]

    def _background(
        self, positions_mm: Float32[np.ndarray, "n 3"], distance_mm: Float32[np.ndarray, "n"]
    ) -> tuple[Float32[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
        settings = self.settings
        level_db = settings.texture_db * self._texture(positions_mm, settings.texture_mm)
        if settings.fascia_count == 0:
            return level_db, np.zeros(len(positions_mm), dtype=bool)
        depth_mm = self._warped_depth(positions_mm)
        entry = np.clip(depth_mm / LOOKUP_MM, 0, len(self._layer_db) - 1).astype(np.int32)
        level_db += self._layer_db[entry]
        sheet = self._nearest_sheet[entry]
        offset_mm = (depth_mm - self._sheets_mm.astype(np.float32)[sheet]).astype(np.float32)
        smooth = (np.abs(offset_mm) < 0.5 * self.pitch_mm) & (distance_mm > 1.0)
        chosen = np.flatnonzero(smooth)
        # Each sheet comes and goes: its strength follows its own cut through the texture.
        shifted = positions_mm[chosen] + np.array([7.3, 11.9, 3.1], dtype=np.float32) * sheet[chosen, None]
        shifted[:, 1] = 13.7 * sheet[chosen]
        presence = self._texture(shifted.astype(np.float32), 6.0)
        level_db[chosen] = settings.fascia_db * np.clip(presence, -2.0, 1.2) - 4.0
        positions_mm[chosen, 1] -= offset_mm[chosen]
        return level_db, smooth

    def _warped_depth(self, positions_mm: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n"]:
        """Depth below the skin along layers that undulate more the deeper they lie."""
        x, y, z = positions_mm.T
        phase = np.random.default_rng([self.seed, 3]).uniform(0.0, 2 * np.pi, 4).astype(np.float32)
        depth_mm = y - np.float32(self.anatomy.skin_y_mm)
        wave = 0.9 * np.sin(x / 7.0 + z / 19.0 + phase[0]) + 0.6 * np.sin(x / 3.7 - z / 11.0 + phase[1])
        slow = 2.2 * np.sin(x / 13.0 + z / 31.0 + phase[2]) + 1.4 * np.sin(z / 17.0 - x / 29.0 + phase[3])
        share = np.clip(depth_mm / 25.0, 0.0, 1.0)
        return np.asarray(depth_mm + share * (wave + share * slow), dtype=np.float32)

    def _vessel(
        self,
        level_db: Float32[np.ndarray, "n"],
        positions_mm: Float32[np.ndarray, "n 3"],
        distance_mm: Float32[np.ndarray, "n"],
    ) -> Float32[np.ndarray, "n"]:
        """Replace the level in the lumen, the dark media and the bright adventitia around it."""
        del positions_mm
        wall_mm = self.settings.wall_mm
        level_db[distance_mm < 0] = self.settings.lumen_db
        level_db[(distance_mm >= 0) & (distance_mm < wall_mm)] = -10.0
        outside = (distance_mm >= wall_mm) & (distance_mm < wall_mm + 0.9)
        level_db[outside] = 0.5 * self.settings.wall_echo_db - 1.0
        return level_db

    def _intima(
        self,
        positions_mm: Float32[np.ndarray, "n 3"],
        distance_mm: Float32[np.ndarray, "n"],
        smooth: Bool[np.ndarray, "n"],
        beam: Float[np.ndarray, "3"],
    ) -> Float32[np.ndarray, "n"]:
        """Move scatterers next to the lumen's border onto it; their echo falls with the angle of incidence.

        The fall ``|cos|**exponent`` stands for the interface's limited roughness: a mirror would vanish within a few
        degrees, a rough wall not at all.
        """
        added_db = np.zeros(len(positions_mm), dtype=np.float32)
        on_wall = np.flatnonzero(np.abs(distance_mm) < 0.5 * self.pitch_mm)
        if not len(on_wall):
            return added_db
        normals = self.anatomy.distance.normals(positions_mm[on_wall])
        positions_mm[on_wall] -= normals * distance_mm[on_wall, None]
        cosine = np.maximum(np.abs(normals @ np.asarray(beam, dtype=np.float32)), 0.05)
        smooth[on_wall] = True
        base_db = np.where(distance_mm[on_wall] < 0, -self.settings.lumen_db, 10.0)
        added_db[on_wall] = (
            base_db + self.settings.wall_echo_db + 20.0 * self.settings.wall_exponent * np.log10(cosine)
        )
        return added_db
