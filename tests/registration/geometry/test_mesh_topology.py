"""Borders, pieces and caps of meshes drawn by hand."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.mesh_topology import (
    borders,
    keep_triangles,
    largest_piece,
    pieces,
    row_numbers,
    with_caps,
)
from registration.geometry.shapes import Mesh

TETRAHEDRON = Mesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices_mm for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def test_a_closed_mesh_has_no_border() -> None:
    assert borders(TETRAHEDRON) == ()


def test_the_border_of_a_missing_face() -> None:
    (border,) = borders(keep_triangles(TETRAHEDRON, np.array([False, True, True, True])))
    # The missing face looks down and has the area 1/2.
    np.testing.assert_allclose(border.normal, [0, 0, -1], atol=1e-12)
    assert border.radius_mm == pytest.approx(np.sqrt(0.5 / np.pi))
    assert len(border.edges) == 3
    # Edges of 1, 1 and sqrt 2, their middles weighted by length.
    np.testing.assert_allclose(border.centre_mm, [(0.5 + np.sqrt(0.5)) / (2 + np.sqrt(2))] * 2 + [0])


def test_ends_of_a_tube_are_ends_and_a_hole_in_its_wall_is_none() -> None:
    line_mm = straight()
    whole = tube(line_mm, 4.0)
    middle_mm = whole.corners_mm.mean(axis=1)
    hole = np.linalg.norm(middle_mm - middle_mm[len(middle_mm) // 4], axis=1) < 1.5
    found = borders(keep_triangles(whole, ~hole))
    assert [border.is_end for border in found] == [True, True, False]
    assert abs(found[0].facing) < 0.05
    assert found[2].facing > 0.9
    ends_mm = np.array([border.centre_mm for border in found[:2]])
    ends_mm = ends_mm[np.argsort(ends_mm[:, 2])]
    np.testing.assert_allclose(ends_mm, line_mm[[0, -1]], atol=1e-9)
    for border in found[:2]:
        outwards = border.centre_mm - line_mm.mean(axis=0)
        assert outwards @ border.normal > 0.99 * np.linalg.norm(outwards)


def test_a_tube_wound_inwards_has_ends_all_the_same() -> None:
    whole = tube(straight(), 4.0)
    assert all(border.is_end for border in borders(Mesh(whole.vertices_mm, whole.triangles[:, ::-1].copy())))


@pytest.mark.parametrize("rings", [1, 4])
def test_caps_close_a_tube(rings: int) -> None:
    whole = tube(straight(40.0), 4.0, around=64)
    capped = with_caps(whole, borders(whole), rings)
    assert borders(capped) == ()
    section_mm2 = 0.5 * 64 * np.sin(2 * np.pi / 64) * 16
    assert enclosed_volume_mm3(capped) == pytest.approx(40 * section_mm2, rel=1e-6)
    assert capped.areas_mm2.sum() == pytest.approx(whole.areas_mm2.sum() + 2 * section_mm2)


def test_pieces_and_the_largest_of_them() -> None:
    small = Mesh(TETRAHEDRON.vertices_mm + 5, TETRAHEDRON.triangles)
    large = Mesh(3 * TETRAHEDRON.vertices_mm - 9, TETRAHEDRON.triangles)
    both = joined(small, large)
    count, of_triangle = pieces(both)
    assert count == 2
    assert len(set(of_triangle[:4])) == len(set(of_triangle[4:])) == 1
    np.testing.assert_allclose(largest_piece(both).vertices_mm, large.vertices_mm)
    assert largest_piece(large) is large


def test_a_rough_meshs_borders_are_judged_by_the_two_rings_around_each() -> None:
    whole = tube(straight(30.0), 4.0, around=24)
    mesh = keep_triangles(whole, np.random.default_rng(0).random(len(whole.triangles)) > 0.05)
    found = borders(mesh)
    assert len(found) > 20
    for border in found:
        near = np.zeros(len(mesh.vertices_mm), dtype=bool)
        near[border.edges] = True
        near[mesh.triangles[near[mesh.triangles].any(axis=1)]] = True
        a, b, c = np.moveaxis(mesh.corners_mm[near[mesh.triangles].any(axis=1)], 1, 0)
        walls = np.cross(b - a, c - a)
        assert border.facing == pytest.approx(
            (walls @ border.normal).sum() / np.linalg.norm(walls, axis=1).sum()
        )


@pytest.mark.parametrize("scale", [1, 2**20, 2**40])
def test_rows_are_numbered_as_they_are_sorted(scale: int) -> None:
    rows = np.random.default_rng(0).integers(-3, 4, (200, 3)) * scale
    numbers = row_numbers(rows)
    expected, first, owner, counts = np.unique(
        rows, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    found = np.unique(numbers, return_index=True, return_inverse=True, return_counts=True)
    np.testing.assert_array_equal(rows[found[1]], expected)
    np.testing.assert_array_equal(found[1], first)
    np.testing.assert_array_equal(found[2], owner.reshape(-1))
    np.testing.assert_array_equal(found[3], counts)


def test_no_rows_have_no_numbers() -> None:
    assert row_numbers(np.zeros((0, 3), dtype=np.int64)).shape == (0,)
