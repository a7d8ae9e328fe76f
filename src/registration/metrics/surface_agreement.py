"""Agreement of two reconstructions of one vessel, over all of both and over the part that both show.

Open ends lie where a sweep happened to stop. A place whose nearest point on the other surface is on the rim of an open
end has no counterpart there: a partial sweep's two-sided distance measures coverage, not shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from registration.brief import brief_repr
from registration.checks import require_count
from registration.errors import InputError
from registration.geometry.mesh_topology import borders
from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh

# A nearest point whose weights on the corners away from a rim add up to less lies on the rim.
ON_RIM = 1e-4


@dataclass(frozen=True)
class SurfaceAgreement:
    """Distances from points of one surface to the triangles of the other, both ways.

    Parameters
    ----------
    msd_mm : float
        Mean of both directions' mean distances in mm.
    hd95_mm : float
        Larger of both directions' 95th percentiles in mm.
    msd_covered_mm, hd95_covered_mm : float
        The same in mm over the places that have a counterpart on the other surface.
    covered_first, covered_second : float
        Share of each surface that has a counterpart.
    """

    msd_mm: float
    hd95_mm: float
    msd_covered_mm: float
    hd95_covered_mm: float
    covered_first: float
    covered_second: float

    __repr__ = brief_repr


@dataclass(frozen=True)
class Counterparts:
    """Nearest place on a surface to each of n points.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Nearest place in mm.
    apart_mm : ndarray, shape (n,)
        Distance to it in mm.
    covered : ndarray of bool, shape (n,)
        False where it lies on the rim of an open end, so that the point has no counterpart.
    """

    points_mm: Float64[np.ndarray, "n 3"]
    apart_mm: Float64[np.ndarray, " n"]
    covered: Bool[np.ndarray, " n"]


def surface_agreement(first: Mesh, second: Mesh, *, samples: int = 10_000, seed: int = 0) -> SurfaceAgreement:
    """Compare two surfaces in one coordinate frame.

    Parameters
    ----------
    first, second : Mesh
        Surfaces in mm.
    samples : int, optional
        Number of points of each, drawn uniformly by area.
    seed : int, optional
        Seed of the draw.

    Returns
    -------
    SurfaceAgreement
        Distances and covered shares.

    Raises
    ------
    InputError
        If a surface has no area, or the two have no common part.
    """
    require_count("samples", samples, 1)
    draws = np.random.default_rng(seed).spawn(2)
    there = counterparts(first.sample(samples, draws[0]), second)
    back = counterparts(second.sample(samples, draws[1]), first)
    if not (there.covered.any() and back.covered.any()):
        raise InputError("surfaces: expected two that show a common part, received none")
    both_mm = [side.apart_mm[side.covered] for side in (there, back)]
    return SurfaceAgreement(
        msd_mm=float(0.5 * (there.apart_mm.mean() + back.apart_mm.mean())),
        hd95_mm=float(max(np.percentile(side.apart_mm, 95) for side in (there, back))),
        msd_covered_mm=float(0.5 * sum(apart_mm.mean() for apart_mm in both_mm)),
        hd95_covered_mm=float(max(np.percentile(apart_mm, 95) for apart_mm in both_mm)),
        covered_first=float(there.covered.mean()),
        covered_second=float(back.covered.mean()),
    )


def counterparts(points_mm: Float64[np.ndarray, "n 3"], surface: Mesh) -> Counterparts:
    """Find the place on the triangles that is nearest to each point, by Open3D's ray-casting scene.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.
    surface : Mesh
        Surface in the same coordinate frame.

    Returns
    -------
    Counterparts
        Nearest places, distances and coverage.
    """
    found = TriangleScene(surface).closest(points_mm)
    apart_mm = np.linalg.norm(found.offsets_mm, axis=1)
    on_rim = np.zeros(len(surface.vertices_mm), dtype=bool)
    for border in borders(surface):
        on_rim[border.edges] |= border.is_end
    second, third = found.second_third.T
    weights = np.stack([1 - second - third, second, third], axis=1)
    corners = surface.triangles[found.triangles]
    away = (weights * ~on_rim[corners]).sum(axis=1)
    return Counterparts(found.places_mm, apart_mm, away > ON_RIM)
