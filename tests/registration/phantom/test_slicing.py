"""Masks of cut surfaces against shapes whose section is known by formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.geometry.shapes import Mesh
from registration.phantom.slicing import cut, mask_of_plane, rasterise, section

SPACING_MM = 0.05
SIZE_PX = 400


def tube(radius_x_mm: float, radius_y_mm: float, half_length_mm: float = 40.0, sides: int = 720) -> Mesh:
    """A closed elliptic prism along z whose corners lie on the ellipse."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([radius_x_mm * np.cos(angle), radius_y_mm * np.sin(angle)])
    bottom = np.column_stack([ring, np.full(sides, -half_length_mm)])
    top = np.column_stack([ring, np.full(sides, half_length_mm)])
    ends = np.array([[0, 0, -half_length_mm], [0, 0, half_length_mm]])
    own = np.arange(sides)
    following = (own + 1) % sides
    triangles = np.concatenate(
        [
            np.column_stack([own, following, following + sides]),
            np.column_stack([own, following + sides, own + sides]),
            np.column_stack([following, own, np.full(sides, 2 * sides)]),
            np.column_stack([own + sides, following + sides, np.full(sides, 2 * sides + 1)]),
        ]
    )
    return Mesh(np.concatenate([bottom, top, ends]).astype(float), triangles.astype(np.int64))


def image_plane(rotation: Rotation, centre_mm: tuple[float, float, float]) -> np.ndarray:
    """mesh_A_pixel of a picture whose middle lies at ``centre_mm``."""
    middle = 0.5 * (SIZE_PX - 1)
    scale = np.diag([SPACING_MM, SPACING_MM, 1.0, 1.0])
    scale[:2, 3] = -middle * SPACING_MM
    return transforms.from_rotation(rotation, np.array(centre_mm)) @ scale


def inside_ellipse(mesh_A_pixel: np.ndarray, radius_x_mm: float, radius_y_mm: float) -> np.ndarray:
    """Signed distance-like test at each pixel centre, in mm of the smaller radius."""
    rows, columns = np.mgrid[:SIZE_PX, :SIZE_PX].astype(float)
    pixels = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).reshape(-1, 3)
    places_mm = transforms.apply(mesh_A_pixel, pixels)
    scaled = np.hypot(places_mm[:, 0] / radius_x_mm, places_mm[:, 1] / radius_y_mm)
    return ((scaled - 1.0) * min(radius_x_mm, radius_y_mm)).reshape(SIZE_PX, SIZE_PX)


@pytest.mark.parametrize(("radius_x_mm", "radius_y_mm"), [(4.0, 4.0), (6.0, 3.0)])
@pytest.mark.parametrize(
    ("angles_deg", "centre_mm"),
    [
        ((0, 0, 0), (0.0, 0.0, 0.0)),
        ((35, 0, 20), (1.0, -0.7, 3.0)),
        ((-50, 25, 110), (-2.0, 1.5, -6.0)),
        ((180, 0, 0), (0.3, 0.0, 0.0)),
    ],
)
def test_tube_cut_by_any_plane_is_right_to_a_tenth_of_a_millimetre(
    radius_x_mm: float, radius_y_mm: float, angles_deg: tuple, centre_mm: tuple
) -> None:
    mesh_A_pixel = image_plane(Rotation.from_euler("xyz", angles_deg, degrees=True), centre_mm)
    mask = mask_of_plane(tube(radius_x_mm, radius_y_mm), np.linalg.inv(mesh_A_pixel), SIZE_PX, SIZE_PX)
    outside_mm = inside_ellipse(mesh_A_pixel, radius_x_mm, radius_y_mm)
    assert mask.sum() > 1000
    # Far tighter than a tenth of a millimetre: no pixel more than 1 micrometre off the border is wrong.
    assert mask[outside_mm < -1e-3].all()
    assert not mask[outside_mm > 1e-3].any()


def test_a_plane_beside_the_surface_shows_nothing() -> None:
    mesh_A_pixel = image_plane(Rotation.identity(), (0.0, 0.0, 41.0))
    assert not mask_of_plane(tube(4, 4), np.linalg.inv(mesh_A_pixel), SIZE_PX, SIZE_PX).any()


def test_vertices_exactly_in_the_plane_leave_no_gap() -> None:
    # The octahedron's equator lies in the plane: its section is the square |x| + |y| <= 1.
    vertices = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    upper = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    lower = np.array([[1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]])
    segments = cut(vertices, np.concatenate([upper, lower]))
    mask = rasterise(segments * 10 + 15, 31, 31)
    rows, columns = np.mgrid[:31, :31] - 15
    away = np.abs(rows) + np.abs(columns)
    assert mask[away < 10].all()
    assert not mask[away > 10].any()


def square(low: float, high: float, turn: int = 1) -> np.ndarray:
    corners = np.array([[low, low], [high, low], [high, high], [low, high]])[::turn]
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def test_square_fills_the_pixels_whose_centres_it_holds() -> None:
    mask = rasterise(square(1.5, 4.5), 8, 7)
    expected = np.zeros((8, 7), dtype=bool)
    expected[2:5, 2:5] = True
    np.testing.assert_array_equal(mask, expected)


def test_overlapping_loops_give_their_union_and_an_opposite_one_a_hole() -> None:
    union = rasterise(np.concatenate([square(0.5, 4.5), square(2.5, 6.5)]), 8, 8)
    assert union[3, 3]
    assert union.sum() == 16 + 16 - 4
    hole = rasterise(np.concatenate([square(0.5, 6.5), square(2.5, 4.5, turn=-1)]), 8, 8)
    assert not hole[3, 3]
    assert hole.sum() == 36 - 4


def test_loops_that_leave_the_picture_are_clipped() -> None:
    mask = rasterise(square(-10.0, 2.5), 5, 6)
    expected = np.zeros((5, 6), dtype=bool)
    expected[:3, :3] = True
    np.testing.assert_array_equal(mask, expected)
    assert rasterise(square(-10.0, 20.0), 5, 6).all()
    assert not rasterise(np.empty((0, 2, 2)), 5, 6).any()


def test_section_of_a_tube_has_its_area_and_middle() -> None:
    vertices = tube(6.0, 3.0).vertices_mm + np.array([2.0, -1.5, 0.0])
    area_mm2, centre_mm = section(cut(vertices, tube(6.0, 3.0).triangles))
    assert area_mm2 == pytest.approx(np.pi * 18, rel=1e-3)
    assert centre_mm == pytest.approx((2.0, -1.5), abs=1e-6)
    assert section(np.empty((0, 2, 2))) == (0.0, (0.0, 0.0))
