import sys

import numpy as np
import pytest

from models.metrics import boundaries
from models.metrics.boundaries import (
    Boundary,
    boundary_elements,
    boundary_pixels,
    crop_to_union,
    distances_between,
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


def test_distances_are_those_to_the_nearest_both_ways() -> None:
    there, back = distances_between(points((0, 0), (0, 10), (0, 20)), points((3, 4), (0, 11)))
    assert there.tolist() == [5.0, 1.0, 9.0] and back.tolist() == [5.0, 1.0]


def test_nothing_is_infinitely_far_away() -> None:
    there, back = distances_between(points((1, 1)), points())
    assert there.tolist() == [np.inf] and back.tolist() == []
    there, back = distances_between(points(), points((1, 1)))
    assert there.tolist() == [] and back.tolist() == [np.inf]


def test_all_ways_of_finding_the_nearest_agree(monkeypatch) -> None:
    rng = np.random.default_rng(0)
    start, end = (Boundary(rng.normal(size=(n, 2)), np.ones(n)) for n in (3000, 2500))
    assert len(start) * len(end) > boundaries.TABLE_ENTRIES
    by_tree = distances_between(start, end)
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    in_blocks = distances_between(start, end)
    monkeypatch.setattr(boundaries, "TABLE_ENTRIES", 10**8)
    by_table = distances_between(start, end)
    for expected, *others in zip(by_tree, in_blocks, by_table, strict=True):
        for other in others:
            np.testing.assert_allclose(other, expected, rtol=1e-12)
