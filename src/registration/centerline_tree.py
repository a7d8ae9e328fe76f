"""Which way the vessels go: end points found on a medial axis, and the cheapest path from one of them to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from registration.errors import InputError
from registration.medial_axis import SCALE, MedialAxis
from registration.mesh_topology import Border


@dataclass(frozen=True)
class Tip:
    """Where a vessel ends: a sphere, ``node``, and the exact end where that is known (an open end, a given point)."""

    node: int
    point_mm: Float64[np.ndarray, "3"] | None = None


@dataclass(frozen=True)
class Path:
    """A rough way through a vessel: ``points_mm`` (p, 3), from the source to a tip, and ``width_mm``, its radius.

    The radius is the median of the spheres on the way.
    """

    points_mm: Float64[np.ndarray, "p 3"]
    width_mm: float


def find_tips(axis: MedialAxis, ends: tuple[Border, ...], branch_reach: float) -> tuple[Tip, ...]:
    """Find all ends of a vessel tree, the widest first.

    Every open end is one. More are found one after another, the farthest first, among the main spheres that lie more
    than ``branch_reach`` radii from every path so far (the tree-structure extraction of Sato et al., Pacific Graphics
    2000, on spheres in place of voxels). Raises InputError where fewer than two ends are found.
    """
    free = axis.is_main()
    tips = [Tip(_node_in(axis, end), end.centre_mm) for end in ends]
    if not tips:
        middle = int(axis.radius_mm.argmax())
        tips.append(Tip(_farthest(axis, free, _lengths_mm(axis, middle))))
    before, away_mm = _predecessors(axis, tips[0].node), _lengths_mm(axis, tips[0].node)
    tree = cKDTree(axis.centres_mm)
    for tip in tips:
        _cover(axis, tree, _walk(before, tip.node), branch_reach, free)
    while free.any():
        tips.append(Tip(_farthest(axis, free, away_mm)))
        _cover(axis, tree, _walk(before, tips[-1].node), branch_reach, free)
    if len({tip.node for tip in tips}) < 2:
        raise InputError(f"surface: expected a vessel longer than wide, received one with {len(tips)} end")
    return tuple(sorted(tips, key=lambda tip: -_width_mm(axis, tip)))


def given_tips(axis: MedialAxis, ends_mm: Float64[np.ndarray, "k 3"]) -> tuple[Tip, ...]:
    """The ends that the caller knows, the source first: the sphere nearest to each."""
    nodes = cKDTree(axis.centres_mm).query(ends_mm)[1]
    return tuple(Tip(int(node), end_mm) for node, end_mm in zip(nodes, ends_mm, strict=True))


def paths_from(axis: MedialAxis, tips: tuple[Tip, ...]) -> tuple[Path, ...]:
    """The cheapest path from the first tip to each of the others."""
    source = tips[0]
    before = _predecessors(axis, source.node)
    paths = []
    for tip in tips[1:]:
        nodes = _walk(before, tip.node)
        parts = [axis.centres_mm[nodes]]
        if source.point_mm is not None:
            parts.insert(0, source.point_mm[None])
        if tip.point_mm is not None:
            parts.append(tip.point_mm[None])
        paths.append(Path(np.concatenate(parts), float(np.median(axis.radius_mm[nodes]))))
    return tuple(paths)


def _node_in(axis: MedialAxis, end: Border) -> int:
    """The sphere that fills an open end: near its centre, and neither small nor larger than the end."""
    apart_mm = np.linalg.norm(axis.centres_mm - end.centre_mm, axis=1)
    return int((np.minimum(axis.radius_mm, end.radius_mm) - apart_mm).argmax())


def _farthest(axis: MedialAxis, allowed: Bool[np.ndarray, "n"], away_mm: Float64[np.ndarray, "n"]) -> int:
    """The sphere where the vessel ends, near the one farthest away of those allowed.

    In a flat vessel that one lies towards a corner of the cap. Growing spheres count more than way gained, as for
    ``MedialAxis.is_main``.
    """
    last = int(np.where(allowed, away_mm, -1.0).argmax())
    apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[last], axis=1)
    near = allowed & (apart_mm <= 2 * axis.radius_mm[last])
    return int(np.where(near, away_mm + SCALE * axis.radius_mm, -1.0).argmax())


def _lengths_mm(axis: MedialAxis, node: int) -> Float64[np.ndarray, "n"]:
    found: np.ndarray = dijkstra(axis.apart_mm, directed=False, indices=node)
    return found


def _predecessors(axis: MedialAxis, node: int) -> Int64[np.ndarray, "n"]:
    found: np.ndarray = dijkstra(axis.cost, directed=False, indices=node, return_predecessors=True)[1]
    return found.astype(np.int64)


def _walk(before: Int64[np.ndarray, "n"], node: int) -> Int64[np.ndarray, "p"]:
    nodes = [node]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1], dtype=np.int64)


def _cover(
    axis: MedialAxis,
    tree: cKDTree,
    nodes: Int64[np.ndarray, "p"],
    branch_reach: float,
    free: Bool[np.ndarray, "n"],
) -> None:
    """Strike out of ``free`` every node within ``branch_reach`` radii of a path."""
    for found in tree.query_ball_point(axis.centres_mm[nodes], branch_reach * axis.radius_mm[nodes]):
        free[found] = False


def _width_mm(axis: MedialAxis, tip: Tip) -> float:
    """How wide the vessel is at a tip: the widest sphere within two radii of it."""
    apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[tip.node], axis=1)
    return float(axis.radius_mm[apart_mm <= 2 * axis.radius_mm[tip.node]].max())
