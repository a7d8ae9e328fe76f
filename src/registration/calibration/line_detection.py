"""The bright line that the bottom of a water tank makes in an ultrasound image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8
from scipy.ndimage import gaussian_filter1d
from scipy.stats import theilslopes

from registration.checks import require_count, require_positive
from registration.errors import InputError


@dataclass(frozen=True)
class LineDetector:
    """Detector of one bright, nearly horizontal line in each frame.

    Along each scanline the brightest row is taken, smoothed and refined by a parabola. A line is fitted by
    the Theil-Sen median of slopes, then by least squares to its inliers.

    Parameters
    ----------
    clip_origin_px : tuple[int, int] or list of int or None, optional
        Column and row of the clip rectangle in px; None takes the whole frame.
    clip_size_px : tuple[int, int] or list of int or None, optional
        Width and height of the clip rectangle in px; None takes the whole frame.
    scanlines : int, optional
        Number of columns, spread over the clip rectangle, at least 3.
    smoothing_px : float, optional
        Standard deviation of the smoothing along each column in px.
    inlier_px : float, optional
        Distance in px within which a point belongs to the line.
    min_inlier_share : float, optional
        Share of the scanlines below which there is no line.

    Raises
    ------
    InputError
        If a value is out of range or only one part of the clip rectangle is given.
    """

    clip_origin_px: tuple[int, int] | list[int] | None = None
    clip_size_px: tuple[int, int] | list[int] | None = None
    scanlines: int = 40
    smoothing_px: float = 1.5
    inlier_px: float = 4.0
    min_inlier_share: float = 0.4

    def __post_init__(self) -> None:
        require_count("scanlines", self.scanlines, 3)
        require_positive("smoothing_px", self.smoothing_px)
        require_positive("inlier_px", self.inlier_px)
        require_positive("min_inlier_share", self.min_inlier_share, 1)
        if (self.clip_origin_px is None) != (self.clip_size_px is None):
            raise InputError("clip_origin_px, clip_size_px: expected both or neither, received one")

    def __call__(self, images: UInt8[np.ndarray, "n height width"]) -> Float64[np.ndarray, " n"]:
        """Detect the line in every frame.

        Parameters
        ----------
        images : ndarray of uint8, shape (n, height, width)
            Grey values.

        Returns
        -------
        ndarray, shape (n,)
            Row in px where the line crosses the middle column of the clip rectangle; NaN where there is none.

        Raises
        ------
        InputError
            If the clip rectangle does not lie within the frames.
        """
        height, width = images.shape[1:]
        left, top = self.clip_origin_px or (0, 0)
        across, down = self.clip_size_px or (width, height)
        if not (0 <= left < left + across <= width and 0 <= top < top + down <= height):
            raise InputError(
                f"clip rectangle: expected within {width}x{height} px, received origin ({left}, {top}), "
                f"size ({across}, {down})"
            )
        columns = np.linspace(left, left + across - 1, self.scanlines).round().astype(int)
        middle = left + (across - 1) / 2
        rows = [top + self._row_at(image[top : top + down, columns], columns, middle) for image in images]
        return np.array(rows, dtype=np.float64)

    def _row_at(self, profiles: np.ndarray, columns: np.ndarray, middle: float) -> float:
        """The fitted row at column ``middle``, within the clip rectangle."""
        smooth = gaussian_filter1d(profiles.astype(np.float64), self.smoothing_px, axis=0)
        peak = smooth.argmax(axis=0)
        lit = smooth[peak, np.arange(len(columns))] > smooth.mean(axis=0)
        if lit.sum() < max(3, self.min_inlier_share * len(columns)):
            return float("nan")
        rows, along = _between_rows(smooth, peak)[lit], columns[lit]
        slope, intercept = theilslopes(rows, along)[:2]
        near = np.abs(slope * along + intercept - rows) <= self.inlier_px
        if near.sum() < max(3, self.min_inlier_share * len(columns)):
            return float("nan")
        slope, intercept = np.polyfit(along[near], rows[near], 1)
        return float(slope * middle + intercept)


def _between_rows(smooth: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Rows of the maxima to a fraction of a pixel, by a parabola; at the rim the row itself."""
    inner = np.clip(peak, 1, len(smooth) - 2)
    column = np.arange(smooth.shape[1])
    before, at, after = smooth[inner - 1, column], smooth[inner, column], smooth[inner + 1, column]
    curvature = before - 2 * at + after
    usable = (curvature < 0) & (inner == peak)
    shift = np.where(usable, 0.5 * (before - after) / np.where(usable, curvature, 1.0), 0.0)
    return peak + shift
