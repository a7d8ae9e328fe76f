"""Outlier masks of a tracked sweep: masks whose position, size or shape differs from the neighbours'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.reconstruction.mask_series import MaskSeries
from registration.reconstruction.mask_specks import specks

POSITION, SIZE, SHAPE = "position", "size", "shape"
REASONS = (POSITION, SIZE, SHAPE)
# Largest number of repetitions of the test, each without the masks rejected so far.
MAX_ROUNDS = 8
# Smallest number of masks on a side that a line is fitted to.
MIN_MASKS_A_SIDE = 3
# Standard deviation of a normal distribution over the median of its absolute values.
DEVIATION_PER_MEDIAN = 1.4826
# Factor of the limits at the sweep's ends: neighbours on one side only, from which positions are extrapolated.
END_SLACK = 1.5


@dataclass(frozen=True)
class MaskCheck:
    """Masks of a sweep without the outliers, and why each outlier was rejected.

    Parameters
    ----------
    frames : tuple of ndarray of bool or float, shape (height, width)
        The k masks or probability maps, parts of the array that was given; those from which something was
        removed are copies, and rejected ones are empty.
    reason : tuple of str
        "position", "size" or "shape" for a rejected mask, empty for one that agrees with its neighbours.
    excess : ndarray, shape (k,)
        Factor by which a rejected mask exceeds its limit; 0 for the others.
    specks : ndarray of bool, shape (k,)
        Masks from which a part far from all parts of the neighbouring masks was removed.
    empty : ndarray of bool, shape (k,)
        Masks without a vessel between others that show it.
    undecided : float, optional
        Share of outliers where that was too large for any to be rejected, else 0.
    """

    frames: tuple[Bool[np.ndarray, "height width"] | Float[np.ndarray, "height width"], ...]
    reason: tuple[str, ...]
    excess: Float64[np.ndarray, " k"]
    specks: Bool[np.ndarray, " k"]
    empty: Bool[np.ndarray, " k"]
    undecided: float = 0.0

    __repr__ = brief_repr

    @property
    def rejected(self) -> Bool[np.ndarray, " k"]:
        """Which masks were rejected."""
        return np.array([reason != "" for reason in self.reason], dtype=bool)


@dataclass(frozen=True)
class MaskOutliers:
    """Outlier rejection for masks that disagree with the masks before and after them.

    Parameters
    ----------
    window : int, optional
        Number of masks on each side that predict a mask, at least 3.
    position : float, optional
        Largest distance of a mask's centroid from the prediction, in radii of the neighbours.
    size : float, optional
        Largest difference of a mask's radius from the prediction, in radii of the neighbours.
    shape : float, optional
        Largest share of pixels (1 - DSC) that differ from the neighbours' shape.
    deviations : float, optional
        Number of robust standard deviations that are allowed where the whole sweep varies more than these
        limits.
    max_share : float, optional
        Largest share of masks that may be rejected, 0 to 1; where it is exceeded none is, because the
        neighbours are then no reference.
    enabled : bool, optional
        Whether masks are compared; if not, all are kept.

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    Each mask is described by its centroid in the world, the radius of a circle of its area, and its shape
    around the centroid. Theil-Sen lines through the masks before, those after, and both predict centroid and
    radius. The best of the three predictions counts, so that a vessel that branches, ends or jumps in view
    agrees with one side. Rejected masks are excluded from the lines and the test is repeated. A part of a
    mask far from all parts of its neighbours is removed alone.

    References
    ----------
    H. Theil, Proc. KNAW 53, 1950; P. K. Sen, J. Am. Stat. Assoc. 63, 1968.
    """

    window: int = 6
    position: float = 0.4
    size: float = 0.25
    shape: float = 0.3
    deviations: float = 6.0
    max_share: float = 0.35
    enabled: bool = True

    def __post_init__(self) -> None:
        require_count("window", self.window, MIN_MASKS_A_SIDE)
        for name in ("position", "size", "shape", "deviations"):
            require_positive(name, getattr(self, name))
        require_positive("max_share", self.max_share, 1.0)

    def __call__(
        self,
        masks: Bool[np.ndarray, "k height width"] | Float[np.ndarray, "k height width"],
        world_A_pixel: Float64[np.ndarray, "k 4 4"],
        level: float = 0.5,
    ) -> MaskCheck:
        """Reject the masks that disagree with their neighbours along the sweep.

        Parameters
        ----------
        masks : ndarray of bool or float, shape (k, height, width)
            Masks or probability maps in the order of acquisition; they are not changed.
        world_A_pixel : ndarray, shape (k, 4, 4)
            Affine matrix of each mask from pixels to world mm.
        level : float, optional
            Probability from which on a pixel is vessel.

        Returns
        -------
        MaskCheck
            The masks, rejected ones empty, and the reasons.
        """
        series = MaskSeries.of(masks, world_A_pixel, level)
        reason, excess, undecided = self._reject(series)
        rejected = np.array([one != "" for one in reason], dtype=bool)
        speck_pixels = specks(series, ~rejected, self.window) if self.enabled else {}
        # A sweep's masks take hundreds of megabytes: only those that change are copied.
        frames = list(masks)
        for frame in np.flatnonzero(rejected).tolist():
            frames[frame] = np.zeros_like(masks[frame])
        for frame, own in speck_pixels.items():
            frames[frame] = np.where(own, masks.dtype.type(0), masks[frame])
        shown = np.flatnonzero(series.shown)
        empty = ~series.shown
        if len(shown):
            empty[: shown[0]] = empty[shown[-1] + 1 :] = False
        with_specks = np.isin(np.arange(len(masks)), list(speck_pixels))
        return MaskCheck(tuple(frames), reason, excess, with_specks, empty, undecided)

    def _reject(self, series: MaskSeries) -> tuple[tuple[str, ...], np.ndarray, float]:
        count = len(series.shown)
        none = ("",) * count, np.zeros(count), 0.0
        if not self.enabled or series.shown.sum() < 2 * MIN_MASKS_A_SIDE:
            return none
        good = series.shown.copy()
        factors = np.zeros((count, 3))
        for _ in range(MAX_ROUNDS):
            factors = self._factors(series, good)
            found = series.shown & ~(factors.max(axis=1) > 1)
            if (found == good).all():
                break
            # Were most masks unlike the others, there would be nothing left to compare with.
            if found.sum() < 2 * MIN_MASKS_A_SIDE:
                break
            good = found
        bad = series.shown & (factors.max(axis=1) > 1)
        share = float(bad.sum() / series.shown.sum())
        if share > self.max_share:
            return none[0], none[1], share
        worst = factors.argmax(axis=1)
        reason = tuple(REASONS[worst[frame]] if bad[frame] else "" for frame in range(count))
        return reason, np.where(bad, factors.max(axis=1), 0.0), 0.0

    def _factors(self, series: MaskSeries, good: Bool[np.ndarray, " k"]) -> Float64[np.ndarray, "k 3"]:
        """By how many times its limit each mask is off in position, size and shape, by the side that fits best."""
        usable = np.flatnonzero(good)
        found = np.full((len(good), 3, 3), np.nan)
        for frame in np.flatnonzero(series.shown):
            before = usable[usable < frame][-self.window :]
            after = usable[usable > frame][: self.window]
            near = min(self.window // 2, len(before)), min(self.window // 2, len(after))
            both = np.concatenate([before[len(before) - near[0] :], after[: near[1]]])
            if not near[0] or not near[1]:
                both = both[:0]
            for side, others in enumerate((before, after, both)):
                if len(others) >= MIN_MASKS_A_SIDE:
                    found[frame, side] = series.differences(int(frame), others)
        ends = np.isnan(found[:, 2, 0])
        # A vessel that ends within the sweep ends in a dome: smaller masks are no outliers there.
        found[ends, :, 1] = np.maximum(found[ends, :, 1], 0.0)
        known = np.where(np.isnan(found), np.inf, np.abs(found))
        best = known.min(axis=1)
        limits = np.array([self.position, self.size, self.shape])
        spread = [np.median(values[np.isfinite(values)]) for values in best[good].T]
        limits = np.maximum(limits, self.deviations * DEVIATION_PER_MEDIAN * np.array(spread))
        factors = known / limits
        factors[ends] /= END_SLACK
        side = factors.max(axis=2).argmin(axis=1)
        chosen = factors[np.arange(len(good)), side]
        return np.where(np.isfinite(chosen), chosen, 0.0)
