"""Displacement that brings a model's wall onto swept points: a Gaussian process on distances along the normals.

Points of two samplings of a wall never coincide, so that distances along the wall are noise: a method that closes them
slides along it. Here they are free, and what is known of them comes through the prior: tissue moves smoothly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration.checks import require_at_least, require_count, require_positive, require_positive_each
from registration.deformable.landmark_constraints import LandmarkConstraints, with_landmarks
from registration.rigid.icp.correspondence import principal_axes, search_tree
from registration.rigid.residual_model.compact_blocks import blocks_of
from registration.rigid.residual_model.covariance import CovarianceParts, tried_ratios
from registration.rigid.residual_model.grouped_residuals import GroupedResiduals, averaged, near_surface
from registration.rigid.residual_model.likelihood import Fits, fit_residuals
from registration.rigid.residual_model.model import GROUP_POINTS, GROUPS_PER_UNKNOWN, LIKELY
from registration.rigid.residual_model.posterior import Posterior
from registration.rigid.smoothed_target import SmoothedTarget

# Variances that are tried, over that of a group's noise: those of the displacement, of the borders and of a frame.
# Chosen on deforming anatomies with seeds below 1000.
DISPLACEMENT, BORDER, JITTER = (0.0, 25.0, 125.0), (2.0, 12.0), (2.0,)
# Normals of the displaced wall are taken from so many neighbours.
NEIGHBOURS = 12
# The displacement has settled when no point of the model moves by more than this any more, in mm.
SETTLED_MM = 0.02
# Groups of points without noise are taken to have this one in mm.
LEAST_NOISE_MM = 0.01


@dataclass(frozen=True)
class WallDisplacement:
    """Displacement of a model's wall, given swept points.

    Parameters
    ----------
    posterior : Posterior
        Displacement, its rigid part in it, with its covariance.
    fits : Fits
        Fits under all covariances that were tried.
    residuals : GroupedResiduals
        What they were fitted to: the displacement along the normals that the points ask for.
    iterations : int
        How often points were paired.
    settled : bool
        Whether the pairs have come to rest.
    """

    posterior: Posterior
    fits: Fits
    residuals: GroupedResiduals
    iterations: int
    settled: bool

    @property
    def rigid(self) -> Posterior:
        """The same without a displacement of tissue: where the pose alone may lie."""
        return Posterior(self.residuals, self.fits.chosen(LIKELY, still=True))


@dataclass(frozen=True)
class WallResiduals:
    """Settings of the displacement by distances along the wall's normals.

    Parameters
    ----------
    lengths_mm : sequence of float, optional
        Lengths in mm over which tissue may move together.
    patches : int, optional
        Number of patches of the wall that distances are averaged over, rounded to a power of two.
    wall_offset : bool, optional
        Whether the walls may lie apart by the same distance everywhere.
    min_gain : float, optional
        Smallest gain in restricted log-likelihood by which a deformation is taken to be shown.
    max_iterations : int, optional
        Largest number of times that points are paired.
    inflation, size_doubt : float, optional
        Factor on the standard deviation of the predicted errors, and standard deviation of the logarithm of its size.
        Set so that 90 % intervals hold on deforming anatomies with seeds below 1000.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    lengths_mm: Sequence[float] = (15.0, 25.0, 45.0)
    patches: int = 128
    wall_offset: bool = True
    min_gain: float = 8.0
    max_iterations: int = 5
    inflation: float = 1.1
    size_doubt: float = 0.45

    def __post_init__(self) -> None:
        lengths_mm = require_positive_each("lengths_mm", self.lengths_mm, "length")
        object.__setattr__(self, "lengths_mm", lengths_mm)
        require_count("patches", self.patches, 16)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("min_gain", self.min_gain)
        require_positive("inflation", self.inflation)
        require_at_least("size_doubt", self.size_doubt, 0.0)


def displace_wall(
    wall: SmoothedTarget,
    swept_mm: Float64[np.ndarray, "n 3"],
    settings: WallResiduals,
    frame: Int64[np.ndarray, " n"] | None = None,
    landmarks: LandmarkConstraints | None = None,
) -> WallDisplacement | None:
    """Fit the displacement of a wall to swept points.

    Each swept point is paired with the closest point of the displaced wall and asks for a displacement along the normal
    there. Points are averaged over groups of neighbours, and a Gaussian process is fitted to the averages by restricted
    likelihood; the wall is displaced, and points are paired again. Parts of the wall that no swept point is paired with
    ask for nothing.

    Parameters
    ----------
    wall : SmoothedTarget
        Wall of the model, with normals.
    swept_mm : ndarray, shape (n, 3)
        Swept points in mm, in the frame of the wall.
    settings : WallResiduals
        Settings.
    frame : ndarray of int, shape (n,), or None, optional
        Frame that each swept point was seen in.
    landmarks : LandmarkConstraints or None, optional
        Pairs of points that are the same material; None where none are known.

    Returns
    -------
    WallDisplacement or None
        The displacement; None where too few points lie near the wall.
    """
    jitter = (0.0,) if frame is None else JITTER
    tried = tried_ratios(settings.lengths_mm, DISPLACEMENT, BORDER, jitter)
    neighbours = wall.neighbours_of(NEIGHBOURS)
    moved_mm, normals = wall.points_mm, np.asarray(wall.normals)
    block: np.ndarray | None = None
    found: WallDisplacement | None = None
    for iteration in range(1, settings.max_iterations + 1):
        index = np.asarray(search_tree(moved_mm).batch_nearest_neighbor_search(swept_mm)[0], dtype=np.int64)
        if block is None:
            block = blocks_of(wall.points_mm[index], min(settings.patches, len(swept_mm) // GROUP_POINTS))
        residuals = _asked(
            wall, swept_mm, moved_mm, normals, index, block=block, offset=settings.wall_offset, frame=frame
        )
        if residuals is None or len(residuals.gap_mm) < GROUPS_PER_UNKNOWN * residuals.jacobian.shape[1]:
            return None
        if landmarks is not None:
            residuals = with_landmarks(residuals, landmarks, _noise_mm2(residuals, found))
        fits = fit_residuals(residuals, CovarianceParts(residuals), tried)
        posterior = Posterior(residuals, fits.chosen(LIKELY))
        before_mm, moved_mm = moved_mm, wall.points_mm + posterior.mean_mm(wall.points_mm)
        settled = float(np.abs(moved_mm - before_mm).max()) <= SETTLED_MM
        found = WallDisplacement(posterior, fits, residuals, iteration, settled)
        if settled:
            break
        axes = principal_axes(moved_mm[neighbours])[:, :, 0]
        normals = axes * np.where((axes * normals).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return found


def _noise_mm2(residuals: GroupedResiduals, found: WallDisplacement | None) -> float:
    """Variance of a group's noise: as the last fit has it, and before the first as its points scatter."""
    if found is not None:
        return float(found.fits.noise_mm2[found.fits.best])
    return max(residuals.noise_mm**2 / residuals.group_points, LEAST_NOISE_MM**2)


def _asked(
    wall: SmoothedTarget,
    swept_mm: np.ndarray,
    moved_mm: np.ndarray,
    normals: np.ndarray,
    index: np.ndarray,
    *,
    block: np.ndarray,
    offset: bool,
    frame: np.ndarray | None,
) -> GroupedResiduals | None:
    """What the swept points ask for, in all, at the places of the wall as it was before."""
    away_mm, normal = swept_mm - moved_mm[index], normals[index]
    gap_mm = np.einsum("nk,nk->n", away_mm, normal)
    aside_mm2 = np.maximum(np.einsum("nk,nk->n", away_mm, away_mm) - gap_mm**2, 0.0)
    near = near_surface(gap_mm, aside_mm2, wall.spacing_mm)
    done_mm = np.einsum("nk,nk->n", moved_mm[index] - wall.points_mm[index], normal)
    return averaged(
        wall.points_mm[index], normal, gap_mm + done_mm, near=near, block=block, offset=offset, frame=frame
    )
