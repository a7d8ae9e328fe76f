"""Interactive 3-D pages: one self-contained HTML file each, its layers switched by the legend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.reporting.labels import axis_label
from experiments.reporting.scene_layers import (
    COLOR_AXIS,
    CloudLayer,
    Layer,
    LineLayer,
    SurfaceLayer,
)

# What one page holds of each kind. With the script of plotly.js (5 MB) this stays under 8 MB.
MAX_SIZES = {"triangles": 80_000, "points": 35_000, "points of lines": 10_000}
_COLORS = "Viridis"
# Direction that the view is taken from, and its distance in radii of the sphere around all layers.
_DIRECTION, _DISTANCE = np.array([1.7, -1.9, 0.8]), 3.0
# The look of a verdict; whatever is neither good nor failed is in doubt.
_BADGES = {"accepted": "good", "failed": "bad"}


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
        return _PAGE.substitute(
            title=escape(self.title),
            badge=self._badge(),
            space=escape(self.space),
            notes="\n".join(f"<p>{escape(note)}</p>" for note in (*self.notes, *self._decimation_notes())),
            view=figure.to_html(
                {"responsive": True, "displaylogo": False}, full_html=False, div_id="scene", validate=False
            ),
        )

    def _badge(self) -> str:
        kind = _BADGES.get(self.verdict, "doubt")
        return f' <span class="badge {kind}">{escape(self.verdict)}</span>' if self.verdict else ""

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
        bounds_mm = np.stack([layer.bounds_mm() for layer in self.layers])
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
            # The same length for a millimetre on every axis; layers that are switched off leave the view as it is.
            "scene": {
                "aspectmode": "data",
                **axes,
                "camera": {"eye": _eye(high_mm - low_mm + 2 * margin_mm)},
            },
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "legend": {"x": 0.01, "y": 0.99, "bgcolor": "rgba(255,255,255,0.8)", "itemsizing": "constant"},
            "paper_bgcolor": "#ffffff",
            "font": {"color": "#222222", "size": 13},
            "uirevision": "kept",
            # Plotly's own template would add what is not used here.
            "template": "none",
        }
        if any(layer.has_values for layer in self.layers):
            scale: dict[str, Any] = {
                "colorscale": _COLORS,
                "colorbar": {"title": {"text": self.values_name}, "len": 0.7},
            }
            if self.values_range_mm is not None:
                scale |= {"cmin": self.values_range_mm[0], "cmax": self.values_range_mm[1]}
            layout[COLOR_AXIS] = scale
        return layout


def _eye(extent_mm: np.ndarray) -> dict[str, float]:
    """Where the view is taken from, so far away that all of a box is in it.

    Plotly scales the box to a volume of 1 and measures the distance in that scale.
    """
    box = extent_mm / np.cbrt(extent_mm.prod())
    place = _DIRECTION / np.linalg.norm(_DIRECTION) * _DISTANCE * float(np.linalg.norm(box)) / 2
    return dict(zip("xyz", map(float, place), strict=True))


__all__ = ["CloudLayer", "Layer", "LineLayer", "Scene", "SurfaceLayer"]

_PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>$title</title>
<style>
html, body { height: 100%; } body { display: flex; flex-direction: column; margin: 0; background: #fff; color: #222;
  font-family: system-ui, sans-serif; }
h1 { font-size: 1.2rem; margin: .7rem 1rem .2rem; }
/* The notes come first in the text, so that the view is drawn at the height that they leave. */
#view { flex: 1; min-height: 420px; order: 1; } #view > div { height: 100%; }
.badge { border-radius: 10px; padding: 2px 10px; font-size: .85rem; font-weight: 600; white-space: nowrap; }
.good { background: #d9f2e3; color: #0d5a2c; } .doubt { background: #fdeccf; color: #6d4300; }
.bad { background: #f9d9d7; color: #7d1611; }
@media (max-width: 600px) { h1 { font-size: 1rem; } #notes { font-size: .8rem; } }
#notes { order: 2; margin: 0 1rem .6rem; font-size: .85rem; } #notes p { margin: .15rem 0; }
</style></head><body>
<h1>$title$badge</h1>
<div id="notes">$notes<p>Axes: $space, in mm. Drag to turn, scroll to zoom; a click in the legend switches a
layer, a double click leaves it alone.</p></div>
<div id="view">$view</div>
<script>
// On a narrow screen the legend would cover the view: it goes below.
if (window.innerWidth < 600) Plotly.relayout("scene", {
  "legend.orientation": "h", "legend.x": 0, "legend.y": -0.02, "legend.yanchor": "top", "font.size": 11});
</script>
</body></html>
""")
