"""Vessel surfaces against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.phantom.designed_shapes import DESIGNS, SKIN_Y_MM
from registration.phantom.shapes import (
    VesselLine,
    implicit_mm,
    outward,
    signed_volume_mm3,
    spline_line,
    surround,
)


def straight(radius_mm: float, widening: float = 1.0, length_mm: float = 20.0) -> VesselLine:
    return spline_line(np.array([[0, 0, 0], [0, 0, length_mm]]), np.full(2, radius_mm), widening)


def is_closed(mesh: Mesh) -> bool:
    edges = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges.tolist()}
    return len(directed) == len(edges) and all((b, a) in directed for a, b in directed)


def test_capsule_has_the_volume_and_radius_it_was_designed_with() -> None:
    mesh = surround((straight(4.0),), pitch_mm=0.3)
    expected_mm3 = np.pi * 16 * 20 + 4 / 3 * np.pi * 64
    assert signed_volume_mm3(mesh) == pytest.approx(expected_mm3, rel=0.01)
    middle = mesh.vertices_mm[np.abs(mesh.vertices_mm[:, 2] - 10) < 8]
    np.testing.assert_allclose(np.linalg.norm(middle[:, :2], axis=1), 4.0, atol=0.02)


def test_flat_section_is_an_ellipse() -> None:
    mesh = surround((straight(3.0, 1.6),), pitch_mm=0.3)
    middle = mesh.vertices_mm[np.abs(mesh.vertices_mm[:, 2] - 10) < 6]
    np.testing.assert_allclose(np.hypot(middle[:, 0] / 4.8, middle[:, 1] / 3.0), 1.0, atol=0.01)


def test_implicit_function_is_the_distance_to_a_circular_tube() -> None:
    points_mm = np.array([[0, 0, 10], [3, 0, 10], [0, 5.5, 4], [-4, 0, 12.0]])
    np.testing.assert_allclose(implicit_mm(straight(4.0), points_mm), [-4, -1, 1.5, 0], atol=5e-3)


def test_spline_is_sampled_evenly_and_passes_its_controls() -> None:
    controls_mm = np.array([[0, 0, 0], [5, 2, 10], [0, -3, 20], [4, 0, 30]], dtype=float)
    line = spline_line(controls_mm, np.array([2.0, 3.0, 2.5, 2.0]))
    steps_mm = np.linalg.norm(np.diff(line.points_mm, axis=0), axis=1)
    np.testing.assert_allclose(steps_mm, steps_mm.mean(), rtol=0.01)
    for control_mm in controls_mm:
        assert np.linalg.norm(line.points_mm - control_mm, axis=1).min() < 0.06
    assert line.radius_mm[np.linalg.norm(line.points_mm - controls_mm[1], axis=1).argmin()] == pytest.approx(
        3.0, abs=0.02
    )


@pytest.mark.parametrize("name", list(DESIGNS))
def test_designs_are_closed_surfaces_in_one_piece_below_the_skin(name: str) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lines = DESIGNS[name]()
    mesh = surround(lines)
    assert is_closed(mesh)
    assert signed_volume_mm3(mesh) > 0
    first, second = mesh.triangles[:, 0], mesh.triangles[:, 1]
    links = coo_array((np.ones(len(first)), (first, second)), shape=(len(mesh.vertices_mm),) * 2)
    assert connected_components(links, directed=False)[0] == 1
    assert mesh.vertices_mm[:, 1].min() > SKIN_Y_MM + 3


@pytest.mark.parametrize("name", list(DESIGNS))
def test_designed_radius_is_met_on_the_surface(name: str) -> None:
    """Every surface point lies on the section of one of the lines, except in the rounded crotch and in overlaps."""
    lines = DESIGNS[name]()
    mesh = surround(lines)
    nearest_mm = np.min([implicit_mm(line, mesh.vertices_mm) for line in lines], axis=0)
    assert np.percentile(np.abs(nearest_mm), 90) < 0.02
    assert nearest_mm.max() < 0.3


def test_inverted_triangles_are_turned_over() -> None:
    mesh = surround((straight(3.0, length_mm=6.0),), pitch_mm=0.6)
    flipped = Mesh(mesh.vertices_mm, mesh.triangles[:, ::-1].copy())
    assert signed_volume_mm3(flipped) == pytest.approx(-signed_volume_mm3(mesh))
    assert signed_volume_mm3(outward(flipped)) == pytest.approx(signed_volume_mm3(mesh))


def test_bad_lines_are_refused() -> None:
    with pytest.raises(InputError, match="two points"):
        spline_line(np.zeros((1, 3)), np.ones(1))
    with pytest.raises(InputError, match="positive radii"):
        VesselLine(np.zeros((2, 3)), np.array([1.0, -1.0]), np.ones(2))
