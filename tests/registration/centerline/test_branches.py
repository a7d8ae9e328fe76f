"""Ends and paths on spheres that are placed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from registration.centerline.branches import Endpoint, find_endpoints, given_endpoints, paths_from
from registration.centerline.medial_axis import MedialAxis
from registration.errors import InputError
from registration.geometry.mesh_topology import Border


def axis_of(centres_mm: np.ndarray, radius_mm: np.ndarray, links: list[tuple[int, int]]) -> MedialAxis:
    first, second = np.array(links).T
    lengths_mm = np.linalg.norm(centres_mm[first] - centres_mm[second], axis=1)
    graph = csr_array((lengths_mm, (first, second)), shape=(len(centres_mm),) * 2)
    return MedialAxis(centres_mm, radius_mm, graph)


def fork() -> MedialAxis:
    """A trunk of 0 to 30 along z with radius 4, then one branch to +x (radius 3) and one to -x (radius 2)."""
    trunk = np.stack([np.zeros(31), np.zeros(31), np.arange(31.0)], axis=1)
    away = np.arange(1, 21.0)
    right = np.stack([away, np.zeros(20), 30 + away], axis=1)
    left = right * [-1, 1, 1]
    hair = np.array([[1.5, 0, 10.0], [3.0, 0, 10.0]])
    centres_mm = np.concatenate([trunk, right, left, hair])
    radius_mm = np.concatenate([np.full(31, 4.0), np.full(20, 3.0), np.full(20, 2.0), [2.4, 0.9]])
    links = [(i, i + 1) for i in range(30)] + [(30, 31)] + [(i, i + 1) for i in range(31, 50)]
    links += [(30, 51)] + [(i, i + 1) for i in range(51, 70)] + [(10, 71), (71, 72)]
    return axis_of(centres_mm, radius_mm, links)


def test_tips_of_a_fork_the_widest_first_and_no_hair() -> None:
    endpoints = find_endpoints(fork(), (), 1.5)
    assert [endpoint.node for endpoint in endpoints] == [0, 50, 70]
    assert all(endpoint.point_mm is None for endpoint in endpoints)


def test_paths_follow_the_spheres_from_the_source() -> None:
    axis = fork()
    right, left = paths_from(axis, find_endpoints(axis, (), 1.5))
    assert len(right.points_mm) == len(left.points_mm) == 51
    np.testing.assert_allclose(right.points_mm[:31], left.points_mm[:31])
    np.testing.assert_allclose(left.points_mm[-1], [-20, 0, 50])
    assert (right.width_mm, left.width_mm) == (4.0, 4.0)


def test_a_wide_way_is_cheaper_than_a_short_one() -> None:
    centres_mm = np.array([[0.0, 0, 0], [10, 0, 0], [5, 5, 0], [5, 0, 0]])
    axis = axis_of(centres_mm, np.array([4.0, 4, 4, 1]), [(0, 2), (2, 1), (0, 3), (3, 1)])
    (path,) = paths_from(axis, (Endpoint(0), Endpoint(1)))
    np.testing.assert_allclose(path.points_mm, centres_mm[[0, 2, 1]])


def test_an_open_end_is_a_tip_and_the_path_runs_to_its_middle() -> None:
    axis = fork()
    end = Border(np.empty((0, 2), dtype=np.int64), np.array([0.0, 0, -2]), np.array([0.0, 0, -1]), 4.0, 0.0)
    endpoints = find_endpoints(axis, (end,), 1.5)
    assert len(endpoints) == 3
    np.testing.assert_allclose(paths_from(axis, endpoints)[0].points_mm[0], [0, 0, -2])


def test_an_opening_away_from_all_ends_is_none() -> None:
    axis = fork()
    middle = Border(np.empty((0, 2), dtype=np.int64), np.array([0.0, 0, 15]), np.array([1.0, 0, 0]), 2.0, 0.0)
    # A cut-off stub, as wide as it is long, and a hole: the trunk's foot, and the two branches, are the ends.
    endpoints = find_endpoints(axis, (middle,), 1.5)
    assert [endpoint.node for endpoint in endpoints] == [0, 50, 70]
    assert all(endpoint.point_mm is None for endpoint in endpoints)


def test_the_widest_of_two_openings_at_an_end_is_it() -> None:
    axis = fork()
    around = [
        Border(
            np.empty((0, 2), dtype=np.int64), np.array([0.0, 0, z]), np.array([0.0, 0, -1]), radius_mm, 0.0
        )
        for z, radius_mm in ((-1.0, 3.5), (-2.0, 4.0))
    ]
    endpoints = find_endpoints(axis, tuple(around), 1.5)
    assert len(endpoints) == 3
    np.testing.assert_allclose(endpoints[0].point_mm, [0, 0, -2])


def test_paths_say_which_ends_are_closed() -> None:
    axis = fork()
    end = Border(np.empty((0, 2), dtype=np.int64), np.array([0.0, 0, -2]), np.array([0.0, 0, -1]), 4.0, 0.0)
    assert [path.closed for path in paths_from(axis, find_endpoints(axis, (end,), 1.5))] == [
        (False, True)
    ] * 2
    assert [path.closed for path in paths_from(axis, find_endpoints(axis, (), 1.5))] == [(True, True)] * 2


def test_given_ends_take_the_order_given() -> None:
    axis = fork()
    endpoints = given_endpoints(axis, np.array([[20.0, 0, 50.5], [0, 0, -0.5]]))
    assert [endpoint.node for endpoint in endpoints] == [50, 0]
    (path,) = paths_from(axis, endpoints)
    np.testing.assert_allclose(path.points_mm[[0, -1]], [[20, 0, 50.5], [0, 0, -0.5]])


def test_a_ball_has_no_way() -> None:
    ball = axis_of(np.array([[0.0, 0, 0], [0.1, 0, 0]]), np.array([5.0, 5.0]), [(0, 1)])
    with pytest.raises(InputError, match="surface: expected a vessel longer than wide"):
        find_endpoints(ball, (), 1.5)
