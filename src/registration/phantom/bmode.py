"""From scatterers to a B-mode picture: echoes summed by amplitude and phase, blurred, detected and compressed.

The model is the usual linear one: the received signal is the tissue's scattering convolved with a point-spread
function that changes with depth (Bamber and Dickinson, Phys. Med. Biol. 25, 1980). It works on the complex envelope:
each scatterer brings its carrier's phase, so that the envelope of many has Rayleigh statistics (Wagner et al., IEEE
Trans. Sonics Ultrason. 30, 1983) and decorrelates with motion as real speckle does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex64, Float, Float32, Float64, UInt8
from scipy import fft
from scipy.ndimage import gaussian_filter1d, zoom

from registration.phantom.beams import FWHM_PER_SIGMA, Beams
from registration.phantom.scatterers import Slab, cells_in, place
from registration.phantom.settings import Scanner
from registration.phantom.tissue import Scattering, TissueModel

# Grey level of average tissue, below white, in dB; scanners leave room for interfaces.
HEADROOM_DB = 26.0
# Attenuation is summed on a coarser grid: (samples, beams) a cell.
COARSE = (8, 6)


@dataclass(frozen=True)
class BMode:
    """A scanner that looks at a tissue; call it with the true pose of the image plane."""

    scanner: Scanner
    tissue: TissueModel

    @cached_property
    def beams(self) -> Beams:
        """The probe's grid of beams."""
        return Beams(self.scanner)

    def __call__(
        self, tissue_T_image: Float64[np.ndarray, "4 4"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w"]:
        """Make one frame, its receiver noise drawn from ``rng``.

        ``tissue_T_image`` is rigid and maps (lateral, depth, elevation) in mm to the tissue.
        """
        signal, transmission_db = self.signal(tissue_T_image)
        noise = (
            rng.standard_normal(signal.shape, dtype=np.float32)
            + 1j * rng.standard_normal(signal.shape, dtype=np.float32)
        ).astype(np.complex64)
        level_db = 20.0 * np.log10(np.abs(self._receive(signal, transmission_db, noise)) + 1e-6)
        picture_db = self.beams.to_picture(level_db.astype(np.float32)) + self.scanner.gain_db
        grey = 255.0 * (1.0 + (picture_db - HEADROOM_DB) / self.scanner.dynamic_range_db)
        return np.where(self.beams.seen, np.clip(np.rint(grey), 0, 255), 0).astype(np.uint8)

    def signal(
        self, tissue_T_image: Float64[np.ndarray, "4 4"]
    ) -> tuple[Complex64[np.ndarray, "s b"], Float32[np.ndarray, "s b"]]:
        """The blurred echoes, 1 RMS in average tissue, and the two-way loss in dB on the way to each sample."""
        slab = self._slab(tissue_T_image)
        positions_mm, strength, bits = place(
            cells_in(slab, self.tissue.pitch_mm), self.tissue.pitch_mm, self.tissue.seed
        )
        rotation = tissue_T_image[:3, :3].astype(np.float32)
        origin_mm = tissue_T_image[:3, 3].astype(np.float32)
        local_mm = (positions_mm - origin_mm) @ rotation
        inside = ((local_mm > slab.low_mm) & (local_mm < slab.high_mm)).all(axis=1)
        echoes = self.tissue.scatter(positions_mm[inside], strength[inside], bits[inside], rotation[:, 1])
        local_mm = (echoes.positions_mm - origin_mm) @ rotation
        deposited, loss_db = self._deposit(echoes, local_mm)
        return self._blur(deposited), loss_db

    def _slab(self, tissue_T_image: Float64[np.ndarray, "4 4"]) -> Slab:
        margin_mm, scanner = self.beams.margin_mm, self.scanner
        half_mm = 2.0 * float(self._elevation_sigma_mm(np.array([0.0, scanner.depth_mm])).max())
        width_mm = self.beams.half_width_mm + margin_mm
        low_mm = np.array([-width_mm, -margin_mm, -half_mm])
        return Slab(tissue_T_image, low_mm, np.array([width_mm, scanner.depth_mm + margin_mm, half_mm]))

    def _elevation_sigma_mm(self, depth_mm: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Deviation of the slice's profile; it grows hyperbolically on both sides of the lens's focus."""
        scanner = self.scanner
        away = (depth_mm - scanner.elevation_focus_mm) / scanner.elevation_focus_mm
        return scanner.elevation_mm / FWHM_PER_SIGMA * np.sqrt(1.0 + away * away)

    def _deposit(
        self, echoes: Scattering, local_mm: Float32[np.ndarray, "n 3"]
    ) -> tuple[Complex64[np.ndarray, "s b"], Float32[np.ndarray, "s b"]]:
        samples, lines = self.beams.shape
        depth_mm = local_mm[:, 1]
        row, column = self.beams.to_grid(local_mm[:, 0], depth_mm)
        row, column = np.rint(row).astype(np.int64), np.rint(column).astype(np.int64)
        sigma_mm = self._elevation_sigma_mm(depth_mm)
        weight = np.exp(-0.5 * (local_mm[:, 2] / sigma_mm) ** 2) / np.sqrt(np.sqrt(np.pi) * sigma_mm)
        kept = (row >= 0) & (row < samples) & (column >= 0) & (column < lines)
        cell = (row * lines + column)[kept]
        phase = np.where(echoes.smooth, 0.0, 4.0 * np.pi / self.scanner.wavelength_mm * depth_mm)[kept]
        value = (echoes.amplitude * weight)[kept]
        size = samples * lines
        real = np.bincount(cell, value * np.cos(phase), minlength=size)
        imaginary = np.bincount(cell, value * np.sin(phase), minlength=size)
        density = self.tissue.settings.scatterers_per_mm3 * self.beams.sample_mm * self.beams.beam_mm
        echo = ((real + 1j * imaginary) / np.sqrt(density)).reshape(samples, lines).astype(np.complex64)
        return echo, self._loss_db(row[kept], column[kept], echoes.attenuation[kept])

    def _loss_db(
        self, row: np.ndarray, column: np.ndarray, attenuation: Float32[np.ndarray, "n"]
    ) -> Float32[np.ndarray, "s b"]:
        """Two-way loss of attenuation summed along each beam, less what the depth gain compensates."""
        samples, lines = self.beams.shape
        rows, columns = -(-samples // COARSE[0]), -(-lines // COARSE[1])
        cell = (row // COARSE[0]) * columns + column // COARSE[1]
        counts = np.bincount(cell, minlength=rows * columns).reshape(rows, columns)
        total = np.bincount(cell, attenuation, minlength=rows * columns).reshape(rows, columns)
        relative = np.where(counts > 0, total / np.maximum(counts, 1), 1.0)
        settings, step_cm = self.tissue.settings, COARSE[0] * self.beams.sample_mm / 10.0
        rate = 2.0 * self.scanner.frequency_mhz * step_cm
        excess_db = rate * (settings.attenuation_db_cm_mhz * relative - settings.compensation_db_cm_mhz)
        summed = gaussian_filter1d(np.cumsum(excess_db, axis=0), 1.0, axis=1)
        fine = zoom(summed, COARSE, order=1, mode="nearest", grid_mode=True)
        return np.asarray(fine[:samples, :lines], dtype=np.float32)

    def _blur(self, echo: Complex64[np.ndarray, "s b"]) -> Complex64[np.ndarray, "s b"]:
        """Convolve with the pulse along depth and with a beam whose width depends on depth; energy stays 1."""
        samples, lines = echo.shape
        pulse = self._gaussian(np.array([self.beams.axial_sigma_mm / self.beams.sample_mm]), samples)
        along = fft.ifft(fft.fft(echo, axis=0) * pulse.T, axis=0)
        away = (self.beams.sample_depth_mm - self.scanner.focus_mm) / self.scanner.focus_mm
        width = self.beams.lateral_sigma_mm * np.sqrt(1.0 + (0.8 * away) ** 2) / self.beams.beam_mm
        side_lobes = 10.0 ** (self.scanner.clutter_db / 20.0)
        beam = self._gaussian(width, lines) + side_lobes * self._gaussian(8.0 * width, lines)
        return np.asarray(fft.ifft(fft.fft(along, axis=1) * beam, axis=1), dtype=np.complex64)

    @staticmethod
    def _gaussian(sigma: Float[np.ndarray, "n"], length: int) -> Float32[np.ndarray, "n length"]:
        """Transfer function of Gaussians of unit energy, one a row."""
        frequency = fft.fftfreq(length)
        scale = np.sqrt(2.0 * np.sqrt(np.pi) * sigma)[:, None]
        return (scale * np.exp(-2.0 * (np.pi * frequency * sigma[:, None]) ** 2)).astype(np.float32)

    def _receive(
        self,
        signal: Complex64[np.ndarray, "s b"],
        loss_db: Float32[np.ndarray, "s b"],
        noise: Complex64[np.ndarray, "s b"],
    ) -> Complex64[np.ndarray, "s b"]:
        """Apply the loss and add the receiver's noise, which the depth gain raises towards the bottom."""
        rate = 2.0 * self.scanner.frequency_mhz * self.tissue.settings.compensation_db_cm_mhz / 10.0
        noise_db = self.scanner.noise_db + rate * (self.beams.sample_depth_mm - self.scanner.depth_mm)
        level = (10.0 ** (noise_db / 20.0) / np.sqrt(2.0)).astype(np.float32)[:, None]
        return signal * (10.0 ** (-loss_db / 20.0)).astype(np.float32) + level * noise
