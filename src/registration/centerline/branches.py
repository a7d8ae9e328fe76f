"""Which way the vessels go: end points found on a medial axis, and the cheapest path from one of them to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from registration.centerline.endpoints import branch_ends
from registration.centerline.medial_axis import SCALE, MedialAxis
from registration.errors import InputError
from registration.geometry.mesh_topology import Border


@dataclass(frozen=True)
class Endpoint:
    """Where a vessel ends: a sphere, ``node``, and the exact end where that is known (an open end, a given point)."""

    node: int
    point_mm: Float64[np.ndarray, "3"] | None = None


@dataclass(frozen=True)
class Path:
    """A rough way through a vessel: ``points_mm`` (p, 3), from the source to a tip, and ``width_mm``, its radius.

    The radius is the median of the spheres on the way. ``closed`` says of both ends whether the vessel is closed there
    and the path stops at the last sphere that fills it.
    """

    points_mm: Float64[np.ndarray, "p 3"]
    width_mm: float
    closed: tuple[bool, bool] = (False, False)


def find_endpoints(axis: MedialAxis, ends: tuple[Border, ...], branch_reach: float) -> tuple[Endpoint, ...]:
    """Find all ends of a vessel tree, the widest first.

    One is the sphere farthest from the widest of all; the others are the ``summits`` of the length of the way from
    there, where a branch counts from ``branch_reach`` radii on. An end is exact where an opening is beside it, no
    farther off than ``branch_reach`` of the opening's radii; other openings are none. Raises InputError where fewer
    than two ends are found.
    """
    main = axis.is_main()
    openings = {_node_in(axis, end): end for end in sorted(ends, key=lambda end: end.radius_mm)}
    from_middle_mm = _lengths_mm(axis, int(axis.radius_mm.argmax()))
    source = int(np.where(main, from_middle_mm, -1.0).argmax())
    away_mm = _lengths_mm(axis, source)
    near = [node for node, end in openings.items() if away_mm[node] <= branch_reach * end.radius_mm]
    endpoints = [_endpoint(openings, near, _last(axis, main, from_middle_mm, source))]
    openings.pop(endpoints[0].node, None)
    for branch_end in branch_ends(
        axis, main, away_mm, branch_reach, np.array(list(openings), dtype=np.int64)
    ):
        before_mm = away_mm[branch_end.node] - away_mm
        near = [
            node for node in branch_end.marked if before_mm[node] <= branch_reach * openings[node].radius_mm
        ]
        endpoints.append(_endpoint(openings, near, _last(axis, main, away_mm, branch_end.node)))
    if len({endpoint.node for endpoint in endpoints}) < 2:
        raise InputError(
            f"surface: expected a vessel longer than wide, received one with {len(endpoints)} end"
        )
    return tuple(sorted(endpoints, key=lambda endpoint: -_width_mm(axis, endpoint)))


def _endpoint(openings: dict[int, Border], near: list[int], closed: int) -> Endpoint:
    """The widest of the openings ``near`` an end, or the last sphere of a closed one."""
    if not near:
        return Endpoint(closed)
    node = max(near, key=lambda one: openings[one].radius_mm)
    return Endpoint(node, openings[node].centre_mm)


def given_endpoints(axis: MedialAxis, ends_mm: Float64[np.ndarray, "k 3"]) -> tuple[Endpoint, ...]:
    """The ends that the caller knows, the source first: the sphere nearest to each."""
    nodes = cKDTree(axis.centres_mm).query(ends_mm)[1]
    return tuple(Endpoint(int(node), end_mm) for node, end_mm in zip(nodes, ends_mm, strict=True))


def paths_from(axis: MedialAxis, endpoints: tuple[Endpoint, ...]) -> tuple[Path, ...]:
    """The cheapest path from the first tip to each of the others."""
    source = endpoints[0]
    before = _predecessors(axis, source.node)
    paths = []
    for endpoint in endpoints[1:]:
        nodes = _walk(before, endpoint.node)
        parts = [axis.centres_mm[nodes]]
        if source.point_mm is not None:
            parts.insert(0, source.point_mm[None])
        if endpoint.point_mm is not None:
            parts.append(endpoint.point_mm[None])
        closed = (source.point_mm is None, endpoint.point_mm is None)
        paths.append(Path(np.concatenate(parts), float(np.median(axis.radius_mm[nodes])), closed))
    return tuple(paths)


def _node_in(axis: MedialAxis, end: Border) -> int:
    """The sphere that fills an open end: near its centre, and neither small nor larger than the end."""
    apart_mm = np.linalg.norm(axis.centres_mm - end.centre_mm, axis=1)
    return int((np.minimum(axis.radius_mm, end.radius_mm) - apart_mm).argmax())


def _last(
    axis: MedialAxis, main: Bool[np.ndarray, "n"], away_mm: Float64[np.ndarray, "n"], farthest: int
) -> int:
    """The sphere where the vessel ends, step by step from the one farthest away.

    In a flat vessel that one lies towards a corner of the cap. Growing spheres count more than way gained, as for
    ``MedialAxis.is_main``; each step goes at most two radii.
    """
    worth_mm = np.where(main, away_mm + SCALE * axis.radius_mm, -1.0)
    last, best = -1, farthest
    while best != last:
        last = best
        apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[last], axis=1)
        best = int(np.where(apart_mm <= 2 * axis.radius_mm[last], worth_mm, -1.0).argmax())
    return best


def _lengths_mm(axis: MedialAxis, node: int) -> Float64[np.ndarray, "n"]:
    found: np.ndarray = dijkstra(axis.shortcuts_mm, directed=False, indices=node)
    return found


def _predecessors(axis: MedialAxis, node: int) -> Int64[np.ndarray, "n"]:
    found: np.ndarray = dijkstra(axis.cost, directed=False, indices=node, return_predecessors=True)[1]
    return found.astype(np.int64)


def _walk(before: Int64[np.ndarray, "n"], node: int) -> Int64[np.ndarray, "p"]:
    nodes = [node]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1], dtype=np.int64)


def _width_mm(axis: MedialAxis, endpoint: Endpoint) -> float:
    """How wide the vessel is at a tip: the widest sphere within two radii of it."""
    apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[endpoint.node], axis=1)
    return float(axis.radius_mm[apart_mm <= 2 * axis.radius_mm[endpoint.node]].max())
