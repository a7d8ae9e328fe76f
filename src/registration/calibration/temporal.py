"""Temporal calibration: the constant lag between the tracker's and the images' clock, from the motion seen by both.

The image's motion signal is compared with the tracker's at all lags by normalised cross-correlation; the peak is
found between samples by a parabola. The procedure follows PLUS's temporal calibration (Lasso et al., IEEE Trans.
Biomed. Eng. 61(10), 2014), which moves a probe up and down above the bottom of a water tank.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.errors import InputError

# Motion at constant speed correlates equally at all lags; what differs then is rounding.
_MIN_CONTRAST = 1e-3


@dataclass(frozen=True)
class TemporalResult:
    """Lag of the tracker, and how certain it is.

    Parameters
    ----------
    tracker_lag_s : float
        Lag in s, positive where poses are stamped later than the frames they belong to.
    correlation : float
        Correlation at the chosen peak. Its sign tells whether the image's signal runs with the principal axis
        of the motion or against it.
    runner_up_lag_s, runner_up_correlation : float
        Lag in s and correlation of the next best peak of either sign; NaN where there is none.
    lags_s : ndarray, shape (k,)
        Lags of the search in s.
    correlations : ndarray, shape (k,)
        Correlation at each lag.
    frames_used : ndarray of bool, shape (n,)
        Frames that entered.
    """

    tracker_lag_s: float
    correlation: float
    runner_up_lag_s: float
    runner_up_correlation: float
    lags_s: Float64[np.ndarray, " k"]
    correlations: Float64[np.ndarray, " k"]
    frames_used: np.ndarray

    __repr__ = brief_repr

    @property
    def offset_s(self) -> float:
        """Offset in s to add to the poses' times to bring them to the images' clock."""
        return -self.tracker_lag_s


@dataclass(frozen=True)
class TemporalCalibration:
    """Estimator of the tracker's lag.

    A periodic motion correlates nearly as well a period later, or half a period later with the sign inverted:
    among the peaks within ``tie`` of the best, the smallest lag is taken, as PLUS does.

    Parameters
    ----------
    max_lag_s : float, optional
        Largest lag that is searched in s, either way.
    step_s : float, optional
        Step of the search in s, at most a quarter of ``max_lag_s``; refined by a parabola.
    tie : float, optional
        Difference in correlation within which peaks are tied.
    min_correlation : float, optional
        Smallest correlation that is accepted.
    min_frames : int, optional
        Smallest number of frames, at least 3.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    max_lag_s: float = 0.5
    step_s: float = 0.001
    tie: float = 0.02
    min_correlation: float = 0.8
    min_frames: int = 20

    def __post_init__(self) -> None:
        require_positive("max_lag_s", self.max_lag_s)
        require_positive("step_s", self.step_s, self.max_lag_s / 4)
        require_positive("tie", self.tie, 1)
        require_positive("min_correlation", self.min_correlation, 1)
        require_count("min_frames", self.min_frames, 3)

    def __call__(
        self,
        image_times_s: Float[np.ndarray, " n"],
        image_signal: Float[np.ndarray, " n"],
        pose_times_s: Float[np.ndarray, " m"],
        pose_signal: Float[np.ndarray, " m"],
    ) -> TemporalResult:
        """Estimate the lag.

        Parameters
        ----------
        image_times_s : ndarray, shape (n,)
            Time of each frame in s.
        image_signal : ndarray, shape (n,)
            Motion seen in each frame, in any unit; NaN marks a frame without one.
        pose_times_s : ndarray, shape (m,)
            Time of each pose in s, increasing.
        pose_signal : ndarray, shape (m,)
            Motion of the probe at each pose, in any unit.

        Returns
        -------
        TemporalResult
            The lag and the correlation curve.

        Raises
        ------
        InputError
            If too few frames lie within the tracker's times, a signal does not move, the correlation is too
            low, or its peak is at the end of the search.
        """
        used = self._usable(image_times_s, image_signal, pose_times_s)
        steps = int(np.ceil(self.max_lag_s / self.step_s))
        lags_s = np.arange(-steps, steps + 1) * self.step_s
        sampled = np.interp(image_times_s[used][None] + lags_s[:, None], pose_times_s, pose_signal)
        correlations = (
            _normalised(sampled, "pose_signal") @ _normalised(image_signal[used][None], "image_signal")[0]
        )
        peaks = _peaks(np.abs(correlations))
        self._require_a_peak(np.abs(correlations), peaks)
        height = np.abs(correlations[peaks])
        tied = peaks[height >= height.max() - self.tie]
        chosen = int(tied[np.abs(lags_s[tied]).argmin()])
        others = peaks[peaks != chosen]
        second = int(others[np.abs(correlations[others]).argmax()]) if len(others) else None
        return TemporalResult(
            tracker_lag_s=_refined(lags_s, np.abs(correlations), chosen),
            correlation=float(correlations[chosen]),
            runner_up_lag_s=float("nan") if second is None else float(lags_s[second]),
            runner_up_correlation=float("nan") if second is None else float(correlations[second]),
            lags_s=lags_s,
            correlations=correlations,
            frames_used=used,
        )

    def _usable(
        self,
        image_times_s: Float[np.ndarray, " n"],
        image_signal: Float[np.ndarray, " n"],
        pose_times_s: Float[np.ndarray, " m"],
    ) -> np.ndarray:
        """The frames that have a signal and, at every lag of the search, poses on both sides."""
        first_s, last_s = pose_times_s[0] + self.max_lag_s, pose_times_s[-1] - self.max_lag_s
        usable = np.isfinite(image_signal) & (image_times_s >= first_s) & (image_times_s <= last_s)
        if usable.sum() < self.min_frames:
            raise InputError(
                f"image_signal: expected at least {self.min_frames} frames with a signal whose times lie "
                f"{self.max_lag_s:g} s inside the poses', received {usable.sum()}"
            )
        return usable

    def _require_a_peak(self, heights: Float64[np.ndarray, " k"], peaks: np.ndarray) -> None:
        """Refuse a correlation that is too low, the same everywhere, or highest where the search stopped."""
        found = f"expected a correlation of at least {self.min_correlation:g} at a lag within {self.max_lag_s:g} s"
        if heights.max() < self.min_correlation:
            raise InputError(f"signals: {found}, received at most {heights.max():.3f}")
        if np.ptp(heights) < _MIN_CONTRAST:
            raise InputError(
                "signals: expected a motion that tells one lag from another, such as up and down, "
                "received one that fits all lags alike"
            )
        if not len(peaks) or heights[peaks].max() < self.min_correlation:
            raise InputError(f"signals: {found}, received {heights.max():.3f} only at the end of the search")


def principal_motion_mm(positions_mm: Float[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
    """Project positions on the axis of their largest variance, about their mean.

    Parameters
    ----------
    positions_mm : ndarray, shape (m, 3)
        Positions in mm.

    Returns
    -------
    ndarray, shape (m,)
        Position along the axis in mm; the axis's sign is arbitrary.

    Raises
    ------
    InputError
        If the positions do not move.
    """
    centred = np.asarray(positions_mm, dtype=np.float64) - np.mean(positions_mm, axis=0)
    if len(centred) < 2 or not np.ptp(centred, axis=0).max() > 0:
        raise InputError("positions_mm: expected positions that move, received ones that do not")
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    return centred @ axis


def _normalised(signals: Float64[np.ndarray, "k n"], name: str) -> Float64[np.ndarray, "k n"]:
    """Each row about its mean and of unit norm, so that a product of two rows is their correlation."""
    centred = signals - signals.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(centred, axis=1, keepdims=True)
    if not (norm > 1e-12 * np.abs(signals).max(initial=1)).all():
        raise InputError(f"{name}: expected a signal that moves, received a constant one")
    return centred / norm


def _peaks(values: Float64[np.ndarray, " k"]) -> np.ndarray:
    """Indices of the local maxima, the ends left out: a maximum there is only where the search stopped."""
    middle = values[1:-1]
    return np.flatnonzero((middle >= values[:-2]) & (middle > values[2:])) + 1


def _refined(lags_s: Float64[np.ndarray, " k"], values: Float64[np.ndarray, " k"], at: int) -> float:
    """The summit of the parabola through a peak and its neighbours."""
    before, peak, after = values[at - 1 : at + 2]
    curvature = before - 2 * peak + after
    shift = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    return float(lags_s[at] + shift * (lags_s[1] - lags_s[0]))
