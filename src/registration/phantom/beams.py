"""Where the beams of a probe run, and how the picture is made from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy.ndimage import map_coordinates

from registration.phantom.settings import Scanner

FWHM_PER_SIGMA = 2.3548


@dataclass(frozen=True)
class Beams:
    """The grid of beams and samples of a linear array.

    Image coordinates are lateral and depth in mm, the lateral one 0 at the middle of the array. Some beams and samples
    beyond the picture are kept, so that its borders are made like its middle.
    """

    scanner: Scanner

    @cached_property
    def axial_sigma_mm(self) -> float:
        """Deviation of the pulse's envelope: half the transmitted pulse's length, because the path is double."""
        return self.scanner.pulse_cycles * self.scanner.wavelength_mm / 2.0 / FWHM_PER_SIGMA

    @cached_property
    def lateral_sigma_mm(self) -> float:
        """Deviation of the beam at its focus: its full width at half maximum is wavelength times f-number."""
        return self.scanner.wavelength_mm * self.scanner.f_number / FWHM_PER_SIGMA

    @cached_property
    def sample_mm(self) -> float:
        """Distance between samples along a beam."""
        return 0.9 * self.axial_sigma_mm

    @cached_property
    def beam_mm(self) -> float:
        """Distance between beams."""
        return 0.9 * self.lateral_sigma_mm

    @cached_property
    def half_width_mm(self) -> float:
        """Half the width of what is imaged."""
        return 0.5 * min(self.scanner.aperture_mm, self.scanner.width_px * self.scanner.pixel_mm)

    @cached_property
    def margin_mm(self) -> float:
        """How far the grid reaches beyond the picture."""
        return 4.0 * self.lateral_sigma_mm

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Number of samples and of beams."""
        depth_mm = self.scanner.depth_mm + 2 * self.margin_mm
        width_mm = 2 * (self.half_width_mm + self.margin_mm)
        return int(np.ceil(depth_mm / self.sample_mm)) + 1, int(np.ceil(width_mm / self.beam_mm)) + 1

    @cached_property
    def sample_depth_mm(self) -> Float64[np.ndarray, "s"]:
        """Depth of each sample; the first ones lie above the skin."""
        return np.arange(self.shape[0]) * self.sample_mm - self.margin_mm

    def to_grid(
        self, lateral_mm: Float32[np.ndarray, "*n"], depth_mm: Float32[np.ndarray, "*n"]
    ) -> tuple[Float32[np.ndarray, "*n"], Float32[np.ndarray, "*n"]]:
        """Fractional sample and beam of each place."""
        sample = (depth_mm + self.margin_mm) / self.sample_mm
        beam = (lateral_mm + self.half_width_mm + self.margin_mm) / self.beam_mm
        return np.asarray(sample, dtype=np.float32), np.asarray(beam, dtype=np.float32)

    @cached_property
    def pixel_places_mm(self) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
        """Lateral and depth coordinate of each pixel's centre."""
        scanner = self.scanner
        column = (np.arange(scanner.width_px) - 0.5 * (scanner.width_px - 1)) * scanner.pixel_mm
        row = (np.arange(scanner.height_px) + 0.5) * scanner.pixel_mm
        lateral, depth = np.meshgrid(column, row)
        return lateral, depth

    @cached_property
    def seen(self) -> Bool[np.ndarray, "h w"]:
        """Pixels that show tissue; the others stay black."""
        lateral, _ = self.pixel_places_mm
        return np.abs(lateral) <= self.half_width_mm

    def to_picture(self, grid: Float32[np.ndarray, "s b"]) -> Float32[np.ndarray, "h w"]:
        """Interpolate a grid of beams at the pixels (scan conversion)."""
        return np.asarray(map_coordinates(grid, self._pixel_grid, order=1, mode="nearest"), dtype=np.float32)

    @cached_property
    def _pixel_grid(self) -> Float32[np.ndarray, "2 h w"]:
        lateral, depth = self.pixel_places_mm
        return np.stack(self.to_grid(lateral.astype(np.float32), depth.astype(np.float32)))

    @cached_property
    def probe_A_pixel(self) -> Float64[np.ndarray, "4 4"]:
        """Pixel (column, row, 0, 1) to the probe's frame: x lateral, z depth, origin at the middle of the array.

        The third column completes a right-handed basis: it points along -y.
        """
        lateral, depth = self.pixel_places_mm
        side = self.scanner.pixel_mm
        probe_A_pixel = np.diag([side, 0.0, 0.0, 1.0])
        probe_A_pixel[2, 1] = side
        probe_A_pixel[1, 2] = -side
        probe_A_pixel[:3, 3] = lateral[0, 0], 0.0, depth[0, 0]
        return probe_A_pixel
