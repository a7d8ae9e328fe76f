"""The fixed cloud without its noise: a smooth surface through it, whose normals point out of the vessel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration.rigid.icp.correspondence import TreeTarget, principal_axes, search_tree

# How often neighbours vote on which side of a wall is outside.
VOTES = 2
VOTERS = 12
# A cloud whose noise is more than this share of the reach is too rough for so few neighbours: normals tilt, and the
# bend no longer tells which side is outside. It is smoothed over so many times as many.
ROUGH, ROUGH_FACTOR = 0.25, 2
# On a rough cloud the middle of so many times as many neighbours lies inside the vessel.
INSIDE_FACTOR = 3
# A quadric through scattered points is held flat by this share of what the points say.
FLATTENING = 1e-6


@dataclass(frozen=True)
class Smoothed:
    """Smooth surface next to given points.

    Parameters
    ----------
    points_mm : ndarray, shape (m, 3)
        Points on the surface in mm.
    normals : ndarray, shape (m, 3)
        Unit normals there.
    bend_per_mm : ndarray, shape (m,)
        Half the sum of both curvatures in 1/mm, positive where the surface bends towards its normal.
    reach_mm : float
        Distance in mm over which the smoothing reaches.
    noise_mm : float
        Root mean square distance in mm of the fixed points from the surface.
    """

    points_mm: Float64[np.ndarray, "m 3"]
    normals: Float64[np.ndarray, "m 3"]
    bend_per_mm: Float64[np.ndarray, " m"]
    reach_mm: float
    noise_mm: float


def smoothed_at(
    target: TreeTarget,
    points_mm: Float64[np.ndarray, "m 3"],
    neighbours: int,
    normals: Float64[np.ndarray, "m 3"] | None = None,
) -> Smoothed:
    """Fit the smooth surface next to each point.

    A quadric is fitted to the fixed points around each given one (moving least squares): it removes the noise
    and preserves the curvature.

    Parameters
    ----------
    target : TreeTarget
        Fixed cloud.
    points_mm : ndarray, shape (m, 3)
        Points in mm.
    neighbours : int
        Number of fixed points around each.
    normals : ndarray, shape (m, 3) or None, optional
        Directions along which heights are measured; None takes the direction of least spread.

    Returns
    -------
    Smoothed
        The surface at each point.

    References
    ----------
    M. Alexa et al., IEEE TVCG 9(1), 2003.
    """
    patches_mm, away_mm = target.patches(points_mm, neighbours)
    axes = principal_axes(patches_mm) if normals is None else _upright(normals)
    height_mm, one, two = np.moveaxis((patches_mm - points_mm[:, None]) @ axes, 2, 0)
    terms = np.stack([np.ones_like(one), one, two, one * one, one * two, two * two], axis=2)
    across = np.swapaxes(terms, 1, 2)
    equations = across @ terms
    # Patches that lie on a line leave the quadric open across it; the flattest one is taken.
    equations += FLATTENING * np.trace(equations, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    fitted = np.linalg.solve(equations, across @ height_mm[..., None])[..., 0]
    slopes = np.stack([np.ones(len(axes)), -fitted[:, 1], -fitted[:, 2]], axis=1)
    normals = (axes @ slopes[..., None])[..., 0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Smoothed(
        points_mm + fitted[:, :1] * axes[:, :, 0],
        normals,
        fitted[:, 3] + fitted[:, 5],
        float(np.median(away_mm[:, -1])),
        float(np.sqrt(((height_mm - (terms @ fitted[..., None])[..., 0]) ** 2).mean())),
    )


class SmoothedTarget(TreeTarget):
    """Fixed cloud without its noise: every point moved onto the smooth surface through its neighbours.

    Normals point to the side that a vessel's wall bends away from, which is outwards. ``reach_mm`` is the
    distance in mm over which the smoothing reaches.

    Parameters
    ----------
    exact : TreeTarget
        Fixed cloud.
    neighbours : int
        Number of neighbours that are smoothed over.
    rough : bool, optional
        Whether noise hides on which side the wall bends: outside is then away from the middle of more neighbours.
    """

    def __init__(self, exact: TreeTarget, neighbours: int, rough: bool = False) -> None:
        smoothed = smoothed_at(exact, exact.points_mm, neighbours, exact.normals)
        self.points_mm, self.reach_mm = smoothed.points_mm, smoothed.reach_mm
        self.is_rough: bool = smoothed.noise_mm > ROUGH * smoothed.reach_mm
        self._tree = search_tree(self.points_mm)
        self._around = None
        if rough:
            middle_mm = exact.patches(self.points_mm, INSIDE_FACTOR * neighbours)[0].mean(axis=1)
            away = np.einsum("nk,nk->n", self.points_mm - middle_mm, smoothed.normals)
            side = np.where(away < 0, -1.0, 1.0)
        else:
            side = _sides(smoothed.normals, smoothed.bend_per_mm, exact.neighbours_of(VOTERS))
        self.outward: np.ndarray = smoothed.normals * side[:, None]
        self.normals = self.outward


def outward_targets(
    points_mm: Float64[np.ndarray, "n 3"], neighbours: int, smoothing: int
) -> tuple[TreeTarget, SmoothedTarget]:
    """Prepare a cloud of a vessel's wall as it is and smoothed, the normals of both outwards.

    A cloud that is rough over so few neighbours is smoothed over more.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    neighbours : int
        Number of neighbours for the normals of the exact cloud.
    smoothing : int
        Number of neighbours that are smoothed over.

    Returns
    -------
    exact : TreeTarget
        Cloud as it is.
    smoothed : SmoothedTarget
        Cloud without its noise.
    """
    exact = TreeTarget(points_mm, neighbours, smoothing)
    smoothed = SmoothedTarget(exact, smoothing)
    if smoothed.is_rough:
        exact = TreeTarget(points_mm, ROUGH_FACTOR * neighbours, ROUGH_FACTOR * smoothing)
        smoothed = SmoothedTarget(exact, ROUGH_FACTOR * smoothing, rough=True)
    exact.face_like(smoothed.outward)
    return exact, smoothed


def _sides(
    normals: Float64[np.ndarray, "n 3"],
    bend_per_mm: Float64[np.ndarray, " n"],
    index: Int64[np.ndarray, "n k"],
) -> Float64[np.ndarray, " n"]:
    """1 where the normal points outwards, -1 where inwards.

    Where a wall is flat or a saddle, as in the crotch of a fork, its own bend does not tell: each point follows the
    vote of its neighbours, who count as much as they bend.
    """
    side = np.where(bend_per_mm > 0, -1.0, 1.0)
    for _ in range(VOTES):
        alike = np.sign(np.einsum("nk,njk->nj", normals, normals[index]))
        vote = (alike * (side * np.abs(bend_per_mm))[index]).sum(axis=1)
        side = np.where(vote < 0, -1.0, 1.0)
    return side


def _upright(normals: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3 3"]:
    """A frame for each normal, in columns, the normal first."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    one = np.cross(normals, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([normals, one, np.cross(normals, one)], axis=2)
