"""The residuals at a pose, averaged over small groups of points: few numbers that say what all points say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import transforms
from registration.errors import InputError
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.estimation import motion_jacobian, motion_transforms, with_offset
from registration.rigid.icp.pairs import closest_pairs
from registration.rigid.icp.robust_kernels import MEDIAN_TO_SIGMA
from registration.rigid.residual_model.compact_blocks import blocks_of

# Points farther from the surface than this, or than so many robust standard deviations, are no points of it.
FARTHEST_MM = 6.0
OUTLIER_SIGMA, MIN_CUT_MM = 5.0, 0.5
# A point whose closest fixed one lies aside by more than so many spacings lies beyond the end of the fixed cloud.
ASIDE_SPACINGS = 3.0
# A group with fewer points left says too little.
MIN_POINTS = 3


@dataclass(frozen=True)
class GroupedResiduals:
    """Residuals of g groups of neighbouring points, linearised in the motion of the cloud.

    Motions are (rotation vector times ``radius_mm``, translation) in mm, as in ``registration.rigid.uncertainty``.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Centre of rotation in mm in the fixed coordinate frame.
    radius_mm : float
        Radius of the cloud in mm.
    points_mm : ndarray, shape (g, 3)
        Mean of each group's points in mm.
    normals : ndarray, shape (g, 3)
        Mean of the fixed normals of each group, shorter than 1 where they differ.
    gap_mm : ndarray, shape (g,)
        Mean signed distance along the normals that would bring the group onto the surface, in mm.
    jacobian : ndarray, shape (g, u)
        Derivative of the gap by the unknowns: six of the pose, and the offset of the walls where there is one.
    shared_frames : ndarray, shape (g, g), or None
        Share of the points of two groups that one frame saw; None where frames are not known.
    share : float
        Share of the points that are near the surface.
    noise_mm : float
        Root mean square of the points' gaps around the mean of their group, in mm.
    group_points : float
        Mean number of points in a group.
    own_noise : ndarray, shape (g,), or None, optional
        Variance of the noise of each residual over that of a group of the wall; None for 1 everywhere.
    on_wall : ndarray of bool, shape (g,), or None, optional
        Which residuals are of the wall, whose border has an error of its own; None for all.
    """

    centre_mm: Float64[np.ndarray, "3"]
    radius_mm: float
    points_mm: Float64[np.ndarray, "g 3"]
    normals: Float64[np.ndarray, "g 3"]
    gap_mm: Float64[np.ndarray, " g"]
    jacobian: Float64[np.ndarray, "g u"]
    shared_frames: Float64[np.ndarray, "g g"] | None
    share: float
    noise_mm: float
    group_points: float
    own_noise: Float64[np.ndarray, " g"] | None = None
    on_wall: Bool[np.ndarray, " g"] | None = None

    def motions(self, motion_mm: Float64[np.ndarray, "k u"]) -> Float64[np.ndarray, "k 4 4"]:
        """Turn small motions into transforms.

        Parameters
        ----------
        motion_mm : ndarray, shape (k, u)
            Motions in mm; an offset of the walls moves nothing.

        Returns
        -------
        ndarray, shape (k, 4, 4)
            Transforms (fixed_T_fixed).
        """
        return motion_transforms(motion_mm[:, :6], self.centre_mm, self.radius_mm)


def grouped_residuals(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    *,
    block: Int64[np.ndarray, " m"],
    offset: bool,
    frame: Int64[np.ndarray, " m"] | None = None,
) -> GroupedResiduals | None:
    """Average the point-to-plane residuals at a pose over groups of neighbouring points.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    target : TreeTarget
        Fixed cloud with normals.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    block : ndarray of int, shape (m,)
        Group of each point.
    offset : bool
        Whether the walls may lie apart by the same distance everywhere.
    frame : ndarray of int, shape (m,), or None, optional
        Frame that each moving point was seen in.

    Returns
    -------
    GroupedResiduals or None
        Residuals and what they depend on; None if the pose brings no group near the surface.

    Raises
    ------
    InputError
        If the fixed cloud has no normals.
    """
    pairs = closest_pairs(moving_mm, target, fixed_T_moving[None])
    if pairs.normals is None:
        raise InputError("target: expected normals of the fixed surface to measure along, received none")
    near = near_surface(pairs.gap_mm[0], pairs.aside_mm2[0], target.spacing_mm)
    return averaged(
        pairs.moved_mm[0],
        pairs.normals[0],
        pairs.gap_mm[0],
        near=near,
        block=block,
        offset=offset,
        frame=frame,
    )


def averaged(
    places_mm: Float64[np.ndarray, "m 3"],
    normals: Float64[np.ndarray, "m 3"],
    gap_mm: Float64[np.ndarray, " m"],
    *,
    near: Bool[np.ndarray, " m"],
    block: Int64[np.ndarray, " m"],
    offset: bool,
    frame: Int64[np.ndarray, " m"] | None = None,
) -> GroupedResiduals | None:
    """Average gaps along normals over groups of neighbouring points.

    Parameters
    ----------
    places_mm : ndarray, shape (m, 3)
        Where each gap was measured, in mm.
    normals : ndarray, shape (m, 3)
        Unit normals there.
    gap_mm : ndarray, shape (m,)
        Signed distance along the normal that would close the gap, in mm.
    near : ndarray of bool, shape (m,)
        Whether the point is one of the surface.
    block : ndarray of int, shape (m,)
        Group of each point.
    offset : bool
        Whether the walls may lie apart by the same distance everywhere.
    frame : ndarray of int, shape (m,), or None, optional
        Frame that each point was seen in.

    Returns
    -------
    GroupedResiduals or None
        Averages; None if no group has enough points near the surface.
    """
    count = np.bincount(block[near], minlength=int(block.max()) + 1)
    # The last group is one for all points that do not count.
    kept = count >= MIN_POINTS
    near = near & kept[block]
    if not near.any():
        return None
    group = (np.cumsum(kept) - 1)[block[near]]
    places_mm, normals, gap_mm = places_mm[near], normals[near], gap_mm[near]
    centre_mm = places_mm.mean(axis=0)
    radius_mm = float(np.sqrt(((places_mm - centre_mm) ** 2).sum(axis=1).mean()))
    jacobian = motion_jacobian((places_mm - centre_mm) / radius_mm, normals)
    if offset:
        jacobian = with_offset(jacobian)
    mean = _Means(group, count[kept])
    mean_gap_mm = mean(gap_mm[:, None])[:, 0]
    return GroupedResiduals(
        centre_mm=centre_mm,
        radius_mm=radius_mm,
        points_mm=mean(places_mm),
        normals=mean(normals),
        gap_mm=mean_gap_mm,
        jacobian=mean(jacobian),
        shared_frames=None if frame is None else _shared_frames(group, frame[near], count[kept]),
        share=float(near.mean()),
        noise_mm=float(np.sqrt(((gap_mm - mean_gap_mm[group]) ** 2).mean())),
        group_points=float(count[kept].mean()),
    )


def groups_on(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    groups: int,
) -> Int64[np.ndarray, " m"]:
    """Divide points into groups that are compact where their closest fixed points lie.

    By the moving points' own place a group would be one of points that noise has brought to the same side.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    target : TreeTarget
        Fixed cloud.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    groups : int
        Number of groups, rounded to a power of two.

    Returns
    -------
    ndarray of int, shape (m,)
        Group of each point.
    """
    return blocks_of(target.points_mm[target.closest(transforms.apply(fixed_T_moving, moving_mm))], groups)


def near_surface(
    gap_mm: Float64[np.ndarray, " m"], aside_mm2: Float64[np.ndarray, " m"], spacing_mm: float
) -> Bool[np.ndarray, " m"]:
    """Tell which points are points of the surface: neither outliers nor beyond its end.

    Parameters
    ----------
    gap_mm : ndarray, shape (m,)
        Signed distance of each point along the normal of the closest one, in mm.
    aside_mm2 : ndarray, shape (m,)
        Its squared distance across that normal in mm².
    spacing_mm : float
        Distance in mm between the surface's points.

    Returns
    -------
    ndarray of bool, shape (m,)
        Whether each is.
    """
    away_mm = np.abs(gap_mm - np.median(gap_mm))
    cut_mm = min(FARTHEST_MM, max(OUTLIER_SIGMA * MEDIAN_TO_SIGMA * float(np.median(away_mm)), MIN_CUT_MM))
    return np.asarray((away_mm <= cut_mm) & (aside_mm2 <= (ASIDE_SPACINGS * spacing_mm) ** 2))


@dataclass(frozen=True)
class _Means:
    """Mean of the rows of each group."""

    group: np.ndarray
    count: np.ndarray

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        summed = [np.bincount(self.group, column, len(self.count)) for column in rows.T]
        return np.stack(summed, axis=1) / self.count[:, None]


def _shared_frames(group: np.ndarray, frame: np.ndarray, count: np.ndarray) -> np.ndarray:
    _, number = np.unique(frame, return_inverse=True)
    seen = np.zeros((len(count), int(number.max()) + 1))
    np.add.at(seen, (group, number.reshape(-1)), 1.0)
    seen /= count[:, None]
    return seen @ seen.T
