"""Surfaces by way of a volume: signed distances to the contours of each mask, interpolated between masks."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree

from registration import transforms
from registration.checks import require_positive
from registration.errors import InputError
from registration.geometry.mesh_topology import largest_piece
from registration.geometry.point_cloud import OrientedCloud, require_oriented
from registration.geometry.shapes import Mesh
from registration.reconstruction.contours import ContourCloud
from registration.reconstruction.open_ends import measured_part

# Cells of the volume past the outermost contours, so that the surface does not close too early.
MARGIN_CELLS = 3
MAX_CELLS = 2e8


@dataclass(frozen=True)
class SignedDistanceSurface:
    """Marching cubes on signed distances measured in each image plane and interpolated between planes.

    Parameters
    ----------
    cell_mm : float
        Edge length of the cells of the volume in mm.
    bridge_mm : float
        Planes farther apart in mm are not interpolated; ends are cut as by ``PoissonSurface``.
    largest : bool, optional
        Whether only the largest connected piece is kept.

    Raises
    ------
    InputError
        If a length is not positive.

    Notes
    -----
    Each cell between two image planes takes the distances to the contours of both, each in its own plane,
    weighted by how near the planes are. No normals between planes are assumed, and vessels may join and part.
    Past the first and the last plane and past the image border the surface is cut.

    References
    ----------
    S. P. Raya and J. K. Udupa, IEEE TMI 9(1), 1990; G. M. Treece et al., Med. Image Anal. 4, 2000 (freehand
    sweeps); T. Lewiner et al., J. Graph. Tools 8(2), 2003 (marching cubes).
    """

    cell_mm: float
    bridge_mm: float
    largest: bool = True

    def __post_init__(self) -> None:
        require_positive("cell_mm", self.cell_mm)
        require_positive("bridge_mm", self.bridge_mm)

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """Reconstruct the surface of the vessel.

        Parameters
        ----------
        cloud : OrientedCloud
            Contours with the masks they come from, a ``ContourCloud``.

        Returns
        -------
        Mesh
            The surface in world mm, oriented outwards.

        Raises
        ------
        InputError
            If the cloud is no ``ContourCloud``, has contours of fewer than two masks or without an inside, or
            is too large for its cells.
        """
        from skimage.measure import marching_cubes

        if not isinstance(cloud, ContourCloud):
            raise InputError("cloud: expected contours with their frames, received points alone")
        require_oriented(cloud)
        slices = _slices(cloud, self.bridge_mm)
        volume = _Volume.around(slices, self.cell_mm)
        for before, after in itertools.pairwise(slices):
            volume.blend(before, after, self.bridge_mm)
        volume.extend(slices[0], -1)
        volume.extend(slices[-1], 1)
        known = volume.weight > 0
        values_mm = np.where(known, volume.total_mm / np.maximum(volume.weight, 1), np.nan)
        if not (np.nanmin(values_mm, initial=np.inf) < 0 < np.nanmax(values_mm, initial=-np.inf)):
            raise InputError("cloud: expected contours around a vessel, received none with an inside")
        vertices, triangles, _, _ = marching_cubes(
            np.where(known, values_mm, 1.0), 0.0, mask=known, gradient_direction="descent"
        )
        mesh = Mesh(volume.places_mm(vertices.astype(np.float64)), triangles.astype(np.int64))
        mesh = measured_part(mesh, cloud, self.bridge_mm)
        return largest_piece(mesh) if self.largest else mesh


@dataclass(frozen=True)
class _Slice:
    """One frame's contours in the sweep's own axes: z runs along the sweep, the plane is ``normal @ p = offset_mm``."""

    points_mm: Float64[np.ndarray, "p 3"]
    outwards: Float64[np.ndarray, "p 3"]
    normal: Float64[np.ndarray, "3"]
    offset_mm: float
    sweep_T_world: Float64[np.ndarray, "4 4"]
    tree: cKDTree

    def height_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """How far points lie ahead of the plane."""
        return points_mm @ self.normal - self.offset_mm

    def distance_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Signed distance in the plane to the contours, from where each point projects to; negative inside."""
        projected_mm = points_mm - self.height_mm(points_mm)[:, None] * self.normal
        apart_mm, nearest = self.tree.query(projected_mm)
        ahead_mm = np.einsum("ni,ni->n", projected_mm - self.points_mm[nearest], self.outwards[nearest])
        return np.where(ahead_mm < 0, -apart_mm, apart_mm)


def _slices(cloud: ContourCloud, bridge_mm: float) -> list[_Slice]:
    used = np.unique(cloud.frame_index)
    if len(used) < 2:
        raise InputError(f"cloud: expected contours of at least two frames, received {len(used)}")
    normals = np.cross(cloud.world_A_pixel[used, :3, 0], cloud.world_A_pixel[used, :3, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    middle_mm = np.array([cloud.points_mm[cloud.frame_index == frame].mean(axis=0) for frame in used])
    # The frames may be numbered against the direction of their normals.
    along = middle_mm[-1] - middle_mm[0]
    normals *= np.sign(normals @ along)[:, None]
    sweep_T_world = _sweep_axes(normals, cloud.world_A_pixel[used[0], :3, 0], cloud.points_mm[0])
    rotation = sweep_T_world[:3, :3]
    placed_mm = transforms.apply(sweep_T_world, cloud.points_mm)
    slices = []
    for normal, frame in zip(normals @ rotation.T, used, strict=True):
        own = cloud.frame_index == frame
        slices.append(
            _Slice(
                placed_mm[own],
                cloud.normals[own] @ rotation.T,
                normal,
                float((placed_mm[own] @ normal).mean()),
                sweep_T_world,
                cKDTree(placed_mm[own]),
            )
        )
    return slices


def _sweep_axes(
    normals: Float64[np.ndarray, "m 3"], across: Float64[np.ndarray, "3"], origin_mm: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "4 4"]:
    """Axes of a grid whose layers lie along the frames, so that two frames enclose few layers of it."""
    last = normals.mean(axis=0)
    last /= np.linalg.norm(last)
    first = across - (across @ last) * last
    first /= np.linalg.norm(first)
    world_T_sweep = np.eye(4)
    world_T_sweep[:3, :3] = np.column_stack([first, np.cross(last, first), last])
    world_T_sweep[:3, 3] = origin_mm
    return transforms.invert_rigid(world_T_sweep)


@dataclass(frozen=True)
class _Volume:
    """Sums of distances and how many went into each cell, on a grid in the sweep's axes."""

    total_mm: Float64[np.ndarray, "a b c"]
    weight: Int64[np.ndarray, "a b c"]
    low_mm: Float64[np.ndarray, "3"]
    cell_mm: float
    sweep_T_world: Float64[np.ndarray, "4 4"]

    @classmethod
    def around(cls, slices: list[_Slice], cell_mm: float) -> _Volume:
        points_mm = np.concatenate([piece.points_mm for piece in slices])
        low_mm = points_mm.min(axis=0) - MARGIN_CELLS * cell_mm
        shape = np.ceil((points_mm.max(axis=0) - low_mm) / cell_mm).astype(int) + MARGIN_CELLS + 1
        if shape.prod() > MAX_CELLS:
            raise InputError(f"cell_mm: expected at most {MAX_CELLS:g} cells, received {shape.prod():g}")
        total_mm, weight = np.zeros(shape), np.zeros(shape, dtype=np.int64)
        return cls(total_mm, weight, low_mm, cell_mm, slices[0].sweep_T_world)

    def blend(self, before: _Slice, after: _Slice, bridge_mm: float) -> None:
        """Fill the cells between two frames."""
        index, places_mm = self._cells(np.concatenate([before.points_mm, after.points_mm]), 1.0)
        past_mm, ahead_mm = before.height_mm(places_mm), -after.height_mm(places_mm)
        gap_mm = past_mm + ahead_mm
        # Frames whose poses are noisy may lie in the wrong order: then both are negative.
        between = (past_mm * ahead_mm >= 0) & (np.abs(gap_mm) <= bridge_mm)
        share = past_mm[between] / np.where(gap_mm[between] == 0, 1.0, gap_mm[between])
        distance_mm = (1 - share) * before.distance_mm(places_mm[between])
        distance_mm += share * after.distance_mm(places_mm[between])
        self._add(index[between], distance_mm)

    def extend(self, last: _Slice, side: int) -> None:
        """Carry the first (side -1) or last (side 1) frame on for a few cells, for the surface to be cut there."""
        index, places_mm = self._cells(last.points_mm, float(MARGIN_CELLS))
        past_mm = side * last.height_mm(places_mm)
        beyond = (past_mm >= 0) & (past_mm <= MARGIN_CELLS * self.cell_mm)
        self._add(index[beyond], last.distance_mm(places_mm[beyond]))

    def places_mm(self, vertices: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """From places on the grid to the world."""
        world_T_sweep = transforms.invert_rigid(self.sweep_T_world)
        return transforms.apply(world_T_sweep, self.low_mm + self.cell_mm * vertices)

    def _cells(self, points_mm: np.ndarray, layers: float) -> tuple[np.ndarray, np.ndarray]:
        """Cells of the box around points, and some layers more."""
        margin_mm = self.cell_mm * np.array([MARGIN_CELLS, MARGIN_CELLS, layers])
        low = np.floor((points_mm.min(axis=0) - margin_mm - self.low_mm) / self.cell_mm).astype(int)
        high = np.ceil((points_mm.max(axis=0) + margin_mm - self.low_mm) / self.cell_mm).astype(int) + 1
        low, high = np.maximum(low, 0), np.minimum(high, self.weight.shape)
        ranges = [np.arange(low[axis], high[axis]) for axis in range(3)]
        index = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
        return index, self.low_mm + self.cell_mm * index

    def _add(self, index: np.ndarray, distance_mm: np.ndarray) -> None:
        cells = tuple(index.T)
        self.total_mm[cells] += distance_mm
        self.weight[cells] += 1
