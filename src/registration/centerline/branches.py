"""Endpoints of a vessel tree, found on its medial axis, and the cheapest paths from one to the others."""

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
    """Where a vessel ends.

    Parameters
    ----------
    node : int
        Sphere of the medial axis at the end.
    point_mm : ndarray, shape (3,), or None, optional
        Exact end in mm where it is known (an open end, a given point).
    """

    node: int
    point_mm: Float64[np.ndarray, "3"] | None = None


@dataclass(frozen=True)
class Path:
    """Rough path through a vessel from the source to another endpoint.

    Parameters
    ----------
    points_mm : ndarray, shape (p, 3)
        Points in mm.
    width_mm : float
        Median radius in mm of the spheres on the path.
    closed : tuple of bool, optional
        For both ends, whether the vessel is closed there and the path stops at the last sphere that fills it.
    """

    points_mm: Float64[np.ndarray, "p 3"]
    width_mm: float
    closed: tuple[bool, bool] = (False, False)


def find_endpoints(axis: MedialAxis, ends: tuple[Border, ...], branch_reach: float) -> tuple[Endpoint, ...]:
    """Find all ends of a vessel tree.

    One is the sphere farthest from the widest of all; the others are the ``branch_ends`` of the path lengths
    from there. Openings that no end is near are no ends.

    Parameters
    ----------
    axis : MedialAxis
        Inscribed spheres of the vessel.
    ends : tuple of Border
        Openings of the vessel.
    branch_reach : float
        Length in radii from which on a branch counts, and within which an opening belongs to an end, in its
        own radii.

    Returns
    -------
    tuple of Endpoint
        The endpoints, the widest first.

    Raises
    ------
    InputError
        If there are fewer than two.
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
    """Find the spheres of endpoints that the caller knows.

    Parameters
    ----------
    axis : MedialAxis
        Inscribed spheres of the vessel.
    ends_mm : ndarray, shape (k, 3)
        Ends in mm, the source first.

    Returns
    -------
    tuple of Endpoint
        The ends with the sphere nearest to each, in the same order.
    """
    nodes = cKDTree(axis.centres_mm).query(ends_mm)[1]
    return tuple(Endpoint(int(node), end_mm) for node, end_mm in zip(nodes, ends_mm, strict=True))


def paths_from(axis: MedialAxis, endpoints: tuple[Endpoint, ...]) -> tuple[Path, ...]:
    """Find the cheapest path from the first endpoint to each of the others.

    Parameters
    ----------
    axis : MedialAxis
        Inscribed spheres of the vessel.
    endpoints : tuple of Endpoint
        The source, then the others.

    Returns
    -------
    tuple of Path
        One path for each endpoint but the source.
    """
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
    axis: MedialAxis, main: Bool[np.ndarray, " n"], away_mm: Float64[np.ndarray, " n"], farthest: int
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


def _lengths_mm(axis: MedialAxis, node: int) -> Float64[np.ndarray, " n"]:
    found: np.ndarray = dijkstra(axis.shortcuts_mm, directed=False, indices=node)
    return found


def _predecessors(axis: MedialAxis, node: int) -> Int64[np.ndarray, " n"]:
    found: np.ndarray = dijkstra(axis.cost, directed=False, indices=node, return_predecessors=True)[1]
    return found.astype(np.int64)


def _walk(before: Int64[np.ndarray, " n"], node: int) -> Int64[np.ndarray, " p"]:
    nodes = [node]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1], dtype=np.int64)


def _width_mm(axis: MedialAxis, endpoint: Endpoint) -> float:
    """Radius of the vessel at an endpoint: that of the widest sphere within two radii of it."""
    apart_mm = np.linalg.norm(axis.centres_mm - axis.centres_mm[endpoint.node], axis=1)
    return float(axis.radius_mm[apart_mm <= 2 * axis.radius_mm[endpoint.node]].max())
