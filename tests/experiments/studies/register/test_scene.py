"""What the page of a registration shows, layer by layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plotly_pages import figure_of
from scipy.spatial.transform import Rotation
from tubes import tube

from experiments.studies.register.pair import Pair, Side
from experiments.studies.register.scene import register_scene
from registration import transforms
from registration.geometry.shapes import Centerline, Mesh, Polyline, Surface
from registration.io.landmarks import LandmarkPairs

MIDDLE = np.stack([np.zeros(30), np.zeros(30), np.linspace(0.0, 60.0, 30)], axis=1)
LINE = Centerline((Polyline(MIDDLE, np.full(30, 4.0)),))
TUBE = tube(MIDDLE, 4.0)
TURN = transforms.from_rotation(Rotation.from_euler("x", 90, degrees=True), np.array([0.0, 20.0, 0.0]))


def side(surface: Surface, line: Centerline | None = None) -> Side:
    return Side(Path("own.ply"), surface, "lps", line, None)


def moving(pose: np.ndarray) -> Mesh:
    return Mesh(transforms.apply(transforms.invert_rigid(pose), TUBE.vertices_mm), TUBE.triangles)


def test_before_is_hidden_and_after_has_the_distance_as_its_colour() -> None:
    """Brought over with 0.5 mm too much along x, no vertex is farther than that from the wall, some are."""
    pair = Pair(side(moving(TURN)), side(TUBE, LINE), None, None, ())
    off = transforms.compose(transforms.translation((0.5, 0.0, 0.0)), TURN)
    scene = register_scene(pair, off, "multistart", ["A finding."])
    layers = {layer.name: layer for layer in scene.layers}
    assert list(layers) == ["fixed", "moving, before", "moving, after", "centerline, fixed"]
    assert not layers["moving, before"].shown
    assert layers["moving, after"].shown
    np.testing.assert_allclose(layers["moving, before"].mesh.vertices_mm, moving(TURN).vertices_mm)
    values = layers["moving, after"].values_mm
    assert 0.45 < values.max() < 0.51
    assert values.min() < 0.05
    np.testing.assert_allclose(
        layers["moving, after"].mesh.vertices_mm, TUBE.vertices_mm + np.array([0.5, 0, 0]), atol=1e-9
    )
    assert scene.values_range_mm == pytest.approx((0.0, np.percentile(values, 99)))
    assert scene.notes == ("A finding.",)


def test_landmarks_and_both_centerlines_are_there_when_given() -> None:
    back = transforms.invert_rigid(TURN)
    own = Centerline((Polyline(transforms.apply(back, MIDDLE), np.full(30, 4.0)),))
    marks = TUBE.vertices_mm[[0, 100, 500]]
    pairs = LandmarkPairs(("a", "b", "c"), transforms.apply(back, marks), marks)
    pair = Pair(side(moving(TURN), own), side(TUBE, LINE), pairs, None, ())
    layers = {layer.name: layer for layer in register_scene(pair, TURN, "multistart", []).layers}
    np.testing.assert_allclose(layers["centerline, moving after"].lines_mm[0], MIDDLE, atol=1e-9)
    np.testing.assert_allclose(layers["landmarks, moving after"].points_mm, marks, atol=1e-9)
    np.testing.assert_allclose(layers["landmarks, fixed"].points_mm, marks)


def test_a_rival_pose_is_a_layer_of_its_own() -> None:
    rival = transforms.compose(transforms.translation((0.0, 0.0, 8.0)), TURN)
    pair = Pair(side(moving(TURN)), side(TUBE), None, None, ())
    layers = {layer.name: layer for layer in register_scene(pair, TURN, "multistart", [], rival).layers}
    shown = layers["moving, rival pose"]
    assert shown.shown
    np.testing.assert_allclose(shown.mesh.vertices_mm, TUBE.vertices_mm + np.array([0, 0, 8.0]), atol=1e-9)


def test_what_lies_far_away_does_not_shrink_the_rest() -> None:
    away = transforms.compose(TURN, transforms.translation((2000.0, 0.0, 0.0)))
    scene = register_scene(Pair(side(moving(away)), side(TUBE), None, None, ()), away, "multistart", [])
    assert [layer.name for layer in scene.layers] == ["fixed", "moving, after"]
    assert any("2000 mm away; it is not shown there" in note for note in scene.notes)


def test_clouds_are_shown_as_points(tmp_path: Path) -> None:
    pair = Pair(side(moving(TURN).vertices_mm), side(TUBE.vertices_mm), None, None, ())
    scene = register_scene(pair, TURN, "multistart", ["</script><b>"])
    scene.write(tmp_path / "scene.html")
    page = (tmp_path / "scene.html").read_text(encoding="utf-8")
    assert [trace["type"] for trace in figure_of(page, "scene")["data"]] == ["scatter3d"] * 3
    assert "&lt;/script&gt;" in page
