"""Ends of a vessel tree: points farthest from its source on branches that are long enough to count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import minimum_spanning_tree

from registration.centerline.medial_axis import MedialAxis


@dataclass(frozen=True)
class BranchEnd:
    """End of a branch: a sphere from which all paths lead back to the source.

    Parameters
    ----------
    node : int
        The sphere.
    marked : tuple of int
        Those of the marked spheres that lie on its branch.
    """

    node: int
    marked: tuple[int, ...]


def branch_ends(
    axis: MedialAxis,
    main: Bool[np.ndarray, " n"],
    away_mm: Float64[np.ndarray, " n"],
    reach: float,
    marked: Int64[np.ndarray, " k"],
) -> tuple[BranchEnd, ...]:
    """Find the ends of all branches as persistent maxima of the distance from the source.

    Parameters
    ----------
    axis : MedialAxis
        Inscribed spheres of the vessel.
    main : ndarray of bool, shape (n,)
        Spheres that may be ends (``MedialAxis.is_main``).
    away_mm : ndarray, shape (n,)
        Distance of each sphere from the source along the vessel in mm.
    reach : float
        Smallest length of a branch in radii of its last sphere or of the vessel where it leaves, whichever is
        larger.
    marked : ndarray of int, shape (k,)
        Spheres whose branch is asked for, such as those in openings.

    Returns
    -------
    tuple of BranchEnd
        The ends, the farthest first; none where the vessel is not longer than wide.

    Notes
    -----
    What lies beyond a distance from the source falls into parts. Lowering the distance lets parts grow and
    meet; of two that meet, the one that reaches less far is a branch of the other. Its length is measured
    from the place where they meet; a shorter one is a bump in a wall, a corner of a flat vessel or a blob
    attached to it.

    References
    ----------
    H. Edelsbrunner, D. Letscher and A. Zomorodian, Discrete Comput. Geom. 28, 2002.
    """
    # For each part, by its root: its farthest main sphere (or none, -1) and the marked nodes in it.
    top = np.where(main, np.arange(len(main)), -1).tolist()
    held = {int(node): [int(node)] for node in marked}
    owner = list(range(len(top)))
    found = []
    for one, other, level_mm in _meetings(axis, away_mm):
        high, low = _root(owner, one), _root(owner, other)
        if top[low] >= 0 and (top[high] < 0 or away_mm[top[low]] > away_mm[top[high]]):
            high, low = low, high
        passed = held.pop(low, [])
        if top[low] >= 0 and _is_branch(axis, main, top[low], one, away_mm[top[low]] - level_mm, reach):
            found.append(BranchEnd(top[low], tuple(passed)))
        elif passed:
            held[high] = held.get(high, []) + passed
        owner[low] = high
    last = _root(owner, 0)
    source = int(away_mm.argmin())
    if _is_branch(axis, main, top[last], source, away_mm[top[last]], reach):
        found.append(BranchEnd(top[last], tuple(held.get(last, []))))
    return tuple(sorted(found, key=lambda branch_end: -away_mm[branch_end.node]))


def _meetings(axis: MedialAxis, away_mm: Float64[np.ndarray, " n"]) -> list[tuple[int, int, float]]:
    """The links by which parts meet, the farthest first: a spanning tree, each with the distance of its nearer end."""
    links = axis.apart_mm.tocoo()
    level_mm = np.minimum(away_mm[links.row], away_mm[links.col])
    top_mm = float(away_mm.max()) + 1.0
    tree = minimum_spanning_tree(
        csr_array((top_mm - level_mm, (links.row, links.col)), shape=links.shape)
    ).tocoo()
    order = np.argsort(tree.data, kind="stable")
    row, column, level_mm = tree.row[order], tree.col[order], top_mm - tree.data[order]
    nearer = np.where(away_mm[row] <= away_mm[column], row, column)
    return list(zip(nearer.tolist(), (row + column - nearer).tolist(), level_mm.tolist(), strict=True))


def _root(owner: list[int], node: int) -> int:
    while owner[node] != node:
        owner[node] = owner[owner[node]]
        node = owner[node]
    return node


def _is_branch(
    axis: MedialAxis,
    main: Bool[np.ndarray, " n"],
    branch_end: int,
    meeting: int,
    reach_mm: float,
    reach: float,
) -> bool:
    if reach_mm < reach * max(axis.radius_mm[branch_end], axis.radius_mm[meeting]):
        return False
    apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[meeting], axis=1)
    around = main & (apart_mm <= axis.radius_mm)
    return bool(reach_mm >= reach * axis.radius_mm[around].max(initial=0.0))
