"""Where the beams of a probe run, and how the picture is made from them.

Image coordinates are lateral and depth in mm, 0 at the middle of the array's face. Beam coordinates are the arc along
the face and the range from it; for a linear array they are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy.ndimage import map_coordinates

from registration.phantom.acoustics import ASSUMED_SPEED_M_S, Scanner

FWHM_PER_SIGMA = 2.3548


@dataclass(frozen=True)
class Beams:
    """Grid of samples and beams of one scanner in tissue of a given speed of sound.

    Some beams and samples beyond the picture are kept, so that its borders are made like its middle.

    Parameters
    ----------
    scanner : Scanner
        Probe and scanner.
    sound_speed_m_s : float, optional
        True speed of sound in the tissue in m/s.
    """

    scanner: Scanner
    sound_speed_m_s: float = ASSUMED_SPEED_M_S

    @property
    def stretch(self) -> float:
        """Ratio of displayed to true range."""
        return ASSUMED_SPEED_M_S / self.sound_speed_m_s

    @cached_property
    def axial_sigma_mm(self) -> float:
        """Standard deviation of the pulse's envelope in mm, half the pulse's: the path is double."""
        return self.scanner.pulse_cycles * self.scanner.wavelength_mm / 2.0 / FWHM_PER_SIGMA

    @cached_property
    def sample_mm(self) -> float:
        """Distance between samples along a beam in mm, as displayed."""
        return 0.9 * self.axial_sigma_mm

    @cached_property
    def beam_mm(self) -> float:
        """Distance between beams along the face in mm."""
        depths_mm = np.linspace(0.0, self.scanner.depth_mm, 50)
        return 0.9 * float(self.lateral_sigma_mm(depths_mm).min())

    @cached_property
    def half_arc_mm(self) -> float:
        """Half the length in mm of the part of the face that is imaged."""
        scanner = self.scanner
        if scanner.geometry == "linear":
            return 0.5 * min(scanner.aperture_mm, scanner.width_px * scanner.pixel_mm)
        return 0.5 * scanner.aperture_mm

    @cached_property
    def margin_mm(self) -> float:
        """Distance in mm by which the grid extends beyond the picture."""
        return 4.5 * self.beam_mm

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Number of samples and of beams."""
        depth_mm = self.scanner.depth_mm + 2 * self.margin_mm
        width_mm = 2 * (self.half_arc_mm + self.margin_mm)
        return int(np.ceil(depth_mm / self.sample_mm)) + 1, int(np.ceil(width_mm / self.beam_mm)) + 1

    @cached_property
    def sample_depth_mm(self) -> Float64[np.ndarray, " s"]:
        """Displayed range of each sample in mm; the first ones lie behind the face."""
        return np.arange(self.shape[0]) * self.sample_mm - self.margin_mm

    @cached_property
    def beam_arc_mm(self) -> Float64[np.ndarray, " b"]:
        """Position of each beam along the face in mm, 0 in its middle."""
        return np.arange(self.shape[1]) * self.beam_mm - self.half_arc_mm - self.margin_mm

    def lateral_sigma_mm(self, depth_mm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Compute the standard deviation of the beam along the face.

        It is wavelength times f-number at the focus and wider elsewhere.

        Parameters
        ----------
        depth_mm : ndarray, shape (n,)
            Range from the face in mm.

        Returns
        -------
        ndarray, shape (n,)
            Standard deviation in mm; for a convex array as arc on its face.
        """
        scanner = self.scanner
        away = (depth_mm - scanner.focus_mm) / scanner.focus_mm
        sigma = scanner.wavelength_mm * scanner.f_number / FWHM_PER_SIGMA * np.sqrt(1.0 + (0.8 * away) ** 2)
        if scanner.geometry == "linear":
            return sigma
        return sigma * scanner.radius_mm / (scanner.radius_mm + np.maximum(depth_mm, 0.0))

    def to_beam(
        self, lateral_mm: Float[np.ndarray, " *n"], depth_mm: Float[np.ndarray, " *n"]
    ) -> tuple[Float[np.ndarray, " *n"], Float[np.ndarray, " *n"]]:
        """Convert positions in the image plane to arc and true range.

        Parameters
        ----------
        lateral_mm : ndarray
            Lateral coordinate in mm, 0 in the middle of the face.
        depth_mm : ndarray
            Depth in mm, of the same shape.

        Returns
        -------
        arc_mm : ndarray
            Arc along the face in mm.
        range_mm : ndarray
            Range from the face in mm.
        """
        if self.scanner.geometry == "linear":
            return lateral_mm, depth_mm
        radius_mm = lateral_mm.dtype.type(self.scanner.radius_mm)
        angle = np.arctan2(lateral_mm, depth_mm + radius_mm)
        return angle * radius_mm, np.hypot(lateral_mm, depth_mm + radius_mm) - radius_mm

    def to_grid(
        self, arc_mm: Float[np.ndarray, " *n"], shown_mm: Float[np.ndarray, " *n"]
    ) -> tuple[Float[np.ndarray, " *n"], Float[np.ndarray, " *n"]]:
        """Convert arc and displayed range to fractional grid indices.

        Parameters
        ----------
        arc_mm : ndarray
            Arc along the face in mm.
        shown_mm : ndarray
            Displayed range in mm, of the same shape.

        Returns
        -------
        sample : ndarray
            Fractional sample index.
        beam : ndarray
            Fractional beam index.
        """
        sample = (shown_mm + self.margin_mm) / self.sample_mm
        return sample, (arc_mm + self.half_arc_mm + self.margin_mm) / self.beam_mm

    def displayed(self, local_mm: Float[np.ndarray, "*n 2"]) -> Float64[np.ndarray, "*n 2"]:
        """Compute where positions appear when the speed of sound is not as assumed.

        Parameters
        ----------
        local_mm : ndarray, shape (..., 2)
            Lateral and depth coordinates in mm.

        Returns
        -------
        ndarray, shape (..., 2)
            Displayed lateral and depth coordinates in mm.
        """
        if self.stretch == 1.0:
            return np.asarray(local_mm, dtype=np.float64)
        arc_mm, range_mm = self.to_beam(local_mm[..., 0], local_mm[..., 1])
        shown_mm = range_mm * self.stretch
        if self.scanner.geometry == "linear":
            return np.stack([arc_mm, shown_mm], axis=-1)
        radius_mm = self.scanner.radius_mm
        angle, away_mm = arc_mm / radius_mm, shown_mm + radius_mm
        return np.stack([away_mm * np.sin(angle), away_mm * np.cos(angle) - radius_mm], axis=-1)

    def directions(self, local_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute the unit direction of the beam at each position.

        Parameters
        ----------
        local_mm : ndarray, shape (n, 3)
            Image coordinates (lateral, depth, elevation) in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Unit vectors in image coordinates.
        """
        along = np.zeros_like(local_mm)
        along[:, 1] = 1.0
        if self.scanner.geometry == "convex":
            arc_mm, _ = self.to_beam(local_mm[:, 0], local_mm[:, 1])
            angle = arc_mm / local_mm.dtype.type(self.scanner.radius_mm)
            along[:, 0], along[:, 1] = np.sin(angle), np.cos(angle)
        return along

    @cached_property
    def pixel_places_mm(self) -> tuple[Float64[np.ndarray, "h w"], Float64[np.ndarray, "h w"]]:
        """Lateral and depth coordinate of each pixel centre in mm; the top row touches the ends of the face."""
        scanner = self.scanner
        column = (np.arange(scanner.width_px) - 0.5 * (scanner.width_px - 1)) * scanner.pixel_mm
        row = (np.arange(scanner.height_px) + 0.5) * scanner.pixel_mm - scanner.sag_mm
        lateral, depth = np.meshgrid(column, row)
        return lateral, depth

    @cached_property
    def seen(self) -> Bool[np.ndarray, "h w"]:
        """Pixels that show tissue; the others stay black."""
        arc_mm, shown_mm = self.to_beam(*self.pixel_places_mm)
        return (np.abs(arc_mm) <= self.half_arc_mm) & (shown_mm >= 0) & (shown_mm <= self.scanner.depth_mm)

    def to_picture(self, grid: Float32[np.ndarray, "s b"]) -> Float32[np.ndarray, "h w"]:
        """Interpolate a grid of beams at the pixels (scan conversion).

        Parameters
        ----------
        grid : ndarray of float32, shape (s, b)
            Values at each sample (first axis) of each beam.

        Returns
        -------
        ndarray of float32, shape (h, w)
            Values at the pixels.
        """
        picture = map_coordinates(grid, self._pixel_grid, order=1, mode="nearest")
        return np.asarray(picture, dtype=np.float32)

    @cached_property
    def _pixel_grid(self) -> Float32[np.ndarray, "2 h w"]:
        return np.stack(self.to_grid(*self.to_beam(*self.pixel_places_mm))).astype(np.float32)

    @cached_property
    def probe_A_pixel(self) -> Float64[np.ndarray, "4 4"]:
        """Pixel (column, row, 0, 1) to the probe's frame: x lateral, z depth, origin at the middle of the face.

        The third column completes a right-handed basis: it points along -y.
        """
        lateral, depth = self.pixel_places_mm
        side = self.scanner.pixel_mm
        probe_A_pixel = np.diag([side, 0.0, 0.0, 1.0])
        probe_A_pixel[2, 1] = side
        probe_A_pixel[1, 2] = -side
        probe_A_pixel[:3, 3] = lateral[0, 0], 0.0, depth[0, 0]
        return probe_A_pixel
