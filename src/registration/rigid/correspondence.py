"""What a multi-start registration looks closest points up in, and which pairs count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration.checks import require_count, require_positive
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.rejection import NormalRejection, Rejection
from registration.rigid.smoothed_target import outward_targets

# The surface that poses are compared on is smoothed over so many times the points that a normal is estimated from.
SMOOTHING = 2


@dataclass(frozen=True)
class Correspondence:
    """Settings of the closest points.

    Parameters
    ----------
    neighbours : int, optional
        Number of points that a normal is estimated from.
    max_fixed_points : int, optional
        A fixed cloud with more points is thinned to so many: the nearest neighbours in a denser one are its noise
        and not its surface.
    rejections : sequence of Rejection, optional
        Rules by which more pairs of the last two stages do not count.
    inlier_spacings : float, optional
        An inlier lies within so many distances between neighbouring points.

    Raises
    ------
    InputError
        If a count is below 3 or the inlier distance is not positive.
    """

    neighbours: int = 20
    max_fixed_points: int = 10_000
    rejections: Sequence[Rejection] = ()
    inlier_spacings: float = 3.0

    def __post_init__(self) -> None:
        require_count("neighbours", self.neighbours, 3)
        require_count("max_fixed_points", self.max_fixed_points, 3)
        require_positive("inlier_spacings", self.inlier_spacings)
        # A configuration file hands over a list.
        object.__setattr__(self, "rejections", tuple(self.rejections))

    @property
    def by_normals(self) -> bool:
        """Whether a rule compares the normals of both clouds."""
        return any(isinstance(rule, NormalRejection) for rule in self.rejections)

    def thinned(
        self, fixed_mm: Float64[np.ndarray, "n 3"], rng: np.random.Generator
    ) -> Float64[np.ndarray, "k 3"]:
        """Draw points of a fixed cloud that has too many.

        Parameters
        ----------
        fixed_mm : ndarray, shape (n, 3)
            Fixed points in mm.
        rng : numpy.random.Generator
            Source of the draw.

        Returns
        -------
        ndarray, shape (k, 3)
            All points, or ``max_fixed_points`` of them.
        """
        if len(fixed_mm) <= self.max_fixed_points:
            return fixed_mm
        return fixed_mm[rng.permutation(len(fixed_mm))[: self.max_fixed_points]]

    def targets(self, fixed_mm: Float64[np.ndarray, "n 3"], normals: bool) -> tuple[TreeTarget, TreeTarget]:
        """Prepare a fixed cloud to be searched and to be compared with.

        Parameters
        ----------
        fixed_mm : ndarray, shape (n, 3)
            Fixed points in mm.
        normals : bool
            Whether normals are needed.

        Returns
        -------
        exact : TreeTarget
            Cloud as it is.
        smoothed : TreeTarget
            Cloud without its noise; the same one where no normals are needed.
        """
        if normals:
            return outward_targets(fixed_mm, self.neighbours, SMOOTHING * self.neighbours)
        exact = TreeTarget(fixed_mm)
        return exact, exact
