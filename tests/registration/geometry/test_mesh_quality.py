"""Meshes with one defect each, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.geometry.mesh_quality import enclosed_volume_mm3, mesh_quality
from registration.geometry.shapes import Mesh

CORNERS_MM = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_a_tetrahedron_is_sound() -> None:
    found = mesh_quality(Mesh(CORNERS_MM, FACES))
    assert (found.watertight, found.manifold, found.oriented) == (True, True, True)
    assert (found.vertices, found.triangles, found.pieces, found.open_ends, found.holes) == (4, 4, 1, 0, 0)
    assert found.volume_mm3 == pytest.approx(1 / 6)
    assert found.area_mm2 == pytest.approx(1.5 + np.sqrt(3) / 2)


def test_a_tetrahedron_inside_out_is_not_oriented() -> None:
    found = mesh_quality(Mesh(CORNERS_MM, FACES[:, ::-1].copy()))
    assert (found.watertight, found.oriented) == (True, False)
    assert found.volume_mm3 == pytest.approx(-1 / 6)


def test_one_turned_face_is_not_oriented() -> None:
    faces = FACES.copy()
    faces[3] = faces[3, ::-1]
    found = mesh_quality(Mesh(CORNERS_MM, faces))
    assert (found.manifold, found.oriented) == (True, False)


def test_three_triangles_at_an_edge_are_no_manifold() -> None:
    corners_mm = np.concatenate([CORNERS_MM, [[1.0, 1, 1]]])
    found = mesh_quality(Mesh(corners_mm, np.concatenate([FACES, [[0, 1, 4]]])))
    assert (found.watertight, found.manifold) == (False, False)


def test_two_bodies_that_meet_in_a_vertex_are_no_manifold() -> None:
    corners_mm = np.concatenate([CORNERS_MM, -CORNERS_MM[1:]])
    other = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    other = np.where(other == 0, 0, other + 3)
    found = mesh_quality(Mesh(corners_mm, np.concatenate([FACES, other])))
    assert (found.watertight, found.manifold) == (True, False)


def test_an_open_tube_has_two_ends_and_the_volume_between_them() -> None:
    found = mesh_quality(tube(straight(40.0), 4.0, around=64))
    assert (found.watertight, found.manifold, found.oriented) == (False, True, True)
    assert (found.open_ends, found.holes) == (2, 0)
    assert found.volume_mm3 == pytest.approx(np.pi * 16 * 40, rel=0.002)


def test_the_volume_does_not_depend_on_the_place() -> None:
    whole = tube(straight(40.0), 4.0)
    far = Mesh(whole.vertices_mm + 500, whole.triangles)
    assert enclosed_volume_mm3(far) == pytest.approx(enclosed_volume_mm3(whole), rel=1e-9)


def test_a_degenerate_triangle_is_counted_and_nothing_is_nothing() -> None:
    assert mesh_quality(Mesh(CORNERS_MM, np.concatenate([FACES, [[0, 1, 1]]]))).degenerate == 1
    empty = mesh_quality(Mesh(CORNERS_MM, np.empty((0, 3), dtype=np.int64)))
    assert (empty.pieces, empty.watertight, empty.volume_mm3) == (0, False, 0.0)


def test_the_aorta_of_vmtk(real_data) -> None:
    from registration.io.surfaces import read_surface

    closed = mesh_quality(read_surface(real_data / "vmtk" / "aorta-surface.stl"))
    assert (closed.watertight, closed.manifold) == (True, True)
    assert abs(closed.volume_mm3) == pytest.approx(13184, rel=1e-4)
    opened = mesh_quality(read_surface(real_data / "vmtk" / "aorta-surface-open-ends.stl"))
    assert (opened.watertight, opened.open_ends, opened.holes) == (False, 3, 0)
