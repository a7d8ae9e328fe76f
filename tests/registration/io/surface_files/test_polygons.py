"""Polygons checked before they are followed, and cut into triangles."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.io.surface_files.polygons import Polygons, joined

SQUARE = np.array([[0.0, 0, 1], [4, 0, 1], [4, 4, 1], [0, 4, 1], [1, 1, 1]])


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_triangles_stay_as_they_are() -> None:
    found = Polygons(SQUARE, *joined([[0, 1, 2], [2, 3, 0]])).triangles()
    assert found.tolist() == [[0, 1, 2], [2, 3, 0]]


def test_polygons_are_cut_and_lines_left_out() -> None:
    found = Polygons(SQUARE, *joined([[0, 1, 2, 3], [0, 1], [1, 2, 3]])).triangles()
    assert len(found) == 3
    assert area(SQUARE, found) == pytest.approx(16 + 8)


def test_a_concave_polygon_keeps_its_area() -> None:
    """An arrow head: a fan from its first corner would cover 12."""
    found = Polygons(SQUARE, *joined([[1, 4, 3, 0]])).triangles()
    assert area(SQUARE, found) == pytest.approx(4.0)


@pytest.mark.parametrize("wrong", [-1, 5])
def test_corners_that_are_no_points_are_refused(wrong: int) -> None:
    with pytest.raises(InputError, match="triangles: expected indices from 0 to 4, received"):
        Polygons(SQUARE, *joined([[0, 1, 2, wrong]])).triangles()


def test_a_cloud_has_none() -> None:
    assert Polygons(SQUARE).triangles().shape == (0, 3)
