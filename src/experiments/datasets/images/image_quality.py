"""Which frames look unlike the rest: five measures of an image, and a rule that is stated and has no hidden choice.

The rule is the modified z-score (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993): the distance from the
median in units of 1.4826 times the median absolute deviation; they take values beyond 3.5 for outliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np
from jaxtyping import Float64, UInt8

from experiments.errors import InputError

SATURATED = 250
# Half the width of the patch whose mean is taken off before speckle is measured.
PATCH_PX = 7
DEVIATION_OF_MAD = 1.4826


@dataclass(frozen=True)
class Quality:
    """How one image looks.

    Parameters
    ----------
    brightness : float
        Logarithm of 1 + mean grey value.
    contrast : float
        Logarithm of 1 + standard deviation of the grey values.
    sharpness : float
        Logarithm of the share of the deviation that lies in differences of neighbours.
    speckle_px : float
        Logarithm of the speckle size: the lag at which the autocorrelation of the image without its local
        mean falls to one half, geometric mean of both axes.
    saturation : float
        Share of pixels with 250 or more.
    """

    brightness: float
    contrast: float
    sharpness: float
    speckle_px: float
    saturation: float


MEASURES = tuple(field.name for field in fields(Quality))
# A smaller deviation than this is never taken for the usual spread: were all frames but a few equal, any difference
# would be an outlier. Five per cent of brightness, contrast, sharpness and grain, half a per cent of the pixels.
MIN_DEVIATION = Quality(0.05, 0.05, 0.05, 0.05, 0.005)


@dataclass(frozen=True)
class Finding:
    """One reason to leave an image out.

    Parameters
    ----------
    index : int
        Place of the image among those measured.
    measure : str
        Name of the measure.
    value : float
        Value of the measure.
    score : float
        Its modified z-score.
    """

    index: int
    measure: str
    value: float
    score: float


@dataclass(frozen=True)
class QualityOutliers:
    """Finds the images of which any measure is an outlier against all images given.

    Parameters
    ----------
    limit : float
        Modified z-score beyond which a value is an outlier, above 0.

    Raises
    ------
    InputError
        If ``limit`` is not above 0.
    """

    limit: float = 3.5

    def __post_init__(self) -> None:
        if isinstance(self.limit, bool) or not self.limit > 0:
            raise InputError(f"quality_limit: expected a number above 0, received {self.limit!r}")

    def __call__(self, images: Sequence[UInt8[np.ndarray, "h w"]]) -> tuple[Finding, ...]:
        """Find every measure beyond the limit.

        Parameters
        ----------
        images : sequence of ndarray of uint8, shape (h, w)
            All images.

        Returns
        -------
        tuple of Finding
            Outliers in order of image and measure.
        """
        if not images:
            return ()
        values = np.array([astuple(measure(image)) for image in images])
        scores = robust_scores(values)
        return tuple(
            Finding(int(index), MEASURES[column], float(values[index, column]), float(scores[index, column]))
            for index, column in np.argwhere(np.abs(scores) > self.limit)
        )


def robust_scores(values: Float64[np.ndarray, "n m"]) -> Float64[np.ndarray, "n m"]:
    """Compute the modified z-score of each value within its column.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Values of the m measures.

    Returns
    -------
    ndarray, shape (n, m)
        Scores; deviations below ``MIN_DEVIATION`` are raised to it.

    References
    ----------
    B. Iglewicz and D. C. Hoaglin, How to Detect and Handle Outliers, ASQC Quality Press, 1993.
    """
    apart = values - np.median(values, axis=0)
    deviation = DEVIATION_OF_MAD * np.median(np.abs(apart), axis=0)
    return np.asarray(apart / np.maximum(deviation, astuple(MIN_DEVIATION)))


def measure(image: UInt8[np.ndarray, "h w"]) -> Quality:
    """Measure one image.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.

    Returns
    -------
    Quality
        The five measures.
    """
    from scipy.ndimage import uniform_filter

    grey = image.astype(np.float32)
    deviation = float(grey.std())
    local = grey - uniform_filter(grey, 2 * PATCH_PX + 1)
    grain_px = np.sqrt(_half_width_px(local) * _half_width_px(local.T))
    steps = 0.5 * (np.abs(np.diff(grey, axis=0)).mean() + np.abs(np.diff(grey, axis=1)).mean())
    return Quality(
        brightness=float(np.log1p(grey.mean())),
        contrast=float(np.log1p(deviation)),
        # A uniform image has neither steps nor deviation: nothing is sharp in it.
        sharpness=float(np.log((steps + 1e-3) / (deviation + 1.0))),
        speckle_px=float(np.log(grain_px)),
        saturation=float((image >= SATURATED).mean()),
    )


def _half_width_px(local: np.ndarray) -> float:
    """Return the lag down the rows at which the autocorrelation falls to one half, interpolated linearly."""
    power = float((local * local).mean())
    if power <= 0:
        return 1.0
    before = 1.0
    for lag in range(1, min(2 * PATCH_PX, len(local))):
        now = float((local[lag:] * local[:-lag]).mean()) / power
        if now <= 0.5:
            return lag - 1 + (before - 0.5) / (before - now)
        before = now
    return float(2 * PATCH_PX)
