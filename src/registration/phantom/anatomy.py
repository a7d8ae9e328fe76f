"""What lies under the probe: a vessel, its surface, and the skin above it.

An anatomy has a frame of its own, ``bed``: the vessel runs along z, the skin is the plane ``y = skin_y_mm``, the probe
on it looks along +y. For designed and random vessels it is the ct frame; a user's mesh keeps its own ct frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.phantom.designed_shapes import DESIGNS, SKIN_Y_MM
from registration.phantom.distance import DistanceGrid, distance_grid
from registration.phantom.random_anatomy import draw_lines
from registration.phantom.settings import MESH, RANDOM, PhantomSettings
from registration.phantom.shapes import VesselLine, outward, surround

# How deep the nearest wall of a user's mesh is laid below the skin.
COVER_MM = 11.0
GUIDE_STEP_MM = 2.0


@dataclass(frozen=True)
class Anatomy:
    """Vessel as it was when the CT was taken: the truth that images are made from, in the bed frame.

    Parameters
    ----------
    surface : Mesh
        Closed surface of the vessel in mm.
    centerline : Centerline or None
        Centerline with the largest inscribed radius; None for a user's mesh.
    distance : DistanceGrid
        Signed distance to the surface in mm.
    skin_y_mm : float
        Height y of the skin plane in mm.
    squeeze : float
        Share of its depth by which the probe's full pressure flattens the vessel.
    ct_T_bed : ndarray, shape (4, 4)
        Rigid transform from the bed to the ct frame, in mm.
    """

    surface: Mesh
    centerline: Centerline | None
    distance: DistanceGrid
    skin_y_mm: float
    squeeze: float
    ct_T_bed: Float64[np.ndarray, "4 4"]

    @property
    def guide_mm(self) -> Float64[np.ndarray, "g 3"]:
        """Centre of the bounding box of all vertices at one height z, at even steps along the vessel, in mm."""
        vertices_mm = self.surface.vertices_mm
        bins = np.floor(vertices_mm[:, 2] / GUIDE_STEP_MM).astype(int)
        levels = np.unique(bins)
        low = np.array([vertices_mm[bins == level, :2].min(axis=0) for level in levels])
        high = np.array([vertices_mm[bins == level, :2].max(axis=0) for level in levels])
        return np.column_stack([0.5 * (low + high), (levels + 0.5) * GUIDE_STEP_MM])


def anatomy_of(settings: PhantomSettings) -> Anatomy:
    """Return the anatomy that the settings choose.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.

    Returns
    -------
    Anatomy
        The anatomy; recent ones are cached until a mesh file changes.
    """
    changed = Path(settings.mesh).stat().st_mtime_ns if settings.mesh and Path(settings.mesh).is_file() else 0
    return _chosen(settings.subset, settings.anatomy_seed, str(settings.mesh), changed)


@lru_cache(maxsize=4)
def _chosen(subset: str, seed: int, mesh: str, changed: int) -> Anatomy:
    del changed
    if subset == MESH:
        return from_mesh(Path(mesh))
    lines = draw_lines(seed) if subset == RANDOM else DESIGNS[subset]()
    return from_lines(lines, SKIN_Y_MM, squeeze=0.25 if subset == "vein" else 0.05)


def from_lines(lines: tuple[VesselLine, ...], skin_y_mm: float, squeeze: float = 0.05) -> Anatomy:
    """Build the anatomy around given vessel lines.

    Parameters
    ----------
    lines : tuple of VesselLine
        Vessel lines in the bed frame.
    skin_y_mm : float
        Height y of the skin plane in mm; it must lie in front of every wall.
    squeeze : float, optional
        Share of its depth by which full pressure flattens the vessel.

    Returns
    -------
    Anatomy
        The anatomy, whose bed frame is the ct frame.

    Raises
    ------
    InputError
        If the skin does not lie in front of the vessel.
    """
    surface = surround(lines)
    nearest_mm = float(surface.vertices_mm[:, 1].min())
    if nearest_mm <= skin_y_mm:
        raise InputError(
            f"skin_y_mm: expected the skin in front of the vessel (below {nearest_mm:.1f} mm), "
            f"received {skin_y_mm:g} mm"
        )
    centerline = Centerline(
        tuple(
            Polyline(line.points_mm[::5], (line.radius_mm * np.minimum(1.0, line.widening))[::5])
            for line in lines
        )
    )
    return Anatomy(surface, centerline, distance_grid(surface), skin_y_mm, squeeze, np.eye(4))


def from_mesh(path: Path) -> Anatomy:
    """Place a user's closed surface under the skin, its longest axis along the sweep, its flattest facing up.

    Parameters
    ----------
    path : Path
        Surface file with coordinates in mm.

    Returns
    -------
    Anatomy
        The anatomy, without a centerline.

    Raises
    ------
    InputError
        If the file holds no triangles or the surface has open edges.
    """
    from registration.io.surfaces import read_surface

    mesh = read_surface(path)
    if not isinstance(mesh, Mesh):
        raise InputError(f"mesh: expected a surface with triangles in {path}, received points alone")
    if not is_closed(mesh):
        raise InputError(f"mesh: expected a closed surface in {path}, received one with open edges")
    middle_mm = 0.5 * (mesh.vertices_mm.min(axis=0) + mesh.vertices_mm.max(axis=0))
    _, _, axes = np.linalg.svd(mesh.vertices_mm - mesh.vertices_mm.mean(axis=0), full_matrices=False)
    ct_T_bed = np.eye(4)
    ct_T_bed[:3, :3] = np.column_stack([axes[1], axes[2], np.cross(axes[1], axes[2])])
    ct_T_bed[:3, 3] = middle_mm
    placed_mm = transforms.apply(transforms.invert_rigid(ct_T_bed), mesh.vertices_mm)
    surface = outward(Mesh(placed_mm, mesh.triangles))
    skin_y_mm = float(placed_mm[:, 1].min()) - COVER_MM
    return Anatomy(surface, None, distance_grid(surface), skin_y_mm, 0.05, ct_T_bed)


def is_closed(mesh: Mesh) -> bool:
    """Return whether every edge is shared by exactly two triangles that run along it in opposite directions.

    Parameters
    ----------
    mesh : Mesh
        Triangle surface.

    Returns
    -------
    bool
        True for a closed, consistently oriented surface.
    """
    corners = mesh.triangles
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    forward = np.sort(edges @ np.array([len(mesh.vertices_mm), 1]))
    backward = np.sort(edges[:, ::-1] @ np.array([len(mesh.vertices_mm), 1]))
    return len(np.unique(forward)) == len(forward) and np.array_equal(forward, backward)
