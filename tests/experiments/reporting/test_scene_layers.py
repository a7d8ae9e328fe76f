"""What a layer puts into a page: the numbers themselves, in the types that the page stores."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vessels import bent_tube

from experiments.errors import InputError
from experiments.reporting.scene_layers import CloudLayer, LineLayer, SurfaceLayer
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.metrics.surface_distance import surface_residuals

TUBE = bent_tube()
HEIGHTS_MM = TUBE.vertices_mm[:, 2]


def places(trace: Any) -> np.ndarray:
    assert {trace[axis].dtype for axis in "xyz"} == {np.dtype(np.float32)}
    return np.stack([trace[axis] for axis in "xyz"], axis=1)


def shown_mesh(trace: Any) -> Mesh:
    corners = np.stack([trace[axis] for axis in "ijk"], axis=1)
    return Mesh(places(trace).astype(np.float64), corners.astype(np.int64))


def test_a_small_surface_is_shown_unchanged() -> None:
    trace = SurfaceLayer("vessel", TUBE, color="#123456", opacity=0.3).trace(len(TUBE.triangles))
    np.testing.assert_array_equal(places(trace), TUBE.vertices_mm.astype(np.float32))
    np.testing.assert_array_equal(shown_mesh(trace).triangles, TUBE.triangles)
    assert (trace["type"], trace["name"], trace["color"], trace["opacity"]) == (
        "mesh3d",
        "vessel",
        "#123456",
        0.3,
    )
    assert (trace["showlegend"], trace["visible"]) == (True, True)
    assert trace["intensity"] is None


def test_more_than_65536_vertices_keep_their_numbers() -> None:
    count = 70_000
    vertices_mm = np.random.default_rng(0).random((count, 3))
    trace = SurfaceLayer("v", Mesh(vertices_mm, np.array([[0, 1, count - 1]]))).trace(10)
    assert shown_mesh(trace).triangles.tolist() == [[0, 1, count - 1]]


def test_values_colour_a_surface() -> None:
    trace = SurfaceLayer("vessel", TUBE, values_mm=HEIGHTS_MM).trace(10**6)
    np.testing.assert_array_equal(trace["intensity"], HEIGHTS_MM.astype(np.float32))
    assert trace["coloraxis"] == "coloraxis"
    assert trace["color"] is None


@pytest.mark.parametrize("max_size", [2000, 600])
def test_a_large_surface_is_decimated_with_its_values(max_size: int) -> None:
    # 5120 triangles: up to four times the wanted number by edges alone, beyond by cubes first.
    trace = SurfaceLayer("vessel", TUBE, values_mm=HEIGHTS_MM).trace(max_size)
    fewer = shown_mesh(trace)
    assert 0.3 * max_size < len(fewer.triangles) <= max_size
    apart = surface_residuals(fewer, TUBE, np.eye(4), inlier_mm=1.0, keep=1.0)
    assert apart.hd95_mm < 0.8
    values = trace["intensity"]
    assert len(values) == len(fewer.vertices_mm)
    np.testing.assert_allclose(values, fewer.vertices_mm[:, 2], atol=2.0)


def test_a_cloud_is_decimated_to_points_of_it() -> None:
    layer = CloudLayer("cloud", TUBE.vertices_mm, values_mm=HEIGHTS_MM, size_px=3.0)
    trace = layer.trace(500)
    found = places(trace)
    assert len(found) == 500
    known = {tuple(row) for row in TUBE.vertices_mm.astype(np.float32).tolist()}
    assert {tuple(row) for row in found.tolist()} <= known
    np.testing.assert_array_equal(trace["marker"]["color"], found[:, 2])
    assert (trace["mode"], trace["marker"]["size"], trace["marker"]["coloraxis"]) == (
        "markers",
        3.0,
        "coloraxis",
    )
    assert layer.trace(500) == trace
    plain = CloudLayer("cloud", TUBE.vertices_mm, color="#abcdef", shown=False).trace(10**6)
    np.testing.assert_array_equal(places(plain), TUBE.vertices_mm.astype(np.float32))
    assert (plain["marker"]["color"], plain["visible"]) == ("#abcdef", "legendonly")


def test_lines_are_kept_apart_and_carry_their_radius() -> None:
    first = Polyline(np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 2]]), np.array([3.0, 2.5, 2.0]))
    second = Polyline(np.array([[5.0, 0, 0], [6, 0, 0]]), np.array([1.0, 0.5]))
    trace = LineLayer.of("centerline", Centerline((first, second)), dash="dash").trace(100)
    found = places(trace)
    np.testing.assert_array_equal(np.isnan(found).all(axis=1), [False, False, False, True, False, False])
    np.testing.assert_array_equal(found[[0, 2, 4, 5]], [[0, 0, 0], [0, 0, 2], [5, 0, 0], [6, 0, 0]])
    np.testing.assert_array_equal(trace["customdata"], [3.0, 2.5, 2.0, np.nan, 1.0, 0.5])
    assert (trace["mode"], trace["line"]["dash"], trace["line"]["coloraxis"]) == (
        "lines",
        "dash",
        "coloraxis2",
    )
    # The gap has the colour of the smallest radius, so that it does not widen the scale.
    np.testing.assert_array_equal(trace["line"]["color"], [3.0, 2.5, 2.0, 0.5, 1.0, 0.5])
    plain = LineLayer("path", [first.points_mm], color="#111111").trace(100)
    assert (plain["customdata"], plain["line"]["color"]) == (None, "#111111")


def test_a_centerline_is_shown_at_its_pose() -> None:
    line = Centerline((Polyline(np.array([[0.0, 0, 0], [0, 0, 1]]), np.ones(2)),))
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    np.testing.assert_array_equal(LineLayer.of("c", line.transformed(pose)).points_mm, [[1, 2, 3], [1, 2, 4]])


def test_a_long_line_keeps_its_ends() -> None:
    line = np.column_stack([np.arange(1000.0), np.zeros(1000), np.zeros(1000)])
    found = places(LineLayer("path", [line]).trace(100))
    assert len(found) <= 101
    assert (found[0, 0], found[-1, 0]) == (0, 999)


def test_points_and_sizes() -> None:
    points_mm = np.array([[1.0, -2, 3], [4, 5, -6]])
    for layer, size, unit in (
        (CloudLayer("c", points_mm), 2, "points"),
        (LineLayer("l", [points_mm[:1], points_mm[1:]]), 2, "points of lines"),
        (SurfaceLayer("s", TUBE), len(TUBE.triangles), "triangles"),
    ):
        assert (layer.size, layer.unit, layer.has_values, layer.has_radii) == (size, unit, False, False)
    assert LineLayer("l", [points_mm], radius_mm=[np.ones(2)]).has_radii
    np.testing.assert_array_equal(LineLayer("l", [points_mm[:1], points_mm[1:]]).points_mm, points_mm)
    assert SurfaceLayer("s", TUBE).points_mm is TUBE.vertices_mm


@pytest.mark.parametrize(
    "make, message",
    [
        (
            lambda: SurfaceLayer("s", TUBE, opacity=0.0),
            "opacity: expected more than 0 and at most 1, received 0.0",
        ),
        (
            lambda: SurfaceLayer("s", Mesh(np.eye(3), np.empty((0, 3), dtype=np.int64))),
            "s: expected a mesh with tri",
        ),
        (lambda: SurfaceLayer("s", TUBE, values_mm=np.zeros(3)), "s: expected 2562 finite values, received"),
        (lambda: SurfaceLayer("s", TUBE, values_mm=np.full(2562, np.nan)), "s: expected 2562 finite values"),
        (lambda: CloudLayer("c", np.empty((0, 3))), "c: expected points, received none"),
        (lambda: CloudLayer("c", np.full((4, 3), np.nan)), "c: expected finite points"),
        (
            lambda: CloudLayer("c", np.zeros((4, 2))),
            r"c: expected finite points \(n, 3\), received .*\(4, 2\)",
        ),
        (lambda: LineLayer("l", []), "l: expected lines with points, received none"),
        (lambda: LineLayer("l", [np.eye(3)], radius_mm=[np.ones(2)]), "l: expected one radius a point"),
    ],
)
def test_layers_that_can_not_be_shown_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
