"""Which starting poses a multi-start registration tries: around a known pose, by centerlines, or by symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration.checks import require_count, require_positive
from registration.geometry.shapes import principal_frame
from registration.rigid.initial_poses import centerline_starts, cone_starts, principal_axes, symmetry_starts
from registration.rigid.isolated_points import MIN_CLOUD_POINTS, NEIGHBOUR, is_isolated
from registration.rigid.pose_comparison import Evidence
from registration.rigid.search_cone import Bound


@dataclass(frozen=True)
class Starts:
    """Starting poses from the symmetry of a vessel: rolled about it, slid along it, and inverted.

    Parameters
    ----------
    rolls : int, optional
        Number of equal steps of rotation about the principal axis.
    slide_share : float, optional
        Step along the vessel as a share of the moving cloud's length, above 0 to 1.
    axis_share : float, optional
        An axis with at least this share of the longest spread is tried as the principal one too.
    compact_share : float, optional
        Where the second axis has at least this share of the first one's spread, none is principal: all are tried.
    invert : bool, optional
        Whether the vessel is tried the other way round as well.
    slide : bool, optional
        Whether the moving cloud is slid along the fixed one.
    use_centerline : bool, optional
        Whether ICP on the centerlines comes first, where both are given.
    centerline_places : int, optional
        Number of best places along the centerlines that are rolled.

    Raises
    ------
    InputError
        If a count is below 1 or a share is outside its range.
    """

    rolls: int = 12
    slide_share: float = 0.25
    axis_share: float = 0.75
    compact_share: float = 0.5
    invert: bool = True
    slide: bool = True
    use_centerline: bool = True
    centerline_places: int = 16

    def __post_init__(self) -> None:
        require_count("rolls", self.rolls, 1)
        require_count("centerline_places", self.centerline_places, 1)
        for name in ("slide_share", "axis_share", "compact_share"):
            require_positive(name, getattr(self, name), 1.0)

    def __call__(
        self,
        evidence: Evidence,
        bound: Bound | None,
        centerlines_mm: tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "q 3"]] | None,
    ) -> Float64[np.ndarray, "s 4 4"]:
        """Compute the starting poses around a known pose, else by the centerlines, else by the surfaces' own axes.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.
        bound : Bound or None
            Bound around a known pose; None where there is none.
        centerlines_mm : tuple of two ndarrays, shapes (p, 3) and (q, 3), or None
            Points in mm on the moving and the fixed centerline; None where they are not used.

        Returns
        -------
        ndarray, shape (s, 4, 4)
            Starting poses as fixed_T_moving.
        """
        moving_mm = evidence.moving_mm[: evidence.core]
        if bound is not None:
            return cone_starts(moving_mm, bound.initial, bound.angle_deg, bound.radius_mm)
        if centerlines_mm is not None:
            return centerline_starts(
                *centerlines_mm,
                self.rolls,
                self.slide_share,
                self.centerline_places,
                invert=self.invert,
                slide=self.slide,
            )
        fixed_mm = evidence.target.points_mm
        if len(fixed_mm) >= MIN_CLOUD_POINTS:
            fixed_mm = fixed_mm[~is_isolated(evidence.target.away_mm(NEIGHBOUR))]
        return symmetry_starts(
            moving_mm,
            fixed_mm,
            self.rolls,
            self.slide_share,
            self.axis_share,
            self.compact_share,
            invert=self.invert,
            slide=self.slide,
        )

    def axes_tried(self, evidence: Evidence) -> int:
        """Count the axes of the moving cloud that are tried as the vessel's where no pose is known.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.

        Returns
        -------
        int
            Number of axes, 1 to 3.
        """
        spread_mm = principal_frame(evidence.moving_mm[: evidence.core]).spread_mm
        return len(principal_axes(spread_mm, self.axis_share, self.compact_share))
