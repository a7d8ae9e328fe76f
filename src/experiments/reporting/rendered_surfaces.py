"""Surfaces rendered without a screen, coloured by a distance: the picture that a page or the README shows.

VTK draws each panel off-screen, matplotlib sets the panels side by side with one scale of colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from registration.geometry.shapes import Mesh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOR_MAP = "viridis"
_MODEL_COLOR, _MODEL_OPACITY = (0.55, 0.58, 0.62), 0.35


@dataclass(frozen=True)
class Panel:
    """One view: a surface in colours, within another one that is grey and lets it through.

    Parameters
    ----------
    title : str
        Text above the view.
    surface : Mesh
        Surface in colours, mm.
    distances_mm : ndarray, shape (n,)
        Value of each of its vertices, mm.
    model : Mesh
        Grey surface in the same frame, mm.
    """

    title: str
    surface: Mesh
    distances_mm: np.ndarray
    model: Mesh

    def __post_init__(self) -> None:
        if len(self.distances_mm) != len(self.surface.vertices_mm):
            raise InputError(
                f"distances_mm: expected one value for each of {len(self.surface.vertices_mm)} vertices, "
                f"received {len(self.distances_mm)}"
            )


def rendered(panels: Sequence[Panel], max_mm: float, width_px: int = 520, height_px: int = 620) -> Figure:
    """Draw panels side by side, all seen from the direction that shows their models broadest.

    Parameters
    ----------
    panels : sequence of Panel
        Views, from left to right.
    max_mm : float
        Distance with the last colour; what is farther has it too.
    width_px, height_px : int, optional
        Size of a panel.

    Returns
    -------
    Figure
        The figure, not yet saved.

    Raises
    ------
    InputError
        If there is no panel, or ``max_mm`` is not above 0.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure as NewFigure

    if not panels or not max_mm > 0:
        raise InputError(
            f"panels, max_mm: expected a panel and more than 0, received {len(panels)} and {max_mm}"
        )
    view = _view(panels)
    figure = NewFigure(figsize=(3.0 * len(panels) + 0.9, 4.0), layout="constrained")
    places = figure.subplots(1, len(panels), squeeze=False)[0]
    scale = Normalize(0.0, max_mm)
    for place, panel in zip(places, panels, strict=True):
        place.imshow(_picture(panel, scale, view, (width_px, height_px)))
        place.set_title(panel.title, fontsize=10)
        place.set_axis_off()
    bar = figure.colorbar(ScalarMappable(scale, COLOR_MAP), ax=list(places), shrink=0.7, extend="max")
    bar.set_label("distance to the CT model (mm)")
    return figure


@dataclass(frozen=True)
class _View:
    """Rows of ``axes``: to the right, up (along the model's longest axis), towards the eye; what is seen, mm."""

    axes: np.ndarray
    middle_mm: np.ndarray
    size_mm: np.ndarray


def _view(panels: Sequence[Panel]) -> _View:
    model_mm = panels[-1].model.vertices_mm
    _, _, found = np.linalg.svd(model_mm - model_mm.mean(axis=0), full_matrices=False)
    axes = np.stack([found[1], found[0], np.cross(found[1], found[0])])
    shown = np.concatenate([each.vertices_mm for panel in panels for each in (panel.surface, panel.model)])
    along = shown @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return _View(axes, 0.5 * (low + high) @ axes, high - low)


def _picture(panel: Panel, scale: Any, view: _View, size: tuple[int, int]) -> np.ndarray:
    """Pixels (height, width, 3) of one view, uint8."""
    import matplotlib

    # What draws registers itself when it is imported.
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkLogger
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter

    colors = matplotlib.colormaps[COLOR_MAP](scale(panel.distances_mm), bytes=True)[:, :3]
    # Where there is no X server VTK warns and takes another way.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.AddActor(_actor(panel.surface, colors))
    model = _actor(panel.model, None)
    model.GetProperty().SetColor(*_MODEL_COLOR)
    model.GetProperty().SetOpacity(_MODEL_OPACITY)
    renderer.AddActor(model)
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(*size)
    # What lets through is drawn in the order of depth, which needs one sample a pixel and an alpha channel.
    window.SetMultiSamples(0)
    window.SetAlphaBitPlanes(1)
    window.AddRenderer(renderer)
    renderer.UseFXAAOn()
    renderer.SetUseDepthPeeling(True)
    renderer.SetMaximumNumberOfPeels(8)
    _look(renderer, view, size[0] / size[1])
    window.Render()
    grabbed = vtkWindowToImageFilter()
    grabbed.SetInput(window)
    grabbed.ReadFrontBufferOff()
    grabbed.Update()
    pixels = vtk_to_numpy(grabbed.GetOutput().GetPointData().GetScalars())
    return np.flipud(pixels.reshape(size[1], size[0], -1)[..., :3]).copy()


def _look(renderer: Any, view: _View, aspect: float) -> None:
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(*view.middle_mm)
    camera.SetPosition(*(view.middle_mm + 2.0 * np.linalg.norm(view.size_mm) * view.axes[2]))
    camera.SetViewUp(*view.axes[1])
    camera.SetParallelScale(0.52 * max(view.size_mm[1], view.size_mm[0] / aspect))
    renderer.ResetCameraClippingRange()


def _actor(mesh: Mesh, colors: np.ndarray | None) -> Any:
    """A mesh as VTK draws it, its vertices in colours (n, 3), uint8, if there are any."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkPolyDataNormals
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    points, cells = vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(mesh.vertices_mm), deep=True))
    triangles = np.ascontiguousarray(mesh.triangles, dtype=np.int64)
    cells.SetData(3, numpy_to_vtkIdTypeArray(triangles.reshape(-1), deep=True))
    data = vtkPolyData()
    data.SetPoints(points)
    data.SetPolys(cells)
    if colors is not None:
        data.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(colors), deep=True))
    normals = vtkPolyDataNormals()
    normals.SetInputData(data)
    normals.SplittingOff()
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    actor = vtkActor()
    actor.SetMapper(mapper)
    return actor
