"""Connected parts of masks that are far from all parts of the neighbouring masks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.ndimage import label

from registration import transforms
from registration.reconstruction.mask_series import MaskSeries

# Smallest number of neighbouring masks: with fewer, a part may be the first or last of its branch.
MIN_NEIGHBOURS = 3


@dataclass(frozen=True)
class _Parts:
    """The connected parts of one mask: middles in the world, radii of circles of their areas.

    ``labels`` are their numbers in the mask's box; None for a mask of one part.
    """

    middle_mm: Float64[np.ndarray, "n 3"]
    radius_mm: Float64[np.ndarray, " n"]
    labels: Int64[np.ndarray, "rows columns"] | None

    @classmethod
    def of(cls, series: MaskSeries, frame: int) -> _Parts:
        box = series.boxes[frame]
        found, count = label(series.filled[frame][box])
        middle_px, numbered = series.middle_px[[frame]], None
        if count > 1:
            numbered = found.astype(np.int64)
            places = [np.argwhere(found == one)[:, ::-1].mean(axis=0) for one in range(1, count + 1)]
            middle_px = np.array(places) + np.array([box[1].start, box[0].start])
        sizes = np.bincount(found.reshape(-1), minlength=count + 1)[1:]
        middle_mm = transforms.apply(series.world_A_pixel[frame], np.pad(middle_px, ((0, 0), (0, 1))))
        return cls(middle_mm, np.sqrt(sizes * series.pixel_mm[frame].prod() / np.pi), numbered)

    def meets(self, one: int, other: _Parts, path_mm: float) -> bool:
        """Whether a part comes within its radius of a part of another mask, or as near as the masks are."""
        apart_mm = np.linalg.norm(other.middle_mm - self.middle_mm[one], axis=1)
        return bool((apart_mm <= 2 * self.radius_mm[one] + other.radius_mm + path_mm).any())


def specks(
    series: MaskSeries, good: Bool[np.ndarray, " k"], window: int
) -> dict[int, Bool[np.ndarray, "height width"]]:
    """Find parts of masks that are far from all parts of the neighbouring masks.

    Parameters
    ----------
    series : MaskSeries
        The masks of a sweep.
    good : ndarray of bool, shape (k,)
        Masks that are compared with one another.
    window : int
        Number of neighbouring masks that a part is compared with.

    Returns
    -------
    dict of int to ndarray of bool, shape (height, width)
        Pixels of these parts by number of the mask; a mask's largest part is never among them.
    """
    usable = np.flatnonzero(good & series.shown)
    parts = {frame: _Parts.of(series, frame) for frame in usable.tolist()}
    found = {}
    for place, (frame, own) in enumerate(parts.items()):
        near = usable[max(place - window // 2, 0) : place + window // 2 + 1].tolist()
        if own.labels is None or len(near) <= MIN_NEIGHBOURS:
            continue
        path_mm = {
            other: abs(float(series.path_mm[other] - series.path_mm[frame]))
            for other in near
            if other != frame
        }
        isolated = [
            one + 1
            for one in range(len(own.radius_mm))
            if one != own.radius_mm.argmax()
            and not any(own.meets(one, parts[other], path_mm[other]) for other in path_mm)
        ]
        if isolated:
            found[frame] = np.zeros(series.filled.shape[1:], dtype=bool)
            found[frame][series.boxes[frame]] = np.isin(own.labels, isolated)
    return found
