"""Smoothing of triangle meshes that keeps their volume, or reports by how much it did not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array

from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.mesh_topology import borders, directed_edges
from registration.geometry.shapes import Mesh


@dataclass(frozen=True)
class Smoothed:
    """Result of smoothing a mesh.

    Parameters
    ----------
    mesh : Mesh
        The smoothed mesh.
    volume_change : float
        Change of the enclosed volume as a share of the volume before.
    moved_max_mm : float
        Largest displacement of a vertex in mm.
    """

    mesh: Mesh
    volume_change: float
    moved_max_mm: float

    __repr__ = brief_repr


@dataclass(frozen=True)
class TaubinSmoothing:
    """Low-pass filter of a mesh without shrinkage: repeated steps inwards and slightly larger ones outwards.

    A vertex on a border moves along the border only, so open ends stay where they are.

    Parameters
    ----------
    iterations : int, optional
        Number of pairs of steps.
    shrink : float, optional
        Factor of the step towards the mean of the neighbours, above 0 and at most 1.
    pass_band : float, optional
        Frequency that is kept, above 0 and below ``1 / shrink``; the step back has the factor
        ``1 / (pass_band - 1 / shrink)``.
    volume_tolerance : float, optional
        Largest change of the volume as a share of it.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    G. Taubin, SIGGRAPH 1995.
    """

    iterations: int = 10
    shrink: float = 0.5
    pass_band: float = 0.05
    volume_tolerance: float = 0.02

    def __post_init__(self) -> None:
        require_count("iterations", self.iterations, 0)
        require_positive("shrink", self.shrink, 1.0)
        require_positive("volume_tolerance", self.volume_tolerance)
        if not 0 < self.pass_band < 1 / self.shrink:
            raise InputError(
                f"pass_band: expected more than 0 and less than 1/shrink = {1 / self.shrink:g}, "
                f"received {self.pass_band!r}"
            )

    def __call__(self, mesh: Mesh) -> Smoothed:
        """Smooth a mesh.

        Parameters
        ----------
        mesh : Mesh
            Surface, open or closed.

        Returns
        -------
        Smoothed
            The mesh with the same triangles, and how much it changed.

        Raises
        ------
        InputError
            If the mesh has no triangles or its volume changes by more than ``volume_tolerance``.
        """
        if not len(mesh.triangles):
            raise InputError("mesh: expected triangles to smooth, received none")
        means = _neighbour_means(mesh)
        vertices_mm = mesh.vertices_mm
        grow = 1 / (self.pass_band - 1 / self.shrink)
        for _ in range(self.iterations):
            for factor in (self.shrink, grow):
                vertices_mm = vertices_mm + factor * (means @ vertices_mm - vertices_mm)
        smooth = Mesh(vertices_mm, mesh.triangles)
        before_mm3 = enclosed_volume_mm3(mesh)
        change = enclosed_volume_mm3(smooth) / before_mm3 - 1 if before_mm3 else 0.0
        if not abs(change) <= self.volume_tolerance:
            raise InputError(
                f"mesh: expected smoothing to keep the volume within {self.volume_tolerance:.1%}, "
                f"received a change of {change:+.1%}"
            )
        moved_mm = np.linalg.norm(vertices_mm - mesh.vertices_mm, axis=1)
        return Smoothed(smooth, float(change), float(moved_mm.max()))


def _neighbour_means(mesh: Mesh) -> csr_array:
    """The matrix that takes each vertex to the mean of its neighbours; on a border, of its neighbours there."""
    size = len(mesh.vertices_mm)
    edges = directed_edges(mesh)
    rim = [border.edges for border in borders(mesh)]
    if rim:
        along = np.concatenate(rim)
        on_rim = np.zeros(size, dtype=bool)
        on_rim[along] = True
        first = np.concatenate([edges, edges[:, ::-1]])
        first = first[~on_rim[first[:, 0]]]
        pairs = np.concatenate([first, along, along[:, ::-1]])
    else:
        pairs = np.concatenate([edges, edges[:, ::-1]])
    # Each pair once; numbers are sorted several times as fast as pairs.
    pairs = np.stack(np.divmod(np.unique(pairs[:, 0] * size + pairs[:, 1]), size), axis=1)
    links = csr_array((np.ones(len(pairs)), pairs.T), shape=(size, size))
    counts = np.asarray(links.sum(axis=1)).reshape(-1)
    # A vertex that no triangle uses is its own mean.
    alone = diags_array((counts == 0).astype(np.float64), format="csr")
    means: csr_array = (diags_array(1 / np.maximum(counts, 1), format="csr") @ links + alone).tocsr()
    return means
