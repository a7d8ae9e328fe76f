"""Layers of an interactive 3-D page: surfaces, lines and clouds as traces of plotly.js."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from experiments.errors import InputError
from experiments.reporting.scene_data import (
    bounds_of,
    packed,
    packed_index,
    packed_places,
    require_finite,
    require_values,
    thinned,
)
from registration.geometry.shapes import Centerline, Mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

BLUE, ORANGE, RED, GREY = "#2a6f97", "#e07a1f", "#c1121f", "#6c757d"
# Of a colour scale that all layers with values share.
COLOR_AXIS = "coloraxis"
_LIGHT = {"ambient": 0.55, "diffuse": 0.7, "specular": 0.15, "roughness": 0.6, "fresnel": 0.1}


class Layer(Protocol):
    """A layer of a scene, which becomes one trace of plotly.js."""

    @property
    def unit(self) -> str:
        """What its size counts: triangles, points, or points of lines."""

    @property
    def name(self) -> str:
        """Name in the legend."""

    @property
    def size(self) -> int:
        """Number of triangles or points."""

    @property
    def has_values(self) -> bool:
        """Whether it is coloured by values."""

    def bounds_mm(self) -> np.ndarray:
        """Compute the bounding box.

        Returns
        -------
        ndarray, shape (2, 3)
            Lowest and highest coordinates in mm.
        """

    def trace(self, most: int) -> dict[str, Any]:
        """Convert the layer to a trace of plotly.js.

        Parameters
        ----------
        most : int
            Approximate largest number of triangles or points.

        Returns
        -------
        dict
            The trace.
        """


@dataclass(frozen=True)
class SurfaceLayer:
    """A semi-transparent surface.

    Parameters
    ----------
    name : str
        Name in the legend.
    mesh : Mesh
        Surface in mm.
    color : str, optional
        Colour where there are no values.
    opacity : float, optional
        Above 0 and up to 1.
    values_mm : ndarray, shape (v,), or None, optional
        Values at the vertices that colour it.
    shown : bool, optional
        Whether it is visible at first; a click in the legend switches it.

    Raises
    ------
    InputError
        If the opacity is out of range, the mesh has no triangles, or values are not finite or of another
        number.
    """

    name: str
    mesh: Mesh
    color: str = BLUE
    opacity: float = 0.45
    values_mm: np.ndarray | None = None
    shown: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.opacity <= 1:
            raise InputError(f"opacity: expected more than 0 and at most 1, received {self.opacity!r}")
        if not len(self.mesh.triangles):
            raise InputError(f"{self.name}: expected a mesh with triangles, received none")
        require_values(self.name, self.values_mm, len(self.mesh.vertices_mm))

    @property
    def unit(self) -> str:
        """What its size counts."""
        return "triangles"

    @property
    def size(self) -> int:
        """Number of triangles."""
        return len(self.mesh.triangles)

    @property
    def has_values(self) -> bool:
        """Whether it is coloured by values."""
        return self.values_mm is not None

    def bounds_mm(self) -> np.ndarray:
        """Compute the bounding box.

        Returns
        -------
        ndarray, shape (2, 3)
            Lowest and highest coordinates in mm.
        """
        return bounds_of(self.mesh.vertices_mm)

    def trace(self, most: int) -> dict[str, Any]:
        """Convert the surface to a mesh3d trace.

        Parameters
        ----------
        most : int
            Approximate largest number of triangles.

        Returns
        -------
        dict
            The trace.
        """
        mesh, values = thinned(self.mesh, self.values_mm, most)
        corners = {axis: packed_index(mesh.triangles[:, at]) for at, axis in enumerate("ijk")}
        trace = {
            "type": "mesh3d",
            **packed_places(mesh.vertices_mm),
            **corners,
            **_entry(self.name, self.shown),
        }
        trace |= {"opacity": self.opacity, "lighting": _LIGHT, "flatshading": False}
        if values is None:
            return trace | {"color": self.color, "hoverinfo": "name"}
        return trace | {
            "intensity": packed(values, "f4"),
            "coloraxis": COLOR_AXIS,
            "hovertemplate": "%{intensity:.2f} mm<extra>%{fullData.name}</extra>",
        }


@dataclass(frozen=True)
class LineLayer:
    """Lines of one colour.

    Parameters
    ----------
    name : str
        Name in the legend.
    lines_mm : sequence of ndarray, shape (n, 3)
        Points of each line in mm.
    color : str, optional
        Colour.
    width_px : float, optional
        Width in px.
    radius_mm : sequence of ndarray, shape (n,), or None, optional
        Radius at each point of each line in mm, shown where the pointer rests.
    shown : bool, optional
        Whether it is visible at first; a click in the legend switches it.

    Raises
    ------
    InputError
        If there is no point, a coordinate is not finite, or radii differ in number from the points.
    """

    name: str
    lines_mm: Sequence[np.ndarray]
    color: str = RED
    width_px: float = 5.0
    radius_mm: Sequence[np.ndarray] | None = None
    shown: bool = True

    def __post_init__(self) -> None:
        if not self.size:
            raise InputError(f"{self.name}: expected lines with points, received none")
        sizes = [len(line) for line in self.lines_mm]
        if self.radius_mm is not None and [len(radius) for radius in self.radius_mm] != sizes:
            raise InputError(
                f"{self.name}: expected one radius a point of every line, received another number"
            )
        require_finite(self.name, np.concatenate(list(self.lines_mm)))

    @classmethod
    def of(cls, name: str, centerline: Centerline, color: str = RED, shown: bool = True) -> LineLayer:
        """Make a layer of a centerline.

        Parameters
        ----------
        name : str
            Name in the legend.
        centerline : Centerline
            Lines with radii in mm.
        color : str, optional
            Colour.
        shown : bool, optional
            Whether it is visible at first.

        Returns
        -------
        LineLayer
            The layer.
        """
        lines = centerline.lines
        radius_mm = [line.radius_mm for line in lines]
        return cls(name, [line.points_mm for line in lines], color, radius_mm=radius_mm, shown=shown)

    @property
    def unit(self) -> str:
        """What its size counts."""
        return "points of lines"

    @property
    def size(self) -> int:
        """Number of points of all lines."""
        return sum(len(line) for line in self.lines_mm)

    @property
    def has_values(self) -> bool:
        """Always False: lines have one colour."""
        return False

    def bounds_mm(self) -> np.ndarray:
        """Compute the bounding box.

        Returns
        -------
        ndarray, shape (2, 3)
            Lowest and highest coordinates in mm.
        """
        return bounds_of(np.concatenate(list(self.lines_mm)))

    def trace(self, most: int) -> dict[str, Any]:
        """Convert the lines to one scatter3d trace.

        Parameters
        ----------
        most : int
            Approximate largest number of points; long lines are subsampled, their ends kept.

        Returns
        -------
        dict
            The trace.
        """
        step = max(int(np.ceil(self.size / max(most, 1))), 1)
        # NaN ends a line, so that one trace and one entry of the legend hold them all.
        gap = np.full((1, 4), np.nan)
        parts = []
        for number, line in enumerate(self.lines_mm):
            radius = np.zeros(len(line)) if self.radius_mm is None else self.radius_mm[number]
            kept = np.unique(np.append(np.arange(0, len(line), step), len(line) - 1))
            parts += [np.column_stack([line, radius])[kept], gap]
        rows = np.concatenate(parts[:-1])
        trace = {
            "type": "scatter3d",
            "mode": "lines",
            **packed_places(rows[:, :3]),
            **_entry(self.name, self.shown),
        }
        trace["line"] = {"color": self.color, "width": self.width_px}
        if self.radius_mm is None:
            return trace | {"hoverinfo": "name"}
        return trace | {
            "customdata": [None if np.isnan(value) else round(float(value), 3) for value in rows[:, 3]],
            "hovertemplate": "radius %{customdata:.2f} mm<extra>%{fullData.name}</extra>",
        }


@dataclass(frozen=True)
class CloudLayer:
    """A point cloud.

    Parameters
    ----------
    name : str
        Name in the legend.
    points_mm : ndarray, shape (n, 3)
        Points in mm.
    color : str, optional
        Colour where there are no values.
    size_px : float, optional
        Size of a point in px.
    values_mm : ndarray, shape (n,), or None, optional
        Values that colour the points.
    shown : bool, optional
        Whether it is visible at first; a click in the legend switches it.

    Raises
    ------
    InputError
        If there is no point, a coordinate is not finite, or values are not finite or of another number.
    """

    name: str
    points_mm: np.ndarray
    color: str = ORANGE
    size_px: float = 2.0
    values_mm: np.ndarray | None = None
    shown: bool = True

    def __post_init__(self) -> None:
        if not len(self.points_mm):
            raise InputError(f"{self.name}: expected points, received none")
        require_finite(self.name, self.points_mm)
        require_values(self.name, self.values_mm, len(self.points_mm))

    @property
    def unit(self) -> str:
        """What its size counts."""
        return "points"

    @property
    def size(self) -> int:
        """Number of points."""
        return len(self.points_mm)

    @property
    def has_values(self) -> bool:
        """Whether it is coloured by values."""
        return self.values_mm is not None

    def bounds_mm(self) -> np.ndarray:
        """Compute the bounding box.

        Returns
        -------
        ndarray, shape (2, 3)
            Lowest and highest coordinates in mm.
        """
        return bounds_of(self.points_mm)

    def trace(self, most: int) -> dict[str, Any]:
        """Convert the points to a scatter3d trace.

        Parameters
        ----------
        most : int
            Largest number of points; where there are more, a fixed random subset is shown.

        Returns
        -------
        dict
            The trace.
        """
        kept = np.arange(len(self.points_mm))
        if len(kept) > most:
            kept = np.sort(np.random.default_rng(0).choice(len(kept), max(most, 1), replace=False))
        trace = {"type": "scatter3d", "mode": "markers", **packed_places(self.points_mm[kept])}
        trace |= _entry(self.name, self.shown)
        if self.values_mm is None:
            return trace | {"marker": {"size": self.size_px, "color": self.color}, "hoverinfo": "name"}
        colors = packed(self.values_mm[kept], "f4")
        return trace | {
            "marker": {"size": self.size_px, "color": colors, "coloraxis": COLOR_AXIS},
            "hovertemplate": "%{marker.color:.2f} mm<extra>%{fullData.name}</extra>",
        }


def _entry(name: str, shown: bool) -> dict[str, Any]:
    return {"name": name, "showlegend": True, "visible": True if shown else "legendonly"}
