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
from jaxtyping import Bool, Complex64, Float, Float32, Int64, UInt8
from scipy import fft

from registration.phantom.acoustics import Scanner
from registration.phantom.beams import FWHM_PER_SIGMA, Beams
from registration.phantom.deformation import View
from registration.phantom.scatterers import cells_in, place
from registration.phantom.tissue import Scattering, TissueModel
from registration.phantom.transmission import along_beams_db, ring_down

# Where on the grey scale, before gamma, average tissue lies: scanners leave room for interfaces.
TISSUE_LEVEL = 0.38
HIDDEN_DB = 12.0
# Stray paths blur across this many times the beam: haze fills a vessel to its middle.
STRAY_WIDTH = 15.0
# Distance between looks in deviations of the beam's own spectrum: their speckle correlates by about a quarter.
LOOK_STEP = 1.6


@dataclass(frozen=True)
class Echo:
    """Received signal of one frame before losses and noise.

    Parameters
    ----------
    signal : ndarray of complex64, shape (k, s, b)
        Blurred complex envelope of each look, 1 RMS in average tissue; axes are look, sample, beam.
    loss_db : ndarray of float32, shape (s, b)
        Two-way loss in dB at each sample of each beam.
    """

    signal: Complex64[np.ndarray, "k s b"]
    loss_db: Float32[np.ndarray, "s b"]


@dataclass(frozen=True)
class BMode:
    """Simulator of B-mode images: a scanner that images a tissue.

    Parameters
    ----------
    scanner : Scanner
        Probe and scanner.
    tissue : TissueModel
        Tissue of the phantom.
    """

    scanner: Scanner
    tissue: TissueModel

    @cached_property
    def beams(self) -> Beams:
        """Grid of beams of the probe."""
        return Beams(self.scanner, self.tissue.settings.sound_speed_m_s)

    def __call__(
        self, view: View, contact_db: Float32[np.ndarray, " b"], rng: np.random.Generator
    ) -> tuple[UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Make one frame and the mask of its hidden pixels.

        Parameters
        ----------
        view : View
            Pose and deformation of the frame.
        contact_db : ndarray of float32, shape (b,)
            Loss of each beam at the skin in dB.
        rng : numpy.random.Generator
            Random stream of the receiver's noise.

        Returns
        -------
        image : ndarray of uint8, shape (h, w)
            Grey levels.
        hidden : ndarray of bool, shape (h, w)
            Pixels that an acoustic shadow or missing contact hides.
        """
        echo = self.echo(view)
        power = np.mean(np.abs(self._receive(echo, contact_db, rng)) ** 2, axis=0)
        level_db = self.beams.to_picture(10.0 * np.log10(power + 1e-12)) + self.scanner.gain_db
        grey = (
            np.clip(TISSUE_LEVEL + level_db / self.scanner.dynamic_range_db, 0.0, 1.0) ** self.scanner.gamma
        )
        picture = np.where(self.beams.seen, np.rint(255.0 * grey), 0).astype(np.uint8)
        return picture, self._hidden(echo.loss_db + contact_db)

    def echo(self, view: View) -> Echo:
        """Simulate the received signal before losses and noise.

        Parameters
        ----------
        view : View
            Pose and deformation of the frame.

        Returns
        -------
        Echo
            Blurred envelope of each look, and the loss along the beams.
        """
        margin_mm, scanner = self.beams.margin_mm, self.scanner
        deepest_mm = (scanner.depth_mm + margin_mm) / self.beams.stretch
        reach_mm = self._reach_mm(deepest_mm)
        half_mm = 2.0 * float(self._elevation_sigma_mm(np.array([0.0, scanner.depth_mm])).max())
        low_mm = np.array([-reach_mm, -margin_mm - scanner.sag_mm, -half_mm])
        high_mm = np.array([reach_mm, deepest_mm, half_mm])
        slab = view.slab(low_mm, high_mm)
        pitch_mm = self.tissue.pitch_mm
        positions_mm, strength, bits = place(cells_in(slab, pitch_mm), pitch_mm, self.tissue.seed)
        local_mm = view.to_image(positions_mm)
        # Axis by axis: a comparison of rows of three and their conjunction take several times as long.
        inside = np.ones(len(local_mm), dtype=bool)
        for axis in range(3):
            inside &= local_mm[:, axis] > np.float32(low_mm[axis])
            inside &= local_mm[:, axis] < np.float32(high_mm[axis])
        kept = np.flatnonzero(inside)
        local_mm = local_mm.take(kept, axis=0)
        beam = self.beams.directions(local_mm) @ view.tissue_T_image[:3, :3].T.astype(np.float32)
        echoes = self.tissue.scatter(positions_mm.take(kept, axis=0), strength[kept], bits[kept], beam)
        local_mm[echoes.smooth] = view.to_image(echoes.positions_mm[echoes.smooth])
        return self._echo(echoes, local_mm)

    def _reach_mm(self, deepest_mm: float) -> float:
        """Half the width of the tissue that is looked at."""
        half_mm = self.beams.half_arc_mm + self.beams.margin_mm
        if self.scanner.geometry == "linear":
            return half_mm
        radius_mm = self.scanner.radius_mm
        return float((radius_mm + deepest_mm) * np.sin(min(half_mm / radius_mm, 0.5 * np.pi)))

    def _elevation_sigma_mm(self, depth_mm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Deviation of the slice's profile; it grows hyperbolically on both sides of the lens's focus."""
        scanner = self.scanner
        away = (depth_mm - scanner.elevation_focus_mm) / scanner.elevation_focus_mm
        sigma_mm = scanner.elevation_mm / FWHM_PER_SIGMA * np.sqrt(1.0 + away * away)
        return np.asarray(sigma_mm, dtype=depth_mm.dtype)

    def _echo(self, echoes: Scattering, local_mm: Float32[np.ndarray, "n 3"]) -> Echo:
        beams, (samples, lines) = self.beams, self.beams.shape
        arc_mm, range_mm = beams.to_beam(local_mm[:, 0], local_mm[:, 1])
        row, column = beams.to_grid(arc_mm, range_mm * np.float32(beams.stretch))
        rows: Int64[np.ndarray, " n"] = np.rint(row).astype(np.int64)
        columns: Int64[np.ndarray, " n"] = np.rint(column).astype(np.int64)
        kept = (rows >= 0) & (rows < samples) & (columns >= 0) & (columns < lines)
        rows, columns, range_mm = rows[kept], columns[kept], range_mm[kept]
        sigma_mm = self._elevation_sigma_mm(range_mm)
        profile = np.exp(-0.5 * (local_mm[kept, 2] / sigma_mm) ** 2) / np.sqrt(
            np.float32(np.sqrt(np.pi)) * sigma_mm
        )
        carrier = np.float32(4.0 * np.pi / self.scanner.wavelength_mm) * range_mm
        phase = np.where(echoes.smooth[kept], np.float32(0.0), carrier)
        value = echoes.amplitude[kept] * profile
        cell, size = rows * lines + columns, samples * lines
        real = np.bincount(cell, value * np.cos(phase), minlength=size)
        imaginary = np.bincount(cell, value * np.sin(phase), minlength=size)
        deposited = (real + 1j * imaginary).reshape(samples, lines) / np.sqrt(self._per_cell())[:, None]
        loss_db = along_beams_db(
            beams, self.tissue.settings, (rows, columns), echoes.attenuation[kept], profile * profile
        )
        return Echo(self._blur(deposited.astype(np.complex64)), loss_db)

    def _per_cell(self) -> Float[np.ndarray, " s"]:
        """Mean number of scatterers a grid cell and mm of elevation, by depth: a convex array's cells widen."""
        beams, scanner = self.beams, self.scanner
        area_mm2 = beams.sample_mm / beams.stretch * beams.beam_mm * np.ones(beams.shape[0])
        if scanner.geometry == "convex":
            true_mm = np.maximum(beams.sample_depth_mm, 0.0) / beams.stretch
            area_mm2 *= (scanner.radius_mm + true_mm) / scanner.radius_mm
        return self.tissue.settings.scatterers_per_mm3 * area_mm2

    def _blur(self, echo: Complex64[np.ndarray, "s b"]) -> Complex64[np.ndarray, "k s b"]:
        """Convolve with pulse and beam, both of unit energy; the pulse has a later copy, the beam's width its depth.

        Side lobes and stray paths are a second, wide and weak blur. Looks from other directions are the same beam
        shifted in lateral frequency, as a steered aperture is.
        """
        beams, artefacts, scanner = self.beams, self.tissue.artefacts, self.scanner
        samples, lines = echo.shape
        frequency = fft.fftfreq(samples)
        later = artefacts.reverberation_mm / beams.sample_mm
        copies = 1.0 + 10.0 ** (artefacts.reverberation_db / 20.0) * np.exp(-2j * np.pi * frequency * later)
        pulse = self._gaussian(np.array([beams.axial_sigma_mm / beams.sample_mm]), samples)[0]
        stray = self._gaussian(np.array([2.5 * beams.axial_sigma_mm / beams.sample_mm]), samples)[0]
        spectrum = fft.fft(echo, axis=0)
        along = fft.ifft(spectrum * (pulse * copies).astype(np.complex64)[:, None], axis=0)
        strayed = fft.ifft(spectrum * stray[:, None], axis=0)
        width = beams.lateral_sigma_mm(beams.sample_depth_mm) / beams.beam_mm
        clutter = np.float32(10.0 ** (artefacts.clutter_db / 20.0))
        haze = clutter * (fft.fft(strayed, axis=1) * self._gaussian(STRAY_WIDTH * width, lines))
        spectrum = fft.fft(along, axis=1)
        steps = np.arange(scanner.looks) - 0.5 * (scanner.looks - 1)
        looks = [spectrum * self._gaussian(width, lines, LOOK_STEP * step) + haze for step in steps]
        return np.asarray(fft.ifft(np.stack(looks), axis=2), dtype=np.complex64)

    @staticmethod
    def _gaussian(
        sigma: Float[np.ndarray, " n"], length: int, shift: float = 0.0
    ) -> Float32[np.ndarray, "n length"]:
        """Transfer function of Gaussians of unit energy, one a row, moved by ``shift`` of their own deviations."""
        scaled = 2.0 * np.pi * fft.fftfreq(length) * sigma[:, None] - shift
        scale = np.sqrt(2.0 * np.sqrt(np.pi) * sigma)[:, None]
        return (scale * np.exp(-0.5 * scaled**2)).astype(np.float32)

    def _receive(
        self, echo: Echo, contact_db: Float32[np.ndarray, " b"], rng: np.random.Generator
    ) -> Complex64[np.ndarray, "k s b"]:
        """Apply the losses, add what rings between face and air, and the noise that depth gain raises downwards."""
        beams, scanner = self.beams, self.scanner
        rate = 2.0 * scanner.frequency_mhz * self.tissue.settings.compensation_db_cm_mhz / 10.0
        noise_db = scanner.noise_db + rate * (beams.sample_depth_mm - scanner.depth_mm)
        level = (10.0 ** (noise_db / 20.0) / np.sqrt(2.0)).astype(np.float32)[:, None]
        noise = rng.standard_normal((2, scanner.looks, *beams.shape), dtype=np.float32)
        passed = (10.0 ** (-(echo.loss_db + contact_db) / 20.0)).astype(np.float32)
        received = echo.signal * passed + level * (noise[0] + 1j * noise[1])
        return np.asarray(received + ring_down(beams, self.tissue.artefacts, contact_db), dtype=np.complex64)

    def _hidden(self, loss_db: Float32[np.ndarray, "s b"]) -> Bool[np.ndarray, "h w"]:
        """Pixels where shadow or missing contact takes more than plain tissue above them would, by 12 dB."""
        settings, beams = self.tissue.settings, self.beams
        rate = 2.0 * self.scanner.frequency_mhz / 10.0
        usual_db = rate * (settings.attenuation_db_cm_mhz - settings.compensation_db_cm_mhz)
        excess_db = loss_db - (usual_db * np.maximum(beams.sample_depth_mm, 0.0))[:, None]
        return (beams.to_picture(excess_db.astype(np.float32)) > HIDDEN_DB) & beams.seen
