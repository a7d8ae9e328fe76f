"""Clouds of which neither holds the other: a search in which a share of the pairs counts, and how its poses compare.

Where both clouds go on beyond what the other one shows, the right pose leaves many points without a partner, and a
wrong one that lays all of them somewhere near the surface has the smaller residual. Points that lie beyond the ends of
the fixed cloud, away from it along the surface and not across, therefore cost the same wherever they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.rigid.coarse_to_fine import BASIN_POINTS, CoarseToFine, Found
from registration.rigid.icp.estimation import Estimation
from registration.rigid.icp.pairs import closest_pairs
from registration.rigid.pose_comparison import (
    FLOOR_SPACINGS,
    LOSS_CAP,
    PATCH_SPACINGS,
    Evidence,
    distinct,
    gaps_of,
)
from registration.rigid.result import Candidate
from registration.rigid.search_cone import Bound

# A point this many times as far along the surface as a fixed point stands for lies beyond the ends of the cloud.
BEYOND_PATCHES = 2.0
# Loss of such a point, in variances of the noise: that of a fair pair is 1, that of an outlier 9.
BEYOND_LOSS = 2.0
# A quarter of the points is enough to tell the noise from: the right pose brings as many onto the surface.
QUARTER, QUARTER_TO_SIGMA = 0.25, 1 / 0.31864
# Step between starts beyond the ends, as a share of the moving cloud's length.
OVERHANG_STEP = 0.15


@dataclass(frozen=True)
class View:
    """How poses explain the moving points in view of the fixed cloud.

    Parameters
    ----------
    loss : ndarray, shape (s, m)
        Loss of each point under each pose.
    seen : ndarray of bool, shape (s, m)
        Whether the point lies where the fixed cloud is, and not beyond its ends.
    noise_mm : float
        Standard deviation of the noise in mm that the losses are in.
    """

    loss: Float64[np.ndarray, "s m"]
    seen: Bool[np.ndarray, "s m"]
    noise_mm: float


@dataclass(frozen=True)
class PartialOverlap:
    """Search for a pose that brings a part of the moving cloud onto a part of the fixed one.

    It follows where the search for the whole cloud ends in no accepted result. All poses of both are compared; the
    pairs are weighed by trimming alone, with and without an offset of the walls.

    Parameters
    ----------
    keep : float, optional
        Share of closest pairs that counts.
    overhang : float, optional
        Share of the moving cloud's length by which starts may reach beyond the ends of the fixed one where no pose is
        known, 0 to below 1; 0 looks for partial overlap around a known pose only.
    min_share : float, optional
        Smallest share of the moving points in view of the fixed cloud.
    survivors : int, optional
        Number of poses that go on from the coarse stage.
    finalists : int, optional
        Number of poses that go on from the middle stage.

    Raises
    ------
    InputError
        If a share is outside its range or a count is below 1.
    """

    keep: float = 0.5
    overhang: float = 0.0
    min_share: float = 0.25
    survivors: int = 24
    finalists: int = 8

    def __post_init__(self) -> None:
        require_positive("keep", self.keep, 1.0)
        if not QUARTER <= self.min_share <= 1.0:
            raise InputError(
                f"min_share: expected a share from {QUARTER:g} to 1, received {self.min_share!r}"
            )
        if not 0.0 <= self.overhang < 1.0:
            raise InputError(f"overhang: expected a share from 0 to below 1, received {self.overhang!r}")
        require_count("survivors", self.survivors, 1)
        require_count("finalists", self.finalists, 1)

    def starts(
        self, evidence: Evidence, starts: Float64[np.ndarray, "s 4 4"]
    ) -> Float64[np.ndarray, "t 4 4"]:
        """Shift starting poses along the fixed cloud, beyond its ends.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.
        starts : ndarray, shape (s, 4, 4)
            Starting poses (fixed_T_moving).

        Returns
        -------
        ndarray, shape (t, 4, 4)
            These and the shifted ones.
        """
        moving = principal_frame(evidence.moving_mm)
        length_mm = float(np.ptp((evidence.moving_mm - moving.centre_mm) @ moving.axes[:, 0]))
        way = principal_frame(evidence.target.points_mm).axes[:, 0]
        steps = int(np.ceil(self.overhang / OVERHANG_STEP))
        shifted = np.tile(starts, (2 * steps + 1, 1, 1, 1))
        shares = np.linspace(-self.overhang, self.overhang, 2 * steps + 1)
        shifted[..., :3, 3] += (shares * length_mm)[:, None, None] * way
        return shifted.reshape(-1, 4, 4)

    def searches(self, search: CoarseToFine, estimations: Iterable[Estimation]) -> Iterator[CoarseToFine]:
        """Derive the searches in which a share of the pairs counts.

        Parameters
        ----------
        search : CoarseToFine
            Search for the whole cloud.
        estimations : iterable of Estimation
            Steps of the late stages.

        Yields
        ------
        CoarseToFine
            One search for each step.
        """
        for estimation in estimations:
            yield replace(
                search,
                keep=self.keep,
                kept=self.keep,
                kernel=None,
                estimation=estimation,
                coarse=replace(search.coarse, max_survivors=self.survivors),
                middle=replace(search.middle, max_survivors=self.finalists),
            )

    def best(
        self,
        evidence: Evidence,
        found: Sequence[tuple[CoarseToFine, Found]],
        within: Bound | None = None,
        moving_normals: Float64[np.ndarray, "m 3"] | None = None,
    ) -> tuple[Found, Bool[np.ndarray, " m"]] | None:
        """Compare the refined poses of several searches.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.
        found : sequence of (CoarseToFine, Found)
            The searches and where they ended.
        within : Bound or None, optional
            Bound that no pose lies outside of.
        moving_normals : ndarray, shape (m, 3), or None, optional
            Normals of the moving points.

        Returns
        -------
        found : Found
            Poses of different basins, the one that explains the points in view best first, with their gaps.
        seen : ndarray of bool, shape (m,)
            Which moving points are in view under that pose.
            None in place of both if no pose has enough points in view.
        """
        pool = [(search, one) for search, each in found for one in each.candidates[: len(each.gap)]]
        iterations = sum(each.iterations for _, each in found)
        ranked = self._ranked(evidence, [one for _, one in pool])[0]
        last = []
        for index in ranked[: self.finalists]:
            search, one = pool[index]
            if one.stage != search.fine.name:
                refined, more = search.refined(evidence, one, within, moving_normals)
                iterations += more
                if refined is None:
                    continue
                one = refined
            last.append(one)
        order, view = self._ranked(evidence, last)
        if view is None or not len(order):
            return None
        poses = np.stack([last[index].fixed_T_moving for index in order])
        reach_mm = found[0][0].reach_mm(evidence)
        firsts = order[[group[0] for group in distinct(poses, evidence.moving_mm[:BASIN_POINTS], reach_mm)]]
        candidates = tuple(
            replace(last[index], score_mm=float(view.noise_mm * np.sqrt(view.loss[index].mean())))
            for index in firsts
        )
        merged = Found(candidates, gaps_of(view.loss[firsts], evidence.block), iterations)
        return merged, view.seen[firsts[0]]

    def _ranked(
        self, evidence: Evidence, pool: Sequence[Candidate]
    ) -> tuple[Int64[np.ndarray, " k"], View | None]:
        """Those with enough points in view, best first, and what all of them see."""
        if not pool:
            return np.zeros(0, dtype=np.int64), None
        view = compare_in_view(evidence, np.stack([one.fixed_T_moving for one in pool]))
        order = np.argsort(view.loss.mean(axis=1), kind="stable")
        return order[view.seen.mean(axis=1)[order] >= self.min_share].astype(np.int64), view


def compare_in_view(evidence: Evidence, poses: Float64[np.ndarray, "s 4 4"]) -> View:
    """Compute how poses explain the points in view, those beyond the ends of the fixed cloud costing all the same.

    Parameters
    ----------
    evidence : Evidence
        Both clouds.
    poses : ndarray, shape (s, 4, 4)
        Poses (fixed_T_moving).

    Returns
    -------
    View
        Losses, bounded, in variances of the noise of the pose that has the least.
    """
    pairs = closest_pairs(evidence.moving_mm, evidence.smoothed, poses)
    reach_mm = PATCH_SPACINGS * evidence.smoothed.spacing_mm
    seen = pairs.aside_mm2 <= (BEYOND_PATCHES * reach_mm) ** 2
    # Walls that coincide nowhere are no offset: a cloud that floats beside the vessel would be in view all the same.
    offset_mm = np.clip(_offsets_mm(evidence, pairs.gap_mm, seen), -reach_mm, reach_mm)
    off_mm = np.abs(pairs.gap_mm - offset_mm[:, None])
    quarters_mm = np.quantile(np.where(seen, off_mm, np.finfo(np.float64).max), QUARTER, axis=1)
    noise_mm = max(QUARTER_TO_SIGMA * float(quarters_mm.min()), FLOOR_SPACINGS * evidence.smoothed.spacing_mm)
    loss = np.where(seen, np.minimum((off_mm / noise_mm) ** 2, LOSS_CAP**2), BEYOND_LOSS)
    return View(loss, seen, noise_mm)


def _offsets_mm(evidence: Evidence, gap_mm: np.ndarray, seen: np.ndarray) -> Float64[np.ndarray, " s"]:
    """The distance that the walls lie apart everywhere: the median of the points in view."""
    if not evidence.offset:
        return np.zeros(len(gap_mm))
    return np.array(
        [np.median(row[chosen]) if chosen.any() else 0.0 for row, chosen in zip(gap_mm, seen, strict=True)]
    )
