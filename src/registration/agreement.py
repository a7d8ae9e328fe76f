"""How far two reconstructions of one vessel agree, over all of both and over the part that both show.

Open ends lie where a sweep happened to stop. A place whose nearest point on the other surface is on the rim of an open
end has no counterpart there: a partial sweep's two-sided distance measures coverage, not shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from registration.checks import require_count
from registration.errors import InputError
from registration.geometry import Mesh
from registration.mesh_topology import borders

# A nearest point whose weights on the corners away from a rim add up to less lies on the rim.
ON_RIM = 1e-4


@dataclass(frozen=True)
class SurfaceAgreement:
    """Distances from point to triangle between two surfaces, both ways, in mm.

    ``msd_mm`` is the mean of both directions' mean distances, ``hd95_mm`` the larger of both directions' 95th
    percentiles; ``msd_covered_mm`` and ``hd95_covered_mm`` are the same over the places that have a counterpart on the
    other surface. ``covered_first`` and ``covered_second`` are the shares of each surface that do.
    """

    msd_mm: float
    hd95_mm: float
    msd_covered_mm: float
    hd95_covered_mm: float
    covered_first: float
    covered_second: float


@dataclass(frozen=True)
class Counterparts:
    """The nearest place on a surface to each of n points.

    ``points_mm`` (n, 3) and how far it is, ``apart_mm`` (n,); ``covered`` (n,) is False where it lies on the rim of an
    open end, so that the point has no counterpart.
    """

    points_mm: Float64[np.ndarray, "n 3"]
    apart_mm: Float64[np.ndarray, "n"]
    covered: Bool[np.ndarray, "n"]


def surface_agreement(first: Mesh, second: Mesh, *, samples: int = 10_000, seed: int = 0) -> SurfaceAgreement:
    """Compare two surfaces in one frame at ``samples`` places of each, drawn uniformly by area from ``seed``.

    Raises InputError for surfaces without area or without any common part.
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
    """Find the place on the triangles that is nearest to each point, by Open3D's ray-casting scene."""
    open3d = _open3d()
    # Single precision: coordinates are counted from the surface's middle.
    middle_mm = surface.vertices_mm.mean(axis=0)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor((surface.vertices_mm - middle_mm).astype(np.float32)),
        open3d.core.Tensor(surface.triangles.astype(np.uint32)),
    )
    queried_mm = (points_mm - middle_mm).astype(np.float32)
    found = scene.compute_closest_points(open3d.core.Tensor(queried_mm))
    places_mm = found["points"].numpy().astype(np.float64)
    apart_mm = np.linalg.norm(places_mm - queried_mm, axis=1)
    on_rim = np.zeros(len(surface.vertices_mm), dtype=bool)
    for border in borders(surface):
        on_rim[border.edges] |= border.is_end
    second, third = found["primitive_uvs"].numpy().astype(np.float64).T
    weights = np.stack([1 - second - third, second, third], axis=1)
    corners = surface.triangles[found["primitive_ids"].numpy().astype(np.int64)]
    away = (weights * ~on_rim[corners]).sum(axis=1)
    return Counterparts(places_mm + middle_mm, apart_mm, away > ON_RIM)


def _open3d() -> Any:
    """Open3D, imported only where triangles are measured: it takes a second, and its type stubs are not right."""
    import open3d

    return open3d
