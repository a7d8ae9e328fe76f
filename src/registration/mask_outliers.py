"""Masks of a tracked sweep that disagree with their neighbours: found by place, size and shape in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from registration import frames
from registration.checks import require_count, require_positive

POSITION, SIZE, SHAPE = "position", "size", "shape"
REASONS = (POSITION, SIZE, SHAPE)
# A mask of at most so many pixels is compared pixel by pixel; of a larger one as many are drawn evenly.
PIXELS = 400
# How many times the test is repeated at most with the masks found so far left out of the comparison.
ROUNDS = 8
# With fewer masks than this on a side there is no line through them.
LEAST_SIDE = 3
# Of a normal distribution's absolute values.
DEVIATION_PER_MEDIAN = 1.4826
# A mask at the sweep's end has neighbours on one side only, from which its place is extrapolated.
END_SLACK = 1.5


@dataclass(frozen=True)
class MaskCheck:
    """Which masks disagree with their neighbours, and in what.

    ``reason`` (k,) is position, size or shape, or empty for a mask that agrees; ``excess`` (k,) is by what factor the
    limit was passed. ``specks`` (k,) marks masks of which a part was taken out that is far from all parts of their
    neighbours. ``empty`` (k,) marks masks without a vessel between others that show it. ``undecided`` is the share of
    masks that disagreed where it was so large that none of them was rejected, else 0.
    """

    masks: Bool[np.ndarray, "k height width"] | Float[np.ndarray, "k height width"]
    reason: tuple[str, ...]
    excess: Float64[np.ndarray, "k"]
    specks: Bool[np.ndarray, "k"]
    empty: Bool[np.ndarray, "k"]
    undecided: float = 0.0

    @property
    def rejected(self) -> Bool[np.ndarray, "k"]:
        """Which masks were rejected."""
        return np.array([reason != "" for reason in self.reason], dtype=bool)


@dataclass(frozen=True)
class MaskOutliers:
    """Leave out masks whose vessel lies, or is, unlike what the masks before and after it show.

    Each mask is described by its middle in the world, the radius of a circle of its area, and its shape around its
    middle. Lines through the ``window`` masks before, through those after, and through both (by medians of slopes:
    Theil, 1950, and Sen, J. Am. Stat. Assoc. 63, 1968) predict middle and radius; the prediction that fits best counts,
    so that a vessel that branches, ends or jumps in view agrees with one side. Limits are in radii of the neighbours
    for ``position`` and ``size``, and a share of pixels for ``shape``; where a whole sweep scatters, ``deviations``
    robust standard deviations are allowed. Masks found are left out of the lines and the test is repeated.

    A part of a mask far from all parts of its neighbours is a speck and is taken out alone. Where more than
    ``most_share`` of all masks would be rejected, none is: then the neighbours are no standard. Where it is not
    ``enabled``, all masks are kept.
    """

    window: int = 6
    position: float = 0.4
    size: float = 0.25
    shape: float = 0.3
    deviations: float = 6.0
    most_share: float = 0.35
    enabled: bool = True

    def __post_init__(self) -> None:
        require_count("window", self.window, LEAST_SIDE)
        for name in ("position", "size", "shape", "deviations"):
            require_positive(name, getattr(self, name))
        require_positive("most_share", self.most_share, 1.0)

    def __call__(
        self,
        masks: Bool[np.ndarray, "k height width"] | Float[np.ndarray, "k height width"],
        world_A_pixel: Float64[np.ndarray, "k 4 4"],
        level: float = 0.5,
    ) -> MaskCheck:
        """Compare each mask, bool or probability (a vessel from ``level`` on), with its neighbours along the sweep.

        Masks come in the order in which the probe moved. The masks that are returned are empty where they were
        rejected; nothing is copied where there is nothing to leave out.
        """
        seen = _Seen.of(masks, world_A_pixel, level)
        reason, excess, undecided = self._judge(seen)
        rejected = np.array([one != "" for one in reason], dtype=bool)
        specks = _specks(seen, ~rejected, self.window) if self.enabled else {}
        if rejected.any() or specks:
            masks = masks.copy()
            masks[rejected] = 0
            for frame, own in specks.items():
                masks[frame][own] = 0
        shown = np.flatnonzero(seen.shown)
        empty = ~seen.shown
        if len(shown):
            empty[: shown[0]] = empty[shown[-1] + 1 :] = False
        spotted = np.isin(np.arange(len(masks)), list(specks))
        return MaskCheck(masks, reason, excess, spotted, empty, undecided)

    def _judge(self, seen: _Seen) -> tuple[tuple[str, ...], np.ndarray, float]:
        count = len(seen.shown)
        none = ("",) * count, np.zeros(count), 0.0
        if not self.enabled or seen.shown.sum() < 2 * LEAST_SIDE:
            return none
        good = seen.shown.copy()
        factors = np.zeros((count, 3))
        for _ in range(ROUNDS):
            factors = self._factors(seen, good)
            found = seen.shown & ~(factors.max(axis=1) > 1)
            if (found == good).all():
                break
            # Were most masks unlike the others, there would be nothing left to compare with.
            if found.sum() < 2 * LEAST_SIDE:
                break
            good = found
        bad = seen.shown & (factors.max(axis=1) > 1)
        share = float(bad.sum() / seen.shown.sum())
        if share > self.most_share:
            return none[0], none[1], share
        worst = factors.argmax(axis=1)
        reason = tuple(REASONS[worst[frame]] if bad[frame] else "" for frame in range(count))
        return reason, np.where(bad, factors.max(axis=1), 0.0), 0.0

    def _factors(self, seen: _Seen, good: Bool[np.ndarray, "k"]) -> Float64[np.ndarray, "k 3"]:
        """By how many times its limit each mask is off in position, size and shape, by the side that fits best."""
        usable = np.flatnonzero(good)
        found = np.full((len(good), 3, 3), np.nan)
        for frame in np.flatnonzero(seen.shown):
            before = usable[usable < frame][-self.window :]
            after = usable[usable > frame][: self.window]
            near = min(self.window // 2, len(before)), min(self.window // 2, len(after))
            both = np.concatenate([before[len(before) - near[0] :], after[: near[1]]])
            if not near[0] or not near[1]:
                both = both[:0]
            for side, others in enumerate((before, after, both)):
                if len(others) >= LEAST_SIDE:
                    found[frame, side] = seen.apart(int(frame), others)
        ends = np.isnan(found[:, 2, 0])
        # A vessel that ends in a sweep, ends in a dome.
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


@dataclass(frozen=True)
class _Seen:
    """What each mask shows: middle and normal in the world, radius, the pixels, and the way of the probe."""

    filled: Bool[np.ndarray, "k height width"]
    world_A_pixel: Float64[np.ndarray, "k 4 4"]
    shown: Bool[np.ndarray, "k"]
    middle_mm: Float64[np.ndarray, "k 3"]
    middle_px: Float64[np.ndarray, "k 2"]
    radius_mm: Float64[np.ndarray, "k"]
    way_mm: Float64[np.ndarray, "k"]

    @classmethod
    def of(cls, masks: np.ndarray, world_A_pixel: np.ndarray, level: float) -> _Seen:
        filled = masks if masks.dtype == np.bool_ else masks >= level
        pixels = filled.sum(axis=(1, 2))
        weight = np.maximum(pixels, 1)
        across = filled.sum(axis=1) @ np.arange(filled.shape[2]) / weight
        down = filled.sum(axis=2) @ np.arange(filled.shape[1]) / weight
        middle_px = np.stack([across, down], axis=1)
        middle_mm = frames.apply_each(world_A_pixel, np.pad(middle_px, ((0, 0), (0, 1))))
        area_mm2 = np.linalg.norm(np.cross(world_A_pixel[:, :3, 0], world_A_pixel[:, :3, 1]), axis=1)
        centre_px = np.array([0.5 * filled.shape[2], 0.5 * filled.shape[1], 0.0])
        centres_mm = frames.apply_each(world_A_pixel, np.tile(centre_px, (len(filled), 1)))
        steps_mm = np.linalg.norm(np.diff(centres_mm, axis=0), axis=1)
        return cls(
            filled,
            world_A_pixel,
            pixels > 0,
            middle_mm,
            middle_px,
            np.sqrt(pixels * area_mm2 / np.pi),
            np.concatenate([[0.0], np.cumsum(steps_mm)]),
        )

    @cached_property
    def normals(self) -> Float64[np.ndarray, "k 3"]:
        """Of each picture."""
        facing = np.cross(self.world_A_pixel[:, :3, 0], self.world_A_pixel[:, :3, 1])
        return facing / np.linalg.norm(facing, axis=1, keepdims=True)

    @cached_property
    def pixel_mm(self) -> Float64[np.ndarray, "k 2"]:
        """The sizes of a pixel along columns and rows."""
        return np.linalg.norm(self.world_A_pixel[:, :3, :2], axis=1)

    @cached_property
    def drawn_mm(self) -> list[Float64[np.ndarray, "p 2"]]:
        """Some pixels of each mask, evenly drawn, in mm from its middle along columns and rows."""
        found = []
        for frame, own in enumerate(self.filled):
            row, column = np.nonzero(own)
            few = np.linspace(0, len(row) - 1, min(PIXELS, len(row))).astype(np.int64)
            offset_px = np.stack([column[few], row[few]], axis=1) - self.middle_px[frame]
            found.append(offset_px * self.pixel_mm[frame])
        return found

    def apart(self, frame: int, others: Int64[np.ndarray, "n"]) -> tuple[float, float, float]:
        """How far a mask is from what others predict: place and radius in their radii, and the share of its shape.

        The radius has a sign: it is below 0 for a mask that is too small.
        """
        usual_mm = float(np.median(self.radius_mm[others]))
        values = np.column_stack([self.middle_mm[others], self.radius_mm[others]])
        expected = _line_at(self.way_mm[others], values, float(self.way_mm[frame]))
        offset_mm = self.middle_mm[frame] - expected[:3]
        beside_mm = offset_mm - (offset_mm @ self.normals[frame]) * self.normals[frame]
        wider_mm = float(self.radius_mm[frame] - expected[3])
        # Two of the others need agree: shapes change fast where branches part, but not from one mask to the next.
        shape = sorted(self._unlike(frame, int(other)) for other in others)[1]
        return float(np.linalg.norm(beside_mm)) / usual_mm, wider_mm / usual_mm, shape

    def _unlike(self, frame: int, other: int) -> float:
        """The share of two masks that do not cover each other, once their middles and areas are the same (1 - DSC)."""
        scale = self.radius_mm[other] / self.radius_mm[frame]
        place = self.middle_px[other] + scale * self.drawn_mm[frame] / self.pixel_mm[other]
        column, row = np.rint(place).astype(np.int64).T
        height, width = self.filled.shape[1:]
        there = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        # What the picture's edge cuts off says nothing about the shape.
        if not there.any():
            return 1.0
        return 1 - float(self.filled[other][row[there], column[there]].mean())


def _line_at(
    way_mm: Float64[np.ndarray, "n"], values: Float64[np.ndarray, "n d"], place_mm: float
) -> Float64[np.ndarray, "d"]:
    """Values at a place by the line of median slope through others."""
    first, second = np.triu_indices(len(way_mm), 1)
    run_mm = way_mm[second] - way_mm[first]
    moving = run_mm > 1e-6
    if not moving.any():
        return np.asarray(np.median(values, axis=0))
    slope = np.median((values[second[moving]] - values[first[moving]]) / run_mm[moving, None], axis=0)
    return np.asarray(np.median(values + (place_mm - way_mm)[:, None] * slope, axis=0))


def _specks(
    seen: _Seen, good: Bool[np.ndarray, "k"], window: int
) -> dict[int, Bool[np.ndarray, "height width"]]:
    """Parts of masks that no part of the neighbours comes near, by frame; a mask's largest part is none."""
    from scipy.ndimage import label

    usable = np.flatnonzero(good & seen.shown)
    parts: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    labels: dict[int, np.ndarray] = {}
    for frame in usable:
        found, count = label(seen.filled[frame])
        sizes = np.bincount(found.reshape(-1), minlength=count + 1)[1:]
        if count > 1:
            labels[int(frame)] = found
            middle_px = np.array(
                [np.argwhere(found == one)[:, ::-1].mean(axis=0) for one in range(1, count + 1)]
            )
        else:
            middle_px = seen.middle_px[[frame]]
        middle_mm = frames.apply(seen.world_A_pixel[frame], np.pad(middle_px, ((0, 0), (0, 1))))
        radius_mm = np.sqrt(sizes * seen.pixel_mm[frame].prod() / np.pi)
        parts[int(frame)] = (middle_mm, radius_mm, sizes)
    specks = {}
    for frame, found in labels.items():
        middle_mm, radius_mm, sizes = parts[frame]
        place = int(np.searchsorted(usable, frame))
        near = usable[max(place - window // 2, 0) : place + window // 2 + 1]
        lone = [
            one + 1
            for one in range(len(sizes))
            if one != sizes.argmax()
            and not any(
                _meets(middle_mm[one], radius_mm[one], parts[int(other)]) for other in near if other != frame
            )
        ]
        if lone and len(near) > LEAST_SIDE:
            specks[frame] = np.isin(found, lone)
    return specks


def _meets(middle_mm: np.ndarray, radius_mm: float, others: Sequence[np.ndarray]) -> bool:
    """Whether a part comes within a radius of one of another mask's parts."""
    apart_mm = np.linalg.norm(others[0] - middle_mm, axis=1)
    return bool((apart_mm <= 2 * radius_mm + others[1]).any())
