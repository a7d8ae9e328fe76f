"""Arrays in the binary form of plotly.js, and surfaces with fewer triangles."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from tubes import straight, tube

from experiments.reporting.scene_data import bounds_of, packed, packed_index, packed_places, thinned
from registration.geometry.mesh_topology import borders
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import surface_residuals

TUBE = tube(straight(40.0, 0.4), 4.0, around=64)


def test_bytes_are_those_of_the_numbers_lowest_first() -> None:
    assert packed(np.array([1.0, -2.0]), "f4") == {
        "dtype": "f4",
        "bdata": base64.b64encode(b"\x00\x00\x80\x3f\x00\x00\x00\xc0").decode(),
    }
    assert packed_index(np.array([1, 65535]))["dtype"] == "u2"
    assert packed_index(np.array([1, 65536])) == {
        "dtype": "u4",
        "bdata": base64.b64encode(b"\x01\x00\x00\x00\x00\x00\x01\x00").decode(),
    }
    assert sorted(packed_places(np.zeros((2, 3)))) == ["x", "y", "z"]
    np.testing.assert_array_equal(bounds_of(np.array([[1.0, 5, 3], [2, 4, 9]])), [[1, 4, 3], [2, 5, 9]])


@pytest.mark.parametrize("most", [6000, 2000])
def test_an_open_tube_keeps_its_shape_and_its_ends(most: int) -> None:
    # 12800 triangles: the second choice is past what is done edge by edge.
    thin, values = thinned(TUBE, None, most)
    assert values is None
    assert 0.3 * most < len(thin.triangles) <= most
    apart = surface_residuals(thin, TUBE, np.eye(4), inlier_mm=1.0, keep=1.0)
    assert apart.hd95_mm < 0.3
    assert sum(border.is_end for border in borders(thin)) == 2


def test_a_mesh_that_is_small_enough_stays_as_it_is() -> None:
    values = np.arange(len(TUBE.vertices_mm), dtype=np.float64)
    same, kept = thinned(TUBE, values, len(TUBE.triangles))
    assert same is TUBE and kept is values


def test_values_come_from_where_they_were() -> None:
    thin, values = thinned(Mesh(TUBE.vertices_mm, TUBE.triangles), TUBE.vertices_mm[:, 0], 2000)
    assert values is not None
    np.testing.assert_allclose(values, thin.vertices_mm[:, 0], atol=0.5)
