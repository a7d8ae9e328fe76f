"""The page as a whole: self-contained, not too large, and with its data where the script finds them."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from plotly_pages import figure_of, numbers
from vessels import bent_tube

from experiments.errors import InputError
from experiments.reporting.scene import CloudLayer, LineLayer, Scene, SurfaceLayer
from registration.geometry.shapes import Mesh

TUBE = bent_tube()
LINE = LineLayer("centerline", [TUBE.vertices_mm[:4]])
SURFACE = SurfaceLayer("CT", TUBE)


class Parsed(HTMLParser):
    """The page's elements and texts, and the content of each script."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            self.scripts[-1] += data
        elif not (self._open and self._open[-1] == "style"):
            self.text += data


def test_the_page_holds_everything_it_needs(tmp_path: Path) -> None:
    Scene([SURFACE, LINE], "A vessel", ["First note.", "Second note."]).write(tmp_path / "scene.html")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.html"]
    text = (tmp_path / "scene.html").read_text(encoding="utf-8")
    page = Parsed(text)
    assert not [attributes for _, attributes in page.elements if "src" in attributes or "href" in attributes]
    assert len(page.scripts) == 4
    assert "plotly.js v" in page.scripts[1][:200]
    assert "scene" in [attributes.get("id") for tag, attributes in page.elements if tag == "div"]
    assert [trace["name"] for trace in figure_of(text, "scene")["data"]] == ["CT", "centerline"]
    for note in ("First note.", "Second note.", "Axes: ct (LPS), in mm."):
        assert note in page.text
    assert "$" not in page.text


def test_coordinates_and_triangles_are_stored_in_binary() -> None:
    trace = figure_of(Scene([SURFACE], "A vessel").html(), "scene")["data"][0]
    for axis, values in zip("xyz", TUBE.vertices_mm.T, strict=True):
        np.testing.assert_array_equal(numbers(trace[axis]), values.astype(np.float32))
    for corner, values in zip("ijk", TUBE.triangles.T, strict=True):
        np.testing.assert_array_equal(numbers(trace[corner]), values)
        assert trace[corner]["dtype"] == "u2"


def test_axes_are_in_mm_at_one_scale_and_hold_what_is_shown() -> None:
    hidden = CloudLayer("far", np.array([[400.0, 0, 0], [401, 1, 1]]), shown=False)
    layout = figure_of(Scene([SURFACE, hidden], "A vessel").html(), "scene")["layout"]
    assert layout["scene"]["aspectmode"] == "data"
    assert [layout["scene"][f"{axis}axis"]["title"]["text"] for axis in "xyz"] == [
        "x (mm)",
        "y (mm)",
        "z (mm)",
    ]
    low_mm, high_mm = np.array([layout["scene"][f"{axis}axis"]["range"] for axis in "xyz"]).T
    assert (low_mm < TUBE.vertices_mm.min(axis=0)).all()
    assert (high_mm > TUBE.vertices_mm.max(axis=0)).all()
    assert high_mm[0] < 250, "a hidden layer does not shrink the others"
    alone = figure_of(Scene([hidden], "A cloud").html(), "scene")["layout"]
    assert alone["scene"]["xaxis"]["range"][1] > 401
    assert "coloraxis" not in layout


def test_the_view_is_so_far_away_that_a_long_vessel_is_in_it() -> None:
    def distance(length_mm: float) -> float:
        ends = np.array([[0.0, 0, 0], [10, 10, length_mm]])
        eye = Scene([CloudLayer("a", ends, "#000000")], "t")._layout()["scene"]["camera"]["eye"]
        return float(np.linalg.norm(list(eye.values())))

    # In plotly's scale, a box of volume 1: with the margin |(16, 16, 106)| / (16 * 16 * 106)^(1/3), over sqrt(3).
    assert distance(10.0) == pytest.approx(2.85 * np.sqrt(3) / 2)
    assert distance(100.0) / distance(10.0) == pytest.approx(2.08, abs=0.01)


def test_layers_with_values_share_one_scale() -> None:
    values_mm = TUBE.vertices_mm[:, 2]
    layers = [
        SurfaceLayer("a", TUBE, values_mm=values_mm),
        CloudLayer("b", TUBE.vertices_mm, values_mm=values_mm),
    ]
    page = figure_of(Scene(layers, "A vessel", values_range_mm=(0.0, 4.0)).html(), "scene")
    scale = page["layout"]["coloraxis"]
    assert (scale["cmin"], scale["cmax"], scale["colorbar"]["title"]["text"]) == (0.0, 4.0, "Distance (mm)")
    assert page["data"][0]["coloraxis"] == page["data"][1]["marker"]["coloraxis"] == "coloraxis"


def test_a_point_far_away_is_outside_the_view_and_said() -> None:
    far = CloudLayer("far", np.concatenate([TUBE.vertices_mm, [[9000.0, 0, 0]]]))
    text = Scene([far, SURFACE], "A vessel").html()
    assert figure_of(text, "scene")["layout"]["scene"]["xaxis"]["range"][1] < 250
    assert "1 point lies far away from the others" in text
    assert 'id="all">' in text
    assert 'id="all" hidden>' in Scene([SURFACE], "A vessel").html()


def test_radii_have_a_scale_of_their_own() -> None:
    line = LineLayer("centerline", [TUBE.vertices_mm[:4]], radius_mm=[np.arange(4.0)])
    alone = figure_of(Scene([line], "A vessel").html(), "scene")
    assert alone["data"][0]["line"]["coloraxis"] == "coloraxis2"
    assert alone["layout"]["coloraxis2"]["colorbar"]["title"]["text"] == "Radius (mm)"
    assert "coloraxis" not in alone["layout"]
    coloured = SurfaceLayer("a", TUBE, values_mm=TUBE.vertices_mm[:, 2])
    both = figure_of(Scene([coloured, line], "A vessel").html(), "scene")["layout"]
    upper, lower = both["coloraxis"]["colorbar"], both["coloraxis2"]["colorbar"]
    assert upper["y"] - upper["len"] / 2 > lower["y"] + lower["len"] / 2


def test_names_and_notes_can_not_break_the_page() -> None:
    nasty = "</script><b>$view & 'x'"
    text = Scene([SurfaceLayer(nasty, TUBE)], nasty, [nasty], space=nasty).html()
    page = Parsed(text)
    assert figure_of(text, "scene")["data"][0]["name"] == nasty
    # In title, heading, button, note and the name of the axes.
    assert page.text.count(nasty) == 5
    assert "b" not in [tag for tag, _ in page.elements]


@pytest.mark.parametrize(
    ("verdict", "kind"), [("accepted", "good"), ("ambiguous", "doubt"), ("failed", "bad")]
)
def test_a_verdict_is_a_badge_beside_the_title(verdict: str, kind: str) -> None:
    layer = CloudLayer("a", np.zeros((3, 3)), "#000000")
    assert f'<span class="badge {kind}">{verdict}</span>' in Scene([layer], "t", verdict=verdict).html()
    assert "&lt;i&gt;</span>" in Scene([layer], "t", verdict="<i>").html()
    assert '<span class="badge' not in Scene([layer], "t").html()


def test_a_large_scene_stays_small_and_says_what_it_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    from experiments.reporting import scene

    monkeypatch.setitem(scene.MAX_SIZES, "triangles", 6000)
    monkeypatch.setitem(scene.MAX_SIZES, "points", 1000)
    second = SurfaceLayer("US", Mesh(TUBE.vertices_mm + 5.0, TUBE.triangles))
    cloud = CloudLayer("cloud", TUBE.sample(3000, np.random.default_rng(0)))
    page = Parsed(Scene([SURFACE, second, cloud, LINE], "A vessel").html())
    for layer, unit, most in (
        ("CT", "triangles", "3,000"),
        ("US", "triangles", "3,000"),
        ("cloud", "points", "1,000"),
    ):
        assert f"{layer}: shown with about {most} of " in page.text
        assert unit in page.text
    assert "centerline: shown" not in page.text


def test_the_largest_scene_is_under_8_megabytes() -> None:
    from experiments.reporting.scene import MAX_SIZES

    rng = np.random.default_rng(0)
    # A closed surface has half as many vertices as triangles.
    vertices_mm = rng.random((MAX_SIZES["triangles"] // 2, 3))
    corners = rng.integers(0, len(vertices_mm), (MAX_SIZES["triangles"], 3)).astype(np.int64)
    surface = SurfaceLayer("s", Mesh(vertices_mm, corners), values_mm=rng.random(len(vertices_mm)))
    cloud = CloudLayer("c", rng.random((MAX_SIZES["points"], 3)), values_mm=rng.random(MAX_SIZES["points"]))
    line = LineLayer(
        "l",
        [rng.random((MAX_SIZES["points of lines"], 3))],
        radius_mm=[rng.random(MAX_SIZES["points of lines"])],
    )
    assert len(Scene([surface, cloud, line], "A vessel").html().encode()) < 8e6


def test_scenes_that_can_not_be_are_refused() -> None:
    with pytest.raises(InputError, match="layers: expected at least one, received none"):
        Scene([], "A vessel")
    with pytest.raises(InputError, match="layers: expected names that differ, received CT, CT"):
        Scene([SURFACE, SURFACE], "A vessel")
    with pytest.raises(InputError, match="values_range_mm: expected a lower and a higher value"):
        Scene([SURFACE], "A vessel", values_range_mm=(1.0, 1.0))
