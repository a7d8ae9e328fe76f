"""Inscribed spheres of a tube."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from tubes import straight, tube

from registration.centerline.medial_axis import MedialAxis, mean_radius_mm, medial_axis, sample_evenly
from registration.centerline.vessel_walls import Walls
from registration.errors import InputError
from registration.geometry.mesh_topology import borders, with_caps
from registration.geometry.shapes import Mesh

LINE_MM = straight(40.0)
CLOSED = with_caps(tube(LINE_MM, 4.0), borders(tube(LINE_MM, 4.0)), 5)


@pytest.fixture(scope="module")
def axis() -> MedialAxis:
    return medial_axis(CLOSED, Walls(CLOSED, CLOSED), 4.0)


def test_large_spheres_lie_on_the_axis_and_touch_the_wall(axis: MedialAxis) -> None:
    large = axis.radius_mm > 3.9
    assert large.sum() > 50
    apart_mm = cKDTree(LINE_MM).query(axis.centres_mm[large])[0]
    assert np.percentile(apart_mm, 95) < 0.45
    distance_mm = Walls(CLOSED, CLOSED).distance_mm(axis.centres_mm)
    assert np.median(np.abs(distance_mm - axis.radius_mm)) < 0.06


def test_spheres_in_the_rim_of_a_cap_are_not_main(axis: MedialAxis) -> None:
    main = axis.is_main()
    assert axis.radius_mm[main].min() > 3.3
    way = (LINE_MM[-1] - LINE_MM[0]) / 40
    place_mm = (axis.centres_mm[main] - LINE_MM[0]) @ way
    # The last sphere that fills the tube lies a radius before the cap.
    assert place_mm.min() == pytest.approx(4.0, abs=0.6)
    assert place_mm.max() == pytest.approx(36.0, abs=0.6)


def test_the_cost_is_length_over_radius(axis: MedialAxis) -> None:
    pairs, cost = axis.apart_mm.tocoo(), axis.cost.tocoo()
    one, other = pairs.row[7], pairs.col[7]
    apart_mm = np.linalg.norm(axis.centres_mm[one] - axis.centres_mm[other])
    assert pairs.data[7] == pytest.approx(max(apart_mm, 1e-9))
    mean = 0.5 * (1 / axis.radius_mm[one] + 1 / axis.radius_mm[other])
    assert cost.data[7] == pytest.approx(pairs.data[7] * mean)


def test_long_triangles_get_points_and_dense_ones_lose_some() -> None:
    coarse = tube(straight(40.0)[::10], 4.0)
    points_mm = sample_evenly(coarse, 4.0)
    asked_mm = coarse.sample(2000, np.random.default_rng(0))
    assert cKDTree(points_mm).query(asked_mm)[0].max() < 0.3 * 4.0
    dense = tube(straight(40.0, 0.05), 4.0, around=16)
    assert len(sample_evenly(dense, 4.0)) < 0.5 * len(dense.vertices_mm)


def test_a_wall_of_very_many_points_is_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    dense = tube(straight(40.0, 0.1), 4.0, around=128)
    many = len(sample_evenly(dense, 4.0))
    monkeypatch.setattr("registration.centerline.medial_axis.MAX_POINTS", many // 4)
    few = sample_evenly(dense, 4.0)
    assert 0.1 * many < len(few) <= many // 4
    asked_mm = dense.sample(2000, np.random.default_rng(0))
    assert cKDTree(few).query(asked_mm)[0].max() < 1.6


def test_shortcuts_across_a_grid_and_none_past_a_wall() -> None:
    y, x = np.mgrid[:20, :20]
    centres_mm = np.stack([x.ravel(), y.ravel(), np.zeros(400)], axis=1).astype(float)
    number = np.arange(400).reshape(20, 20)
    links = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    others = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    graph = csr_array((np.ones(len(links)), (links, others)), shape=(400, 400))
    along = dijkstra(graph, directed=False, indices=0)[-1]
    assert along == 38
    wide = MedialAxis(centres_mm, np.full(400, 4.0), graph)
    assert dijkstra(wide.shortcuts_mm, directed=False, indices=0)[-1] == pytest.approx(19 * np.sqrt(2))
    # Spheres that do not overlap by half are no way past each other.
    narrow = MedialAxis(centres_mm, np.full(400, 1.5), graph)
    assert dijkstra(narrow.shortcuts_mm, directed=False, indices=0)[-1] == 38


def test_mean_radius_of_a_tube_and_of_nothing() -> None:
    long = with_caps(tube(straight(400.0), 4.0, 64), borders(tube(straight(400.0), 4.0, 64)))
    assert mean_radius_mm(long) == pytest.approx(4.0, rel=0.03)
    flat = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="surface: expected one around a volume"):
        mean_radius_mm(flat)
