"""Connected pieces of a surface that belong to one vessel, where a gap in a sweep has divided it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from registration.brief import brief_repr
from registration.checks import require_at_least, require_positive
from registration.geometry.mesh_topology import Border, borders, keep_triangles, largest_piece, pieces
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance

# Cosine of 60 degrees, the largest angle between two ends that face each other.
MIN_OPPOSING_COSINE = 0.5
# An end lies on the axis of another to within its radius and this share of the gap, about 30 degrees.
BEND_SHARE = 0.6
# Largest ratio of the radii of two ends: where a vessel divides in a gap, a branch follows the trunk.
MAX_RADIUS_RATIO = 3.0
# Largest distance, in its radii, of the end of a branch from the wall it leaves; the branch is at least as long.
BRANCH_RADII = 2.0


@dataclass(frozen=True)
class KeptPieces:
    """Result of selecting the pieces of one vessel.

    Parameters
    ----------
    mesh : Mesh
        The pieces that were kept.
    kept, dropped : int
        Numbers of pieces.
    area_mm2, area_dropped_mm2 : float
        Areas in mm^2 of the pieces that were kept and of the others.
    """

    mesh: Mesh
    kept: int
    dropped: int
    area_mm2: float
    area_dropped_mm2: float

    __repr__ = brief_repr

    @property
    def share_dropped(self) -> float:
        """Share of the area that was dropped, 0 to 1."""
        return self.area_dropped_mm2 / max(self.area_mm2 + self.area_dropped_mm2, 1e-300)


@dataclass(frozen=True)
class VesselPieces:
    """Selection of the largest piece of a surface and all pieces that continue it.

    A piece continues another where an open end of one faces an open end of the other: on its axis, of similar
    width and near. So does a branch whose open end lies close before the wall of the other.

    Parameters
    ----------
    gap_radii : float, optional
        Widest gap between two open ends that face each other, in their radii.
    min_area_share : float, optional
        Pieces of a smaller share of the total area are dropped, as are those shorter than half their radius.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    gap_radii: float = 12.0
    min_area_share: float = 0.01

    def __post_init__(self) -> None:
        require_positive("gap_radii", self.gap_radii)
        require_at_least("min_area_share", self.min_area_share, 0.0)

    def __call__(self, mesh: Mesh) -> KeptPieces:
        """Keep the pieces of one vessel.

        Parameters
        ----------
        mesh : Mesh
            Surface of any number of pieces.

        Returns
        -------
        KeptPieces
            The pieces that were kept, and what was dropped.
        """
        parts = self.parts(mesh)
        total_mm2 = float(mesh.areas_mm2.sum())
        kept = parts[0] if len(parts) == 1 else _together(parts)
        area_mm2 = float(kept.areas_mm2.sum())
        return KeptPieces(kept, len(parts), pieces(mesh)[0] - len(parts), area_mm2, total_mm2 - area_mm2)

    def parts(self, mesh: Mesh) -> list[Mesh]:
        """Find the pieces of one vessel.

        Parameters
        ----------
        mesh : Mesh
            Surface of any number of pieces.

        Returns
        -------
        list of Mesh
            The pieces, the largest first.
        """
        count, of_triangle = pieces(mesh)
        if count < 2:
            return [mesh]
        areas_mm2 = np.bincount(of_triangle, weights=mesh.areas_mm2)
        order = [
            int(one)
            for one in np.argsort(-areas_mm2)
            if areas_mm2[one] >= self.min_area_share * areas_mm2.sum()
        ]
        found = [_Piece.of(keep_triangles(mesh, of_triangle == one)) for one in order]
        kept, left = found[:1], found[1:]
        while left:
            joining = [one for one in left if any(self._continues(one, other) for other in kept)]
            if not joining:
                break
            kept += joining
            left = [one for one in left if not any(one is other for other in joining)]
        if len(kept) == 1:
            return [largest_piece(mesh)]
        return [one.mesh for one in sorted(kept, key=lambda one: -one.area_mm2)]

    def _continues(self, piece: _Piece, other: _Piece) -> bool:
        if any(piece.length_mm(end) < 0.5 * end.radius_mm for end in piece.ends[:1]):
            return False
        if any(self._faces(end, its) for end in piece.ends for its in other.ends):
            return True
        return any(_branches(piece, end, other) for end in piece.ends) or any(
            _branches(other, end, piece) for end in other.ends
        )

    def _faces(self, end: Border, other: Border) -> bool:
        """Whether two open ends are those of one vessel, on both sides of a gap."""
        radius_mm = max(end.radius_mm, other.radius_mm)
        if radius_mm > MAX_RADIUS_RATIO * min(end.radius_mm, other.radius_mm):
            return False
        if end.normal @ other.normal > -MIN_OPPOSING_COSINE:
            return False
        way_mm = end.centre_mm - other.centre_mm
        gap_mm = float(np.linalg.norm(way_mm))
        if gap_mm > self.gap_radii * radius_mm:
            return False
        for place_mm, normal in ((way_mm, other.normal), (-way_mm, end.normal)):
            ahead_mm = float(place_mm @ normal)
            across_mm = float(np.linalg.norm(place_mm - ahead_mm * normal))
            if ahead_mm < -0.5 * radius_mm or across_mm > 0.5 * radius_mm + BEND_SHARE * gap_mm:
                return False
        return True


@dataclass(frozen=True)
class _Piece:
    mesh: Mesh
    ends: tuple[Border, ...]
    area_mm2: float

    @classmethod
    def of(cls, mesh: Mesh) -> _Piece:
        ends = tuple(border for border in borders(mesh) if border.is_end)
        return cls(mesh, ends, float(mesh.areas_mm2.sum()))

    @cached_property
    def box_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """Its lowest and highest coordinates."""
        return self.mesh.vertices_mm.min(axis=0), self.mesh.vertices_mm.max(axis=0)

    @cached_property
    def distance(self) -> SurfaceDistance:
        """The distance to it, whose search tree is made once for all ends that look at it."""
        return SurfaceDistance(self.mesh)

    def length_mm(self, end: Border) -> float:
        """That of a tube of an end's width with the piece's area."""
        return self.area_mm2 / (2 * np.pi * max(end.radius_mm, 1e-9))


def _branches(branch: _Piece, end: Border, trunk: _Piece) -> bool:
    """Whether an end of one piece lies close before the wall of another, wider one, and looks at it."""
    if branch.length_mm(end) < BRANCH_RADII * end.radius_mm or branch.area_mm2 > trunk.area_mm2:
        return False
    reach_mm = BRANCH_RADII * end.radius_mm
    lowest_mm, highest_mm = trunk.box_mm
    outside_mm = np.maximum(np.maximum(lowest_mm - end.centre_mm, end.centre_mm - highest_mm), 0.0)
    # Farther from its box is farther from it; the margin is for the single precision of the distances.
    if np.linalg.norm(outside_mm) > 1.001 * reach_mm + 1e-3:
        return False
    ahead_mm = end.centre_mm + np.linspace(0, reach_mm, 9)[:, None] * end.normal
    apart_mm = trunk.distance(ahead_mm)
    return bool(apart_mm[0] <= reach_mm and apart_mm.min() <= 0.25 * end.radius_mm)


def _together(parts: list[Mesh]) -> Mesh:
    offset = np.cumsum([0] + [len(part.vertices_mm) for part in parts])
    triangles = [part.triangles + first for part, first in zip(parts, offset, strict=False)]
    return Mesh(np.concatenate([part.vertices_mm for part in parts]), np.concatenate(triangles))
