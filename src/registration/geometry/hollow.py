"""Hollow bodies: a surface with an outer and an inner wall, as a printed phantom has, and the lumen inside it.

The centerline of such a surface would run inside the material. Joined at their ends, the two walls of a tube are one
closed surface of genus 1, those of a fork one of genus 2, those of a tube closed at one end one of genus 0; walls that
are not joined are two nested pieces. A vessel that closes to a loop has genus 1 too, and its hole is no lumen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from registration.errors import InputError
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.mesh_topology import (
    borders,
    directed_edges,
    edge_numbers,
    keep_triangles,
    largest_piece,
    pieces,
    with_caps,
)
from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.outward_rays import OutwardRays
from registration.geometry.shapes import Mesh

# A cavity or hole is the lumen if it is this share of the body's length or more, and none below the second share. The
# hole of a ring with a round section is always shorter than half of the ring's width.
LUMEN_SHARE, NO_LUMEN_SHARE = 0.7, 0.5
# Pieces and patches of less than this share of the area are no walls of a vessel.
MIN_AREA_SHARE = 0.05
# Rays along normals that show whether a surface faces itself.
SCREENING_RAYS = 4000
# With no hole through it, a surface that faces itself on less than this share of its area has no inner wall.
FACING_SHARE = 0.15
# From inside a lumen less than half of the sky is seen, and half of it at the mouth, give or take a few directions;
# from the rim and the outer wall far more.
MAX_SKY_SHARE = 0.6
# Of the rays across a lumen most meet the lumen's own wall, at about its diameter.
MIN_OWN_SHARE, DIAMETER_RANGE = 0.8, (0.6, 1.7)


@dataclass(frozen=True)
class Lumen:
    """The inner wall of a hollow body.

    Parameters
    ----------
    mesh : Mesh
        Inner wall, wound out of the lumen and open at its mouths.
    joined : bool
        Whether inner and outer wall were one surface, not two nested pieces.
    genus : int
        Genus of that surface.
    """

    mesh: Mesh
    joined: bool
    genus: int

    @property
    def described(self) -> str:
        """What was found and taken, in a sentence."""
        walls = f"joined to one surface of genus {self.genus}" if self.joined else "in pieces of their own"
        return f"The surface is a hollow body, its outer and inner wall {walls}: the inner wall was taken, the lumen's."

    def record(self) -> dict[str, bool | int]:
        """Describe how the lumen was found, for a file of results.

        Returns
        -------
        dict
            ``walls_joined`` and ``genus``.
        """
        return {"walls_joined": self.joined, "genus": self.genus}


@dataclass(frozen=True)
class _Sizes:
    """Radius and length of a tube with the volume and the wall of a surface, and the longest side of its box."""

    radius_mm: float
    length_mm: float
    extent_mm: float

    @classmethod
    def of(cls, mesh: Mesh) -> _Sizes:
        area_mm2 = float(mesh.areas_mm2.sum())
        radius_mm = 2 * abs(enclosed_volume_mm3(mesh)) / max(area_mm2, 1e-300)
        length_mm = area_mm2 / (2 * np.pi * max(radius_mm, 1e-300))
        own_mm = mesh.vertices_mm[np.unique(mesh.triangles)]
        axes = np.linalg.svd(own_mm - own_mm.mean(axis=0), full_matrices=False)[2]
        return cls(radius_mm, length_mm, float(np.ptp(own_mm @ axes.T, axis=0).max()))


def vessel_surface(mesh: Mesh) -> Mesh:
    """Take the lumen of a hollow body, or the largest piece of any other surface.

    Parameters
    ----------
    mesh : Mesh
        Closed or open surface in mm.

    Returns
    -------
    Mesh
        Surface of the vessel.

    Raises
    ------
    InputError
        As ``find_lumen``.
    """
    found = find_lumen(mesh)
    return largest_piece(mesh) if found is None else found.mesh


def genus(mesh: Mesh) -> int:
    """Count the handles of one piece of surface, its borders closed (Euler: V - E + F = 2 - 2 g).

    Parameters
    ----------
    mesh : Mesh
        Surface in one piece.

    Returns
    -------
    int
        Genus; a bound where edges have more than two triangles, for which there is no genus.
    """
    numbers = np.unique(edge_numbers(directed_edges(mesh), len(mesh.vertices_mm)))
    euler = len(np.unique(mesh.triangles)) - len(numbers) + len(mesh.triangles) + len(borders(mesh))
    return max((2 - euler) // 2, 0)


def find_lumen(mesh: Mesh) -> Lumen | None:
    """Find the lumen of a hollow body.

    Parameters
    ----------
    mesh : Mesh
        Surface whose triangles are wound alike within a piece, on either side.

    Returns
    -------
    Lumen or None
        Inner wall, or None where the surface has one wall.

    Raises
    ------
    InputError
        If the body has several inner walls, or one that may or may not be a lumen.
    """
    if not len(mesh.triangles):
        return None
    nested = _nested(mesh)
    if nested is not None:
        return Lumen(_outwards(nested), False, genus(nested))
    return _joined(_outwards(largest_piece(mesh)))


def _nested(mesh: Mesh) -> Mesh | None:
    """The piece inside the piece of greatest volume that is as long as it; None where there is none."""
    count, of_triangle = pieces(mesh)
    if count < 2:
        return None
    areas_mm2 = np.bincount(of_triangle, weights=mesh.areas_mm2)
    large = np.flatnonzero(areas_mm2 >= MIN_AREA_SHARE * areas_mm2.max())
    parts = [keep_triangles(mesh, of_triangle == one) for one in large]
    parts.sort(key=lambda part: -abs(enclosed_volume_mm3(part)))
    outer = parts[0]
    inside = [part for part in parts[1:] if _lies_in(part, outer)]
    # What lies in a lumen (a catheter) is no lumen of its own.
    inside = [part for i, part in enumerate(inside) if not any(_lies_in(part, one) for one in inside[:i])]
    lumens = [part for part in inside if _is_lumen(_Sizes.of(part), outer)]
    if len(lumens) > 1:
        raise InputError(
            f"surface: expected one lumen in a hollow body, received {len(lumens)} cavities that run along it: pass "
            "the inner wall of one of them alone"
        )
    return lumens[0] if lumens else None


def _is_lumen(sizes: _Sizes, body: Mesh) -> bool:
    """Whether a cavity or hole runs along a body; raises InputError where it does so in part."""
    along_mm = min(sizes.length_mm, sizes.extent_mm if sizes.length_mm > 2 * sizes.radius_mm else np.inf)
    extent_mm = _Sizes.of(body).extent_mm
    if along_mm >= LUMEN_SHARE * extent_mm:
        return True
    if along_mm <= NO_LUMEN_SHARE * extent_mm:
        return False
    raise InputError(
        f"surface: expected a vessel or a hollow body with a lumen along all of it, received a cavity or hole "
        f"{along_mm:.3g} mm long and {2 * sizes.radius_mm:.3g} mm wide in a body {extent_mm:.3g} mm long: pass the "
        "lumen's wall alone"
    )


def _lies_in(part: Mesh, outer: Mesh) -> bool:
    """Whether most of a piece lies inside another, whose open ends count as closed."""
    closed = with_caps(outer, borders(outer))
    return float(TriangleScene(closed).occupied(part.sample(500, np.random.default_rng(0))).mean()) > 0.5


def _joined(body: Mesh) -> Lumen | None:
    """The inner wall of one piece, where that piece is the wall of a hollow body."""
    rays = OutwardRays(body)
    handles = genus(body)
    chosen = np.random.default_rng(0).choice(
        len(body.triangles), min(SCREENING_RAYS, len(body.triangles)), replace=False
    )
    weights = body.areas_mm2[chosen]
    facing = float((weights * np.isfinite(rays.across(chosen)[0])).sum() / max(weights.sum(), 1e-300))
    if facing < (MIN_AREA_SHARE if handles else FACING_SHARE):
        return None
    hidden = rays.sky(np.arange(len(body.triangles))) < MAX_SKY_SHARE
    if not hidden.any():
        return None
    own = np.flatnonzero(hidden)
    of_own = pieces(keep_triangles(body, hidden))[1]
    found = []
    for one in range(int(of_own.max()) + 1):
        patch = own[of_own == one]
        wall = _without_islands(body, patch)
        if wall is not None and _is_tube(body, rays, wall) and _is_lumen(_Sizes.of(_inner(body, wall)), body):
            found.append(wall)
    if len(found) > 1:
        raise InputError(
            f"surface: expected one lumen in a hollow body, received {len(found)} holes that run along it: pass the "
            "wall of one of them alone"
        )
    return Lumen(_inner(body, found[0]), True, handles) if found else None


def _inner(body: Mesh, wall: Int64[np.ndarray, " w"]) -> Mesh:
    """Triangles of the inner wall, turned so that they face out of the lumen and not out of the material."""
    chosen = np.zeros(len(body.triangles), dtype=bool)
    chosen[wall] = True
    part = keep_triangles(body, chosen)
    return Mesh(part.vertices_mm, np.ascontiguousarray(part.triangles[:, ::-1]))


def _without_islands(body: Mesh, patch: Int64[np.ndarray, " p"]) -> Int64[np.ndarray, " w"] | None:
    """A patch with what it surrounds; None for one too small to be a wall."""
    areas_mm2 = body.areas_mm2
    if areas_mm2[patch].sum() < MIN_AREA_SHARE * areas_mm2.sum():
        return None
    rest = np.ones(len(body.triangles), dtype=bool)
    rest[patch] = False
    if not rest.any():
        return patch
    others, of_rest = pieces(keep_triangles(body, rest))
    if others < 2:
        return patch
    # The outer wall is what is left, as one piece; anything small next to it that touches the patch lies within.
    small = np.bincount(of_rest, weights=areas_mm2[rest]) < 0.5 * MIN_AREA_SHARE * areas_mm2[patch].sum()
    touched = np.zeros(len(body.vertices_mm), dtype=bool)
    touched[body.triangles[patch]] = True
    near = np.bincount(of_rest, weights=touched[body.triangles[rest]].any(axis=1)) > 0
    return np.sort(np.concatenate([patch, np.flatnonzero(rest)[(small & near)[of_rest]]]))


def _outwards(mesh: Mesh) -> Mesh:
    if enclosed_volume_mm3(mesh) >= 0:
        return mesh
    return Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.triangles[:, ::-1]))


def _is_tube(body: Mesh, rays: OutwardRays, wall: Int64[np.ndarray, " w"]) -> bool:
    """Whether a wall faces itself all around, across the width of a tube with its volume and area."""
    apart_mm, met = rays.across(wall)
    weights = body.areas_mm2[wall]
    own = np.isfinite(apart_mm) & np.isin(met, wall)
    if weights[own].sum() < MIN_OWN_SHARE * weights.sum():
        return False
    order = np.argsort(apart_mm[own])
    total = np.cumsum(weights[own][order])
    median_mm = float(apart_mm[own][order][np.searchsorted(total, 0.5 * total[-1])])
    width_mm = 2 * _Sizes.of(_inner(body, wall)).radius_mm
    return DIAMETER_RANGE[0] * width_mm <= median_mm <= DIAMETER_RANGE[1] * width_mm
