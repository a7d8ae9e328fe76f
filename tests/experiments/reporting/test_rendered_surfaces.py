"""Rendered panels: near is drawn in the first colour, far in the last, and the grey model around it is seen."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
from vessels import bent_tube

from experiments.errors import InputError
from experiments.reporting.figure_files import save_figure
from experiments.reporting.rendered_surfaces import COLOR_MAP, Panel, _picture, _view, rendered
from registration.geometry.shapes import Mesh, transformed


def pixels(distance_mm: float) -> np.ndarray:
    """A tube of one colour at one end of its model, drawn with a scale to 3 mm."""
    from matplotlib.colors import Normalize

    model = bent_tube()
    half = Mesh(model.vertices_mm, model.triangles[: len(model.triangles) // 2])
    panel = Panel("a", half, np.full(len(half.vertices_mm), distance_mm), model)
    return _picture(panel, Normalize(0, 3), _view([panel]), (90, 120))


@pytest.mark.parametrize(("distance_mm", "place"), [(0.0, 0.0), (3.0, 1.0), (30.0, 1.0)])
def test_the_colour_says_how_far(distance_mm: float, place: float) -> None:
    picture = pixels(distance_mm)
    assert picture.shape == (120, 90, 3)
    drawn = picture.reshape(-1, 3)[picture.reshape(-1, 3).min(axis=1) < 250]
    # Light changes how bright a colour is, not its hue.
    hues = matplotlib.colors.rgb_to_hsv(drawn / 255.0)
    wanted = matplotlib.colors.rgb_to_hsv(matplotlib.colormaps[COLOR_MAP](place)[:3])[0]
    coloured = hues[:, 1] > 0.5
    assert coloured.mean() > 0.15, "the surface"
    assert np.median(np.abs(hues[coloured, 0] - wanted)) < 0.08
    assert (hues[:, 1] < 0.2).mean() > 0.15, "the grey model where nothing covers it"


def test_panels_stand_side_by_side_with_one_scale(tmp_path) -> None:
    model = bent_tube()
    away = np.eye(4)
    away[0, 3] = 5.0
    moved = transformed(model, away)
    panels = [
        Panel("before", moved, np.full(len(moved.vertices_mm), 5.0), model),
        Panel("after", model, np.zeros(len(model.vertices_mm)), model),
    ]
    figure = rendered(panels, 3.0, 60, 80)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["before", "after"]
    assert figure.axes[2].get_ylabel().endswith("(mm)")
    save_figure(figure, tmp_path / "picture", ("png",), dpi=50)
    assert (tmp_path / "picture.png").stat().st_size > 1000


def test_a_value_for_each_vertex_is_needed() -> None:
    model = bent_tube()
    with pytest.raises(InputError, match="distances_mm: expected one value for each"):
        Panel("a", model, np.zeros(3), model)


@pytest.mark.parametrize(("count", "max_mm"), [(0, 3.0), (1, 0.0), (1, float("nan"))])
def test_no_panel_and_no_scale_are_refused(count: int, max_mm: float) -> None:
    model = bent_tube()
    panels = [Panel("a", model, np.zeros(len(model.vertices_mm)), model)] * count
    with pytest.raises(InputError, match="expected a panel and more than 0"):
        rendered(panels, max_mm)
