"""Interactive 3-D pages: one self-contained HTML file each, its layers switched by buttons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.reporting.labels import axis_label
from experiments.reporting.scene_data import (
    VIEW_CENTER,
    VIEW_DIRECTION,
    VIEW_DISTANCE,
    bounds_of,
    core_bounds_of,
    view_eye,
)
from experiments.reporting.scene_layers import (
    COLOR_AXIS,
    RADIUS_AXIS,
    CloudLayer,
    Layer,
    LineLayer,
    SurfaceLayer,
)
from experiments.reporting.view_page import RADIUS_SCALE, VALUES_SCALE, layer_button, scene_html

# What one page holds of each kind. With the script of plotly.js (5 MB) this stays under 8 MB.
MAX_SIZES = {"triangles": 80_000, "points": 35_000, "points of lines": 10_000}


@dataclass(frozen=True)
class Scene:
    """Interactive 3-D page of surfaces, lines and clouds in one coordinate frame.

    Large surfaces and clouds are decimated for the page; a note below the view reports it.

    Parameters
    ----------
    layers : sequence of Layer
        What is shown, in mm; at least one, with names that differ.
    title : str
        Title of the page.
    notes : sequence of str, optional
        Sentences below the view.
    space : str, optional
        Coordinate frame of the axes.
    values_name : str, optional
        Label of the colour scale of all layers with values.
    values_range_mm : tuple of float or None, optional
        Lower and upper end of the colour scale; None takes those of the values.
    verdict : str, optional
        Verdict of a registration, shown as a badge beside the title; empty for none.

    Raises
    ------
    InputError
        If there is no layer, names repeat, or the range is not increasing.
    """

    layers: Sequence[Layer]
    title: str
    notes: Sequence[str] = ()
    space: str = "ct (LPS)"
    values_name: str = "Distance (mm)"
    values_range_mm: tuple[float, float] | None = None
    verdict: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        object.__setattr__(self, "notes", tuple(self.notes))
        if not self.layers:
            raise InputError("layers: expected at least one, received none")
        names = [layer.name for layer in self.layers]
        if len(set(names)) < len(names):
            raise InputError(f"layers: expected names that differ, received {', '.join(names)}")
        if self.values_range_mm is not None and not self.values_range_mm[0] < self.values_range_mm[1]:
            raise InputError(
                f"values_range_mm: expected a lower and a higher value, received {self.values_range_mm}"
            )

    def write(self, path: Path) -> None:
        """Write the page, replacing an existing file.

        Parameters
        ----------
        path : Path
            The file; its folder must exist.
        """
        files.write_text(Path(path), self.html())

    def html(self) -> str:
        """Render the page.

        Returns
        -------
        str
            HTML with everything it needs, the script of plotly.js included.
        """
        import plotly.graph_objects as go  # type: ignore[import-untyped]

        figure = go.Figure([layer.trace(self._max_size(layer)) for layer in self.layers], self._layout())
        fitting = self._fitting()
        notes = (*self.notes, *self._decimation_notes(), *_outlier_notes(fitting["outliers"]))
        view = figure.to_html(
            {"responsive": True, "displayModeBar": False}, full_html=False, div_id="scene", validate=False
        )
        buttons = [layer_button(layer.name, _swatch(layer), layer.shown) for layer in self.layers]
        axes = f"Axes: {self.space}, in mm."
        return scene_html(self.title, self.verdict, buttons, (*notes, axes), view, fitting)

    @cached_property
    def _cores(self) -> list[tuple[np.ndarray, int]]:
        """Box of each layer without points far away, and the number of these."""
        return [core_bounds_of(layer.points_mm) for layer in self.layers]

    def _fitting(self) -> dict[str, Any]:
        """What the page fits its view with."""
        return {
            "boxes": [bounds_mm.tolist() for bounds_mm, _ in self._cores],
            "whole": [bounds_of(layer.points_mm).tolist() for layer in self.layers],
            "outliers": sum(count for _, count in self._cores),
            "direction": VIEW_DIRECTION.tolist(),
            "distance": VIEW_DISTANCE,
        }

    def _max_size(self, layer: Layer) -> int:
        """A layer's share of what the page may hold of its kind."""
        allowed = MAX_SIZES[layer.unit]
        total = sum(other.size for other in self.layers if other.unit == layer.unit)
        return layer.size if total <= allowed else max(layer.size * allowed // total, 1)

    def _decimation_notes(self) -> list[str]:
        return [
            f"{layer.name}: shown with about {shown:,} of {layer.size:,} {layer.unit}; the files hold all of them."
            for layer in self.layers
            if (shown := self._max_size(layer)) < layer.size
        ]

    def _layout(self) -> dict[str, Any]:
        # Hidden layers and single points far away would shrink all else.
        boxes_mm = [box_mm for box_mm, _ in self._cores]
        shown_mm = [box_mm for layer, box_mm in zip(self.layers, boxes_mm, strict=True) if layer.shown]
        bounds_mm = np.stack(shown_mm or boxes_mm)
        low_mm, high_mm = bounds_mm[:, 0].min(axis=0), bounds_mm[:, 1].max(axis=0)
        margin_mm = 0.03 * float((high_mm - low_mm).max()) + 1e-6
        axes = {
            f"{axis}axis": {
                "title": {"text": axis_label(f"{axis}_mm")},
                "range": [float(low_mm[at] - margin_mm), float(high_mm[at] + margin_mm)],
                "backgroundcolor": "#f7f7f7",
                "showbackground": True,
                "gridcolor": "#d0d0d0",
                "zeroline": False,
            }
            for at, axis in enumerate("xyz")
        }
        layout: dict[str, Any] = {
            # The same length for a millimetre on every axis.
            "scene": {
                "aspectmode": "data",
                **axes,
                "camera": {"eye": view_eye(high_mm - low_mm + 2 * margin_mm), "center": VIEW_CENTER},
            },
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            # The page's own buttons are reached by the keyboard too.
            "showlegend": False,
            "paper_bgcolor": "#ffffff",
            "font": {"color": "#222222", "size": 13},
            "uirevision": "kept",
            # Plotly's own template would add what is not used here.
            "template": "none",
        }
        return layout | self._color_scales()

    def _color_scales(self) -> dict[str, Any]:
        """The scales of values and of radii, one above the other where there are both."""
        scales: dict[str, Any] = {}
        if any(layer.has_values for layer in self.layers):
            scales[COLOR_AXIS] = _scale(VALUES_SCALE, self.values_name)
            if self.values_range_mm is not None:
                scales[COLOR_AXIS] |= {"cmin": self.values_range_mm[0], "cmax": self.values_range_mm[1]}
        if any(layer.has_radii for layer in self.layers):
            scales[RADIUS_AXIS] = _scale(RADIUS_SCALE, axis_label("radius_mm"))
        if len(scales) == 2:
            for name, height in zip(scales, (0.78, 0.26), strict=True):
                scales[name]["colorbar"] |= {"len": 0.46, "y": height}
        return scales


def _scale(colors: str, name: str) -> dict[str, Any]:
    title = {"text": name, "side": "right"}
    return {"colorscale": colors, "colorbar": {"title": title, "len": 0.7, "thickness": 16}}


def _swatch(layer: Layer) -> str:
    """The colour of a layer's button, or the name of its scale."""
    if layer.has_values:
        return VALUES_SCALE
    return RADIUS_SCALE if layer.has_radii else layer.color


def _outlier_notes(count: int) -> list[str]:
    if not count:
        return []
    points = "1 point lies" if count == 1 else f"{count:,} points lie"
    return [f"{points} far away from the others and outside the view; Show outliers brings all into it."]


__all__ = ["CloudLayer", "Layer", "LineLayer", "Scene", "SurfaceLayer"]
