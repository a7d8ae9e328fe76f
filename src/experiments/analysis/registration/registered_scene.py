"""Layers of the page of a registration that several studies show: what moved, by its distance, and what deformed."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.analysis.registration.deformed_model import Deformed
from experiments.reporting.scene import CloudLayer, LineLayer, SurfaceLayer
from experiments.reporting.scene_layers import GREEN, RED
from registration.geometry.shapes import Mesh, Surface, points_of

# The displacement is drawn at so many points of the model.
ARROWS = 300
# The colours end where this share of the distances does, so that a few far points do not bleach the others.
COLOR_PERCENTILE = 99.0


def shape_layer(
    name: str,
    surface: Surface,
    color: str,
    opacity: float,
    *,
    values_mm: np.ndarray | None = None,
    shown: bool = True,
) -> SurfaceLayer | CloudLayer:
    """Make the layer of a mesh or a cloud.

    Parameters
    ----------
    name : str
        Name in the legend.
    surface : Surface
        Mesh or cloud in mm.
    color : str
        Colour where there are no values.
    opacity : float
        Opacity of a mesh from 0 to 1.
    values_mm : ndarray, shape (n,), or None, optional
        Value of each vertex or point, shown by colour; None for none.
    shown : bool, optional
        Whether it is shown at first.

    Returns
    -------
    SurfaceLayer or CloudLayer
        The layer.
    """
    if isinstance(surface, Mesh):
        return SurfaceLayer(name, surface, color, opacity, values_mm, shown)
    return CloudLayer(name, surface, color, values_mm=values_mm, shown=shown)


def deformed_layers(found: Deformed) -> list[Any]:
    """Show what moves after both stages, the model where it was swept, and how far its points are displaced.

    Parameters
    ----------
    found : Deformed
        Result of the deformable stage.

    Returns
    -------
    list
        Three layers, hidden at first.
    """
    ends_mm = np.stack([points_of(found.model), points_of(found.model_deformed)], axis=1)
    arrows = list(ends_mm[:: max(1, len(ends_mm) // ARROWS)])
    return [
        shape_layer("moving, deformed", found.moved, GREEN, 0.9, shown=False),
        shape_layer("model, deformed", found.model_deformed, RED, 0.35, shown=False),
        LineLayer("displacement of the model", arrows, RED, shown=False),
    ]


def color_range_mm(distance_mm: np.ndarray) -> tuple[float, float]:
    """Choose the ends of the colours for distances.

    Parameters
    ----------
    distance_mm : ndarray, shape (n,)
        Distances in mm.

    Returns
    -------
    tuple of float
        Lower and upper end in mm.
    """
    return 0.0, max(float(np.percentile(distance_mm, COLOR_PERCENTILE)), 1e-3)
