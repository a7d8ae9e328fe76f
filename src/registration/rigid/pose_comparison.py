"""Selection: which candidates are one pose, how well each explains the clouds, and how surely one beats another.

The lowest residual alone proves nothing on a vessel: a pose is the result only if the others explain the same points
worse by more than chance. Two poses are compared point by point, as Vuong compares models (Econometrica 57(2), 1989):
the mean difference of their losses over its standard error, which is taken over blocks of neighbouring points, for
their residuals hang together.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial.distance import cdist

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.pairs import closest_pairs
from registration.rigid.icp.robust_kernels import MEDIAN_TO_SIGMA

# A standardised residual beyond this is an outlier under either pose and says nothing more.
LOSS_CAP = 3.0
# Next to its tangent plane a fixed point stands for the surface as far as this many spacings around it.
PATCH_SPACINGS = 3.0
# Residuals below this share of the spacing are the sampling's, not the pose's.
FLOOR_SPACINGS = 0.1
# A fixed point within so many inlier distances of the moved cloud counts for the way back.
NEAR_INLIERS = 3.0


def distinct(
    poses: Float64[np.ndarray, "s 4 4"], probe_mm: Float64[np.ndarray, "p 3"], reach_mm: float
) -> list[Int64[np.ndarray, " _"]]:
    """Group poses that move points alike.

    Parameters
    ----------
    poses : ndarray, shape (s, 4, 4)
        Poses, best first.
    probe_mm : ndarray, shape (p, 3)
        Moving points in mm.
    reach_mm : float
        Poses are alike if they move the points alike within this root mean square distance in mm.

    Returns
    -------
    list of ndarray of int
        Indices of each group; the first pose stands for it, and groups come in the order of their first ones.
    """
    places_mm = probe_mm @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
    flat_mm = places_mm.reshape(len(poses), -1)
    near = cdist(flat_mm, flat_mm) <= reach_mm * np.sqrt(len(probe_mm))
    free = np.ones(len(poses), dtype=bool)
    groups = []
    for index in range(len(poses)):
        if free[index]:
            members = near[index] & free
            members[index] = False
            groups.append(np.concatenate([[index], np.flatnonzero(members)]))
            free[groups[-1]] = False
    return groups


@dataclass(frozen=True)
class Evidence:
    """What the moving points say about poses.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    block : ndarray of int, shape (m,)
        Block of each point: residuals in one hang together.
    target : TreeTarget
        Fixed cloud that poses are found on.
    smoothed : TreeTarget
        Fixed cloud that poses are compared on, which tells them apart better where there is noise; the same one for a
        cloud without normals.
    offset : bool, optional
        Whether a distance that all points have along the normals, which point outwards then, counts for no pose and
        against none.
    core : int, optional
        Number of points before the isolated ones, which come last.
    frame : ndarray of int, shape (m,), or None, optional
        Frame that each moving point was seen in; None where frames are not known.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    block: Int64[np.ndarray, " m"]
    target: TreeTarget
    smoothed: TreeTarget
    offset: bool = False
    core: int = 0
    frame: Int64[np.ndarray, " m"] | None = None
    # A search asks about the same pose several times.
    _known: dict[bytes, np.ndarray] = field(default_factory=dict, init=False, repr=False, compare=False)

    def squared_mm2(self, poses: Float64[np.ndarray, "s 4 4"]) -> Float64[np.ndarray, "s m"]:
        """Compute the squared distance from every moved point to the fixed surface.

        It is taken along the normal of the closest fixed point and outside its patch; to the point itself where
        there are no normals.

        Parameters
        ----------
        poses : ndarray, shape (s, 4, 4)
            Poses (fixed_T_moving).

        Returns
        -------
        ndarray, shape (s, m)
            Squared distances in mm².
        """
        return np.stack([self._squared_mm2(pose) for pose in poses])

    def _squared_mm2(self, pose: np.ndarray) -> Float64[np.ndarray, " m"]:
        key = pose.tobytes()
        if key not in self._known:
            pairs = closest_pairs(self.moving_mm, self.smoothed, pose[None])
            gap_mm = pairs.gap_mm[0]
            aside_mm = np.sqrt(pairs.aside_mm2[0])
            along_mm2 = (gap_mm - np.median(gap_mm) if self.offset else gap_mm) ** 2
            reach_mm = PATCH_SPACINGS * self.smoothed.spacing_mm
            self._known[key] = along_mm2 + np.maximum(aside_mm - reach_mm, 0.0) ** 2
        return self._known[key]

    def wall_offset_mm(self, pose: Float64[np.ndarray, "4 4"]) -> float:
        """Compute by how much the moved wall lies outside the fixed one: the median along the normals.

        Parameters
        ----------
        pose : ndarray, shape (4, 4)
            Pose (fixed_T_moving).

        Returns
        -------
        float
            Offset in mm; NaN where it is not looked for.
        """
        if not self.offset:
            return float("nan")
        return float(-np.median(closest_pairs(self.moving_mm, self.smoothed, pose[None]).gap_mm))

    def bounded_mm2(self, poses: Float64[np.ndarray, "s 4 4"]) -> Float64[np.ndarray, "s m"]:
        """Compute the squared distances, bounded, so that an outlier weighs the same under every pose.

        The bound follows from the robust scale under the pose that has the smallest.

        Parameters
        ----------
        poses : ndarray, shape (s, 4, 4)
            Poses (fixed_T_moving).

        Returns
        -------
        ndarray, shape (s, m)
            Squared distances in mm².
        """
        squared = self.squared_mm2(poses)
        scale_mm2 = MEDIAN_TO_SIGMA**2 * float(np.median(squared, axis=1).min())
        floor_mm = FLOOR_SPACINGS * self.smoothed.spacing_mm
        return np.minimum(squared, LOSS_CAP**2 * max(scale_mm2, floor_mm**2))

    def gaps(self, poses: Float64[np.ndarray, "s 4 4"]) -> Float64[np.ndarray, " s"]:
        """Compute by how many standard errors each pose explains the points worse than the first one does.

        Parameters
        ----------
        poses : ndarray, shape (s, 4, 4)
            Poses (fixed_T_moving).

        Returns
        -------
        ndarray, shape (s,)
            Gaps in standard errors, 0 for the first.
        """
        return gaps_of(self.bounded_mm2(poses), self.block)

    def part(self, chosen: Bool[np.ndarray, " m"]) -> Evidence:
        """Take a part of the moving points.

        Parameters
        ----------
        chosen : ndarray of bool, shape (m,)
            Which points.

        Returns
        -------
        Evidence
            What these points say.
        """
        blocks = np.unique(self.block[chosen], return_inverse=True)[1]
        return replace(
            self,
            moving_mm=self.moving_mm[chosen],
            block=blocks,
            core=int(chosen[: self.core].sum()),
            frame=None if self.frame is None else self.frame[chosen],
        )


def gaps_of(losses: Float64[np.ndarray, "s m"], block: Int64[np.ndarray, " m"]) -> Float64[np.ndarray, " s"]:
    """Compute by how many standard errors each pose explains the points worse than the first one does.

    Parameters
    ----------
    losses : ndarray, shape (s, m)
        Loss of each point under each pose.
    block : ndarray of int, shape (m,)
        Block of each point.

    Returns
    -------
    ndarray, shape (s,)
        Gaps in standard errors, 0 for the first.
    """
    count = int(block.max()) + 1
    summed = np.stack([np.bincount(block, row, count) for row in losses - losses[0]])
    error = np.sqrt(count * summed.var(axis=1, ddof=1)) if count > 1 else np.zeros(len(losses))
    return np.divide(summed.sum(axis=1), error, out=np.zeros(len(losses)), where=error > 0)


@dataclass(frozen=True)
class TwoWay:
    """Residuals of one pose both ways.

    Parameters
    ----------
    rmse_bidirectional_mm : float
        Root mean square distance in mm, the way back over the fixed points that the moved cloud lies next to.
    coverage : float
        Share of the fixed points that the moved cloud covers.
    """

    rmse_bidirectional_mm: float
    coverage: float


def two_way(
    moving: TreeTarget,
    fixed_mm: Float64[np.ndarray, "n 3"],
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    rmse_mm: float,
    inlier_mm: float,
    near_mm: float,
) -> TwoWay:
    """Add the way back to the residual of the way there.

    Parameters
    ----------
    moving : TreeTarget
        Moving cloud.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    rmse_mm : float
        Root mean square distance in mm of the way there.
    inlier_mm : float
        A fixed point within this distance in mm of the moved cloud is covered.
    near_mm : float
        A fixed point within this distance in mm counts for the way back: a part of a vessel leaves most of the whole
        uncovered, which is no fault of the pose.

    Returns
    -------
    TwoWay
        Residuals both ways.
    """
    back_mm = moving.distances_mm(transforms.apply(transforms.invert_rigid(fixed_T_moving), fixed_mm))
    near = back_mm[back_mm <= near_mm]
    back_mm2 = float((near**2).mean()) if len(near) else float("inf")
    return TwoWay(float(np.sqrt(0.5 * (rmse_mm**2 + back_mm2))), float((back_mm <= inlier_mm).mean()))


def both_ways(
    moving: TreeTarget,
    fixed: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    rmse_mm: float,
    inlier_spacings: float,
) -> TwoWay:
    """Add the way back, with inliers within so many spacings of the sparser cloud.

    Parameters
    ----------
    moving : TreeTarget
        Moving cloud.
    fixed : TreeTarget
        Fixed cloud.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    rmse_mm : float
        Root mean square distance in mm of the way there.
    inlier_spacings : float
        An inlier lies within so many distances between neighbouring points.

    Returns
    -------
    TwoWay
        Residuals both ways.
    """
    inlier_mm = inlier_spacings * max(fixed.spacing_mm, moving.spacing_mm)
    return two_way(moving, fixed.points_mm, fixed_T_moving, rmse_mm, inlier_mm, NEAR_INLIERS * inlier_mm)
