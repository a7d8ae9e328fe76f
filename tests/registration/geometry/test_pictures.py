"""Pictures of clouds for notebooks: valid, small, coloured by the distances that they claim."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from vessels import bent_tube

from registration.geometry.pictures import COLORS, POINTS, Overlay, Stage, surface_picture

TUBE = bent_tube()
# A grid with one point a millimetre, so that a shift by 0.3 mm is the distance of every point to the nearest.
GRID_MM = np.stack(np.meshgrid(np.arange(20.0), np.arange(6.0), np.arange(3.0)), axis=-1).reshape(-1, 3)


def svgs(html: str) -> list[ElementTree.Element]:
    return [ElementTree.fromstring(each) for each in re.findall(r"<svg.*?</svg>", html)]


def test_an_overlay_tells_and_shows_every_stage() -> None:
    overlay = Overlay((Stage("before <b>", GRID_MM + 0.3, GRID_MM), Stage("after", GRID_MM, GRID_MM)))
    assert repr(overlay) == "Overlay(before <b>: RMS 0.52 mm,\n    after: RMS 0.00 mm)"
    drawn = svgs(overlay._repr_html_())
    titles = [each.findtext("{http://www.w3.org/2000/svg}title") for each in drawn]
    assert titles == ["before <b>: RMS 0.52 mm", "after: RMS 0.00 mm"]


def test_colours_go_from_dark_on_the_fixed_points_to_yellow_at_the_end_of_the_scale() -> None:
    near, far = GRID_MM[:60], GRID_MM[60:] + np.array([0.0, 0.0, 0.45])
    (drawn,) = svgs(Overlay((Stage("one", np.concatenate([near, far]), GRID_MM),))._repr_html_())
    paths = drawn.findall(".//{http://www.w3.org/2000/svg}path")
    dots = {path.get("stroke"): (path.get("d") or "").count("M") for path in paths}
    assert dots[COLORS[0]] == 60
    assert dots[COLORS[-1]] == len(GRID_MM) - 60
    assert sum(dots.values()) == 2 * len(GRID_MM)


def test_large_clouds_make_small_pictures() -> None:
    many = np.random.default_rng(0).normal(size=(200_000, 3))
    html = surface_picture("many", many)
    assert html.count("M") <= POINTS + 10
    assert len(html) < 50_000


def test_a_mesh_shows_itself_and_an_empty_one_its_title_alone() -> None:
    (drawn,) = svgs(TUBE._repr_html_())
    title = drawn.findtext("{http://www.w3.org/2000/svg}title")
    assert title == f"{len(TUBE.vertices_mm)} vertices, {len(TUBE.triangles)} triangles"
    assert surface_picture("empty & bare", np.zeros((0, 3))) == "empty &amp; bare"


def test_a_single_place_is_no_division_by_nothing() -> None:
    with np.errstate(all="raise"):
        (drawn,) = svgs(surface_picture("one place", np.ones((5, 3))))
    assert drawn.findall(".//{http://www.w3.org/2000/svg}path")


def test_the_distance_is_that_to_the_nearest_point() -> None:
    stage = Stage(
        "one", np.array([[0.0, 0.0, 3.0], [5.0, 4.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    )
    np.testing.assert_allclose(stage.distance_mm, [3.0, 4.0])
    assert stage.rms_mm == pytest.approx(np.sqrt(12.5))
