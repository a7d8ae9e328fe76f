import sys

import numpy as np
import pytest

from models.boundaries import (
    Boundary,
    boundary_elements,
    boundary_pixels,
    crop_to_union,
    nearest_distances,
)

RING = np.array(
    [
        [0, 0, 0, 0, 0],
        [0, 1, 1, 1, 0],
        [0, 1, 1, 1, 0],
        [0, 1, 1, 1, 0],
        [0, 0, 0, 0, 0],
    ],
    dtype=bool,
)


def test_crop_frames_the_union_and_keeps_both_where_they_were() -> None:
    first, second = np.zeros((2, 20, 30), bool)
    first[4, 6], second[7, 2] = True, True
    cropped = crop_to_union(first, second)
    assert cropped[0].shape == (6, 7)
    assert np.argwhere(cropped[0]).tolist() == [[1, 5]]
    assert np.argwhere(cropped[1]).tolist() == [[4, 1]]


def test_crop_of_nothing_has_no_boundary() -> None:
    for mask in crop_to_union(np.zeros((4, 4), bool), np.zeros((4, 4), bool)):
        assert len(boundary_pixels(mask, (1.0, 1.0))) == len(boundary_elements(mask, (1.0, 1.0))) == 0


def test_boundary_pixels_of_a_square_are_all_but_its_middle() -> None:
    boundary = boundary_pixels(RING, (2.0, 0.5))
    # Rows and columns count from the frame's inner corner, so the square begins at 0.
    expected = [(r * 2.0, c * 0.5) for r in range(3) for c in range(3) if (r, c) != (1, 1)]
    assert boundary.points.tolist() == [list(point) for point in expected]


def test_elements_of_a_pixel_are_the_four_sides_of_a_diamond() -> None:
    mask = np.zeros((3, 3), bool)
    mask[1, 1] = True
    boundary = boundary_elements(mask, (3.0, 4.0))
    assert boundary.lengths.tolist() == [2.5] * 4  # half the diagonal of a 3 x 4 pixel


def test_elements_of_a_rectangle_have_its_sides_less_the_cut_corners() -> None:
    mask = np.zeros((6, 8), bool)
    mask[1:5, 1:7] = True  # 4 rows, 6 columns
    lengths = boundary_elements(mask, (3.0, 4.0)).lengths
    assert sorted(set(lengths)) == [2.5, 3.0, 4.0]
    assert lengths.sum() == pytest.approx(2 * 3 * 3.0 + 2 * 5 * 4.0 + 4 * 2.5)


def test_opposite_corners_count_twice() -> None:
    mask = np.zeros((4, 4), bool)
    mask[1, 1] = mask[2, 2] = True
    lengths = boundary_elements(mask, (3.0, 4.0)).lengths
    assert sorted(lengths) == [2.5] * 6 + [5.0]


def points(*rows: tuple[float, float]) -> Boundary:
    return Boundary(np.array(rows, dtype=np.float64).reshape(-1, 2), np.ones(len(rows)))


def test_nearest_distances_are_those_to_the_nearest() -> None:
    start, end = points((0, 0), (0, 10)), points((3, 4), (0, 11))
    assert nearest_distances(start, end).tolist() == [5.0, 1.0]
    assert nearest_distances(end, start).tolist() == [5.0, 1.0]


def test_nothing_is_infinitely_far_away() -> None:
    assert nearest_distances(points((1, 1)), points()).tolist() == [np.inf]
    assert nearest_distances(points(), points((1, 1))).tolist() == []


def test_distances_without_scipy_are_the_same(monkeypatch) -> None:
    rng = np.random.default_rng(0)
    start, end = (Boundary(rng.normal(size=(n, 2)), np.ones(n)) for n in (3000, 2500))
    expected = nearest_distances(start, end)
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    np.testing.assert_allclose(nearest_distances(start, end), expected, rtol=1e-12)
