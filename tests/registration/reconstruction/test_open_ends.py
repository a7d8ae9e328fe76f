"""Cutting a surface off where the points it was made from end."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.mesh_topology import borders, connected, directed_edges, with_caps
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Mesh
from registration.reconstruction.open_ends import (
    _Surroundings,
    beyond_mm,
    clip,
    measured_part,
    vertex_normals,
)

LINE_MM = straight(40.0, 0.5)
WAY = (LINE_MM[-1] - LINE_MM[0]) / 40
WHOLE = tube(LINE_MM, 4.0, around=48)


def measured(first_mm: float, last_mm: float) -> OrientedCloud:
    place_mm = (WHOLE.vertices_mm - LINE_MM[0]) @ WAY
    kept = (place_mm >= first_mm - 1e-6) & (place_mm <= last_mm + 1e-6)
    return OrientedCloud(WHOLE.vertices_mm[kept], vertex_normals(WHOLE)[kept])


def test_a_clip_cuts_triangles_on_the_line() -> None:
    place_mm = (WHOLE.vertices_mm - LINE_MM[0]) @ WAY
    part = clip(WHOLE, place_mm, 12.3)
    assert ((part.vertices_mm - LINE_MM[0]) @ WAY).max() == pytest.approx(12.3)
    found = mesh_quality(part)
    assert (found.manifold, found.oriented, found.open_ends, found.pieces) == (True, True, 2, 1)
    per_mm = WHOLE.areas_mm2.sum() / 40
    assert part.areas_mm2.sum() == pytest.approx(12.3 * per_mm)
    other = clip(WHOLE, -place_mm, -12.3)
    assert part.areas_mm2.sum() + other.areas_mm2.sum() == pytest.approx(WHOLE.areas_mm2.sum())


def test_a_clip_of_one_triangle_by_hand() -> None:
    one = Mesh(np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    corner = clip(one, np.array([-1.0, 1, 1]))
    assert corner.areas_mm2.tolist() == [0.5]
    rest = clip(one, np.array([1.0, -1, -1]))
    assert rest.areas_mm2.sum() == pytest.approx(1.5)
    np.testing.assert_allclose(np.cross(*np.diff(rest.corners_mm[0], axis=0))[2] > 0, True)


def test_how_far_past_the_last_points() -> None:
    past_mm = beyond_mm(WHOLE, measured(10.0, 30.0), 3.0)
    place_mm = (WHOLE.vertices_mm - LINE_MM[0]) @ WAY
    for truth_mm in (10 - place_mm, place_mm - 30):
        near = np.abs(truth_mm) < 2
        np.testing.assert_allclose(past_mm[near], truth_mm[near], atol=0.1)
    assert (past_mm[(place_mm > 12) & (place_mm < 28)] < -1).all()
    assert (past_mm[(place_mm < 6) | (place_mm > 34)] == 3).all()


def test_a_closed_tube_is_opened_at_its_ends_alone() -> None:
    closed = with_caps(WHOLE, borders(WHOLE), 8)
    part = measured_part(closed, measured(0.0, 40.0), 3.0)
    found = mesh_quality(part)
    assert (found.open_ends, found.holes) == (2, 0)
    assert part.areas_mm2.sum() == pytest.approx(WHOLE.areas_mm2.sum(), rel=0.02)


def test_gaps_are_bridged_up_to_the_width_given_and_not_beyond() -> None:
    ends = [measured(0.0, 15.0), measured(19.0, 40.0)]
    gapped = OrientedCloud(
        np.concatenate([part.points_mm for part in ends]), np.concatenate([part.normals for part in ends])
    )
    assert mesh_quality(measured_part(WHOLE, gapped, 4.5)).pieces == 1
    assert mesh_quality(measured_part(WHOLE, gapped, 1.5)).pieces == 2


def test_a_hole_in_a_wall_stays_closed_if_small() -> None:
    cloud = measured(0.0, 40.0)
    apart_mm = np.linalg.norm(cloud.points_mm - WHOLE.vertices_mm[48 * 40], axis=1)
    punched = OrientedCloud(cloud.points_mm[apart_mm > 2], cloud.normals[apart_mm > 2])
    assert (beyond_mm(WHOLE, punched, 1.5) > 0).any()
    # The hole's radius is 2 mm: with a bridge of 1.5 mm it is too wide.
    assert mesh_quality(measured_part(WHOLE, punched, 1.5)).holes == 1
    assert mesh_quality(measured_part(WHOLE, punched, 3.0)).holes == 0


def test_wall_that_was_not_measured_up_to_the_border_of_the_mesh_is_cut() -> None:
    """A strip of 14 of 48 columns is not measured, from one open end of the tube to the other."""
    seen = np.arange(len(WHOLE.vertices_mm)) % 48 >= 14
    cloud = OrientedCloud(WHOLE.vertices_mm[seen], vertex_normals(WHOLE)[seen])
    found = measured_part(WHOLE, cloud, 1.5)
    assert found.areas_mm2.sum() == pytest.approx(33 / 48 * WHOLE.areas_mm2.sum(), rel=0.02)


def test_holes_near_each_other_are_judged_as_if_each_were_the_only_one() -> None:
    """Some overlap in what lies around them, some are too wide, and both ends of the tube are ends."""
    random = np.random.default_rng(0)
    radius_mm = random.uniform(0.4, 1.6, 60)
    centres_mm = WHOLE.vertices_mm[random.choice(np.arange(480, 3400), 60, replace=False)]
    apart_mm = np.linalg.norm(WHOLE.vertices_mm[:, None] - centres_mm, axis=2) - radius_mm
    place_mm = (WHOLE.vertices_mm - LINE_MM[0]) @ WAY
    past_mm = np.maximum((-apart_mm).max(axis=1), np.maximum(4.2 - place_mm, place_mm - 36.1))
    edges = directed_edges(WHOLE)
    piece = connected(edges[(past_mm > 0)[edges].all(axis=1)], len(past_mm))[1]
    pieces = [np.flatnonzero((piece == number) & (past_mm > 0)) for number in np.unique(piece[past_mm > 0])]
    around = _Surroundings(WHOLE, edges)
    together = around.holes(pieces, past_mm, 0.9)
    assert together.tolist() == [bool(around.holes([own], past_mm, 0.9)[0]) for own in pieces]
    assert 2 < together.sum() < len(together) - 2
    ends = [number for number, own in enumerate(pieces) if {0, len(past_mm) - 1} & set(own.tolist())]
    assert len(ends) == 2 and not together[ends].any()


def test_a_vertex_of_no_triangle_changes_nothing() -> None:
    cloud = measured(5.0, 35.0)
    stray = Mesh(np.concatenate([WHOLE.vertices_mm, [[50.0, 0.0, 0.0]]]), WHOLE.triangles)
    with_it, without = measured_part(stray, cloud, 2.0), measured_part(WHOLE, cloud, 2.0)
    assert np.array_equal(with_it.corners_mm, without.corners_mm)


def test_vertex_normals_of_a_tube() -> None:
    radial = WHOLE.vertices_mm - np.repeat(LINE_MM, 48, axis=0)
    assert np.einsum("vi,vi->v", vertex_normals(WHOLE), radial / 4).min() > 0.99
