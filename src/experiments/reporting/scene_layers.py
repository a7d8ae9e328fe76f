"""Layers of an interactive 3-D page: surfaces, lines and clouds as traces of plotly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from experiments.errors import InputError
from experiments.reporting.scene_data import (
    decimated,
    require_finite,
    require_values,
)
from registration.geometry.shapes import Centerline, Mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    import plotly.graph_objects as go  # type: ignore[import-untyped]

BLUE, ORANGE, RED, GREY = "#2a6f97", "#e07a1f", "#c1121f", "#6c757d"
GREEN = "#2e8b57"
# Of a colour scale that all layers with values share, and of the one that all lines with radii share.
COLOR_AXIS, RADIUS_AXIS = "coloraxis", "coloraxis2"
_LIGHT = {"ambient": 0.55, "diffuse": 0.7, "specular": 0.15, "roughness": 0.6, "fresnel": 0.1}


class Layer(Protocol):
    """A layer of a scene, which becomes one trace of plotly."""

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

    @property
    def has_radii(self) -> bool:
        """Whether it is coloured by radius."""

    @property
    def color(self) -> str:
        """Colour where there are neither values nor radii."""

    @property
    def shown(self) -> bool:
        """Whether it is visible at first."""

    @property
    def points_mm(self) -> np.ndarray:
        """Its points (n, 3) in mm, which the view is fitted to."""

    def trace(self, max_size: int) -> go.Mesh3d | go.Scatter3d:
        """Convert the layer to a trace of plotly.

        Parameters
        ----------
        max_size : int
            Approximate largest number of triangles or points.

        Returns
        -------
        plotly.graph_objects.Mesh3d or plotly.graph_objects.Scatter3d
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
        Whether it is visible at first; its button switches it.

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

    @property
    def has_radii(self) -> bool:
        """Always False: there are none."""
        return False

    @property
    def points_mm(self) -> np.ndarray:
        """Vertices (v, 3) in mm."""
        return self.mesh.vertices_mm

    def trace(self, max_size: int) -> go.Mesh3d:
        """Convert the surface to a mesh3d trace.

        Parameters
        ----------
        max_size : int
            Approximate largest number of triangles.

        Returns
        -------
        plotly.graph_objects.Mesh3d
            The trace.
        """
        import plotly.graph_objects as go

        mesh, values = decimated(self.mesh, self.values_mm, max_size)
        # Unsigned, plotly stores them in as few bytes as they need.
        i, j, k = mesh.triangles.T.astype(np.uint64)
        colors: dict[str, Any] = {"color": self.color, "hoverinfo": "name"}
        if values is not None:
            colors = {
                "intensity": values.astype(np.float32),
                "coloraxis": COLOR_AXIS,
                "hovertemplate": "%{intensity:.2f} mm<extra>%{fullData.name}</extra>",
            }
        return go.Mesh3d(
            **_coordinates(mesh.vertices_mm), i=i, j=j, k=k, opacity=self.opacity, lighting=_LIGHT,
            flatshading=False, **_entry(self.name, self.shown), **colors,
        )  # fmt: skip


@dataclass(frozen=True)
class LineLayer:
    """Lines of one colour, or coloured by their radius.

    Parameters
    ----------
    name : str
        Name in the legend.
    lines_mm : sequence of ndarray, shape (n, 3)
        Points of each line in mm.
    color : str, optional
        Colour where there are no radii.
    width_px : float, optional
        Width in px.
    radius_mm : sequence of ndarray, shape (n,), or None, optional
        Radius at each point of each line in mm, shown as its colour and where the pointer rests.
    shown : bool, optional
        Whether it is visible at first; its button switches it.
    dash : {'solid', 'dash', 'dot'}, optional
        Stroke, which tells lines apart that are coloured by radius.

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
    dash: str = "solid"

    def __post_init__(self) -> None:
        if not self.size:
            raise InputError(f"{self.name}: expected lines with points, received none")
        sizes = [len(line) for line in self.lines_mm]
        if self.radius_mm is not None and [len(radius) for radius in self.radius_mm] != sizes:
            raise InputError(
                f"{self.name}: expected one radius a point of every line, received another number"
            )
        require_finite(self.name, self.points_mm)

    @classmethod
    def of(
        cls,
        name: str,
        centerline: Centerline,
        shown: bool = True,
        dash: str = "solid",
    ) -> LineLayer:
        """Make a layer of a centerline, coloured by its radius.

        Parameters
        ----------
        name : str
            Name in the legend.
        centerline : Centerline
            Lines with radii in mm.
        shown : bool, optional
            Whether it is visible at first.
        dash : {'solid', 'dash', 'dot'}, optional
            Stroke.

        Returns
        -------
        LineLayer
            The layer.
        """
        places_mm = [line.points_mm for line in centerline.lines]
        radius_mm = [line.radius_mm for line in centerline.lines]
        return cls(name, places_mm, radius_mm=radius_mm, shown=shown, dash=dash)

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
        """Always False: lines have one colour, or that of their radius."""
        return False

    @property
    def has_radii(self) -> bool:
        """Whether it is coloured by radius."""
        return self.radius_mm is not None

    @property
    def points_mm(self) -> np.ndarray:
        """Points of all lines (n, 3) in mm."""
        return np.concatenate(list(self.lines_mm))

    def trace(self, max_size: int) -> go.Scatter3d:
        """Convert the lines to one scatter3d trace.

        Parameters
        ----------
        max_size : int
            Approximate largest number of points; long lines are subsampled, their ends kept.

        Returns
        -------
        plotly.graph_objects.Scatter3d
            The trace.
        """
        import plotly.graph_objects as go

        step = max(int(np.ceil(self.size / max(max_size, 1))), 1)
        # NaN ends a line, so that one trace and one entry of the legend hold them all.
        gap = np.full((1, 4), np.nan)
        parts = []
        for number, line in enumerate(self.lines_mm):
            radius = np.zeros(len(line)) if self.radius_mm is None else self.radius_mm[number]
            kept = np.unique(np.append(np.arange(0, len(line), step), len(line) - 1))
            parts += [np.column_stack([line, radius])[kept], gap]
        rows = np.concatenate(parts[:-1])
        look: dict[str, Any] = {"color": self.color, "width": self.width_px, "dash": self.dash}
        hover: dict[str, Any] = {"hoverinfo": "name"}
        if self.radius_mm is not None:
            radius_mm = rows[:, 3].astype(np.float32)
            # A gap has no place; a colour it needs, or the lines behind it would have none.
            look |= {
                "color": np.where(np.isnan(radius_mm), np.nanmin(radius_mm), radius_mm),
                "coloraxis": RADIUS_AXIS,
            }
            hover = {
                "customdata": radius_mm,
                "hovertemplate": "radius %{customdata:.2f} mm<extra>%{fullData.name}</extra>",
            }
        return go.Scatter3d(
            **_coordinates(rows[:, :3]), mode="lines", line=look, **_entry(self.name, self.shown), **hover
        )


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
        Whether it is visible at first; its button switches it.

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

    @property
    def has_radii(self) -> bool:
        """Always False: there are none."""
        return False

    def trace(self, max_size: int) -> go.Scatter3d:
        """Convert the points to a scatter3d trace.

        Parameters
        ----------
        max_size : int
            Largest number of points; where there are more, a fixed random subset is shown.

        Returns
        -------
        plotly.graph_objects.Scatter3d
            The trace.
        """
        import plotly.graph_objects as go

        kept = np.arange(len(self.points_mm))
        if len(kept) > max_size:
            kept = np.sort(np.random.default_rng(0).choice(len(kept), max(max_size, 1), replace=False))
        marker: dict[str, Any] = {"size": self.size_px, "color": self.color}
        hover = {"hoverinfo": "name"}
        if self.values_mm is not None:
            marker |= {"color": self.values_mm[kept].astype(np.float32), "coloraxis": COLOR_AXIS}
            hover = {"hovertemplate": "%{marker.color:.2f} mm<extra>%{fullData.name}</extra>"}
        return go.Scatter3d(
            **_coordinates(self.points_mm[kept]), mode="markers", marker=marker,
            **_entry(self.name, self.shown), **hover,
        )  # fmt: skip


def _coordinates(points_mm: np.ndarray) -> dict[str, np.ndarray]:
    """The x, y and z of points (n, 3) in single precision, which plotly stores in binary."""
    return dict(zip("xyz", points_mm.T.astype(np.float32), strict=True))


def _entry(name: str, shown: bool) -> dict[str, Any]:
    return {"name": name, "showlegend": True, "visible": True if shown else "legendonly"}
