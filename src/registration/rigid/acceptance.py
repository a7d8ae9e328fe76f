"""Knowing when it doesn't know: which motions the clouds leave open, and the verdict on a result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, ndtri

from registration import transforms
from registration.checks import require_positive
from registration.geometry.shapes import PrincipalFrame
from registration.rigid.residual_model.deformation import Deformation
from registration.rigid.result import ACCEPTED, AMBIGUOUS, FAILED, MIN_SHOWN_MM, length_mm, percent

DIRECTIONS = ("slide", "shift", "roll", "tilt", "flip")
# A turn about an axis across the vessel by more than this lays it the other way round.
FLIP_DEG = 120.0
# A part of a motion is named if it carries at least this share of the displacement.
NAMED_SHARE = 0.35
# Rolls that are tried next to the result.
PROBED_DEG = np.array([30.0, 90.0, 180.0])


@dataclass(frozen=True)
class AcceptanceCriteria:
    """What a result must show to be accepted.

    Parameters
    ----------
    max_tre_mm : float, optional
        Largest predicted target registration error in mm; a pose that puts the model elsewhere by more is another pose.
    min_gap : float, optional
        Standard errors by which every other pose must explain the clouds worse; the default is exceeded by chance in
        one case of forty.
    min_inlier_share : float, optional
        Smallest share of moving points near the fixed ones, above 0 to 1.
    min_probability : float, optional
        Smallest probability that both clouds show one vessel, above 0 to 1.

    Raises
    ------
    InputError
        If a limit is not positive, or the share is above 1.
    """

    max_tre_mm: float = 2.0
    min_gap: float = 2.0
    min_inlier_share: float = 0.5
    min_probability: float = 0.9

    def __post_init__(self) -> None:
        require_positive("max_tre_mm", self.max_tre_mm)
        require_positive("min_gap", self.min_gap)
        require_positive("min_inlier_share", self.min_inlier_share, 1.0)
        require_positive("min_probability", self.min_probability, 1.0)

    def needed_gap(self, tries: int = 1) -> float:
        """Compute the gap that other poses must show where several searches could each err by chance.

        Bonferroni: each may err in the share of cases that one may, divided by their number.

        Parameters
        ----------
        tries : int, optional
            Number of searches.

        Returns
        -------
        float
            Smallest accepted gap in standard errors.
        """
        return self.min_gap if tries == 1 else float(-ndtri(ndtr(-self.min_gap) / tries))

    def __call__(
        self,
        *,
        settled: bool,
        inlier_share: float,
        gap: float,
        expected_mm: float,
        weak: tuple[str, ...],
        tries: int = 1,
        deformation: Deformation | None = None,
        probability_right_vessel: float = float("nan"),
    ) -> tuple[str, str]:
        """Compute the verdict on a result.

        Parameters
        ----------
        settled : bool
            Whether the best pose had settled.
        inlier_share : float
            Share of moving points near the fixed ones.
        gap : float
            Standard errors by which the next pose is worse; infinite where there is none.
        expected_mm : float
            Upper end of the predicted error in mm; NaN where none was predicted.
        weak : tuple of str
            Names of the motions that the clouds leave open.
        tries : int, optional
            Number of axes that were tried as the vessel's.
        deformation : Deformation or None, optional
            Deformation of tissue that the residuals show; where it is detected, the predicted error holds it.
        probability_right_vessel : float, optional
            Probability that both clouds show one vessel; NaN where nobody looked.

        Returns
        -------
        verdict : str
            ``accepted``, ``ambiguous`` or ``failed``.
        reason : str
            Reason in one sentence.
        """
        named = f" ({', '.join(weak)})" if weak else ""
        needed = self.needed_gap(tries)
        if inlier_share < self.min_inlier_share:
            return FAILED, (
                f"only {100 * inlier_share:.0f} % of the moving points lie on the fixed cloud, "
                f"{100 * self.min_inlier_share:.0f} % are needed"
            )
        if gap < needed:
            return AMBIGUOUS, _rival(gap, needed, named)
        if probability_right_vessel < self.min_probability:
            return AMBIGUOUS, _another_vessel(probability_right_vessel, self.min_probability)
        if expected_mm > self.max_tre_mm:
            return AMBIGUOUS, (
                f"the clouds leave the pose open{named}: the predicted TRE {_holds(deformation)} is up to "
                f"{_above(expected_mm, self.max_tre_mm)} mm (95 %, over the fixed points), at most "
                f"{self.max_tre_mm:g} mm is accepted"
            )
        if not settled:
            return FAILED, "the best pose had not settled when the iterations ran out"
        rest = (
            "no other pose was found"
            if np.isinf(gap)
            else f"the next pose is worse by {gap:.1f} standard errors"
        )
        return ACCEPTED, f"{rest}, and {_predicted(expected_mm, deformation)}"


def _rival(gap: float, needed: float, named: str) -> str:
    if gap < 0:
        return f"another pose{named} explains the clouds as well, or better by {-gap:.1f} standard errors"
    return (
        f"another pose{named} explains the clouds as well: it is worse by {gap:.1f} standard errors, "
        f"at least {needed:.2g} are needed"
    )


def _another_vessel(probability: float, needed: float) -> str:
    return (
        "the shapes differ by more than tissue that deforms, or fit as well mirrored: the probability that both show "
        f"one vessel is {percent(probability)}, {100 * needed:.0f} % are needed"
    )


def _holds(deformation: Deformation | None) -> str:
    """Whether a predicted error holds the deformation of tissue."""
    if deformation is None or not deformation.is_predicted:
        return "without deformation"
    if not deformation.detected:
        return f"with an expected tissue motion of {length_mm(deformation.expected_mm)}"
    return f"with a tissue motion of about {length_mm(deformation.size_mm)}"


def _above(value: float, limit: float) -> str:
    """A value above a limit, with as many decimals as show that it is."""
    for decimals in range(1, 4):
        if round(value, decimals) > limit:
            return f"{value:.{decimals}f}"
    return f"just over {limit:g}"


def _predicted(expected_mm: float, deformation: Deformation | None) -> str:
    """The upper end of the predicted error; clouds without noise leave nothing to predict it from."""
    if np.isnan(expected_mm):
        return "no error was predicted"
    if expected_mm < MIN_SHOWN_MM:
        return "the clouds fit without noise, which predicts nothing"
    return f"the predicted TRE {_holds(deformation)} is up to {length_mm(expected_mm)} (95 %, over the fixed points)"


def named_motion(
    motion: Float64[np.ndarray, "4 4"], frame: PrincipalFrame, min_mm: float = 0.0
) -> tuple[str, ...]:
    """Name the parts of a rigid motion of a vessel.

    ``slide`` along the vessel, ``shift`` across it, ``roll`` about it, ``tilt`` of its axis, ``flip`` if it comes
    to lie the other way round. A part is named that carries a good share of the displacement.

    Parameters
    ----------
    motion : ndarray, shape (4, 4)
        Motion (fixed_T_fixed).
    frame : PrincipalFrame
        Principal axes of the vessel.
    min_mm : float, optional
        Smallest displacement in mm that is named.

    Returns
    -------
    tuple of str
        Names of the parts.
    """
    turn = frame.axes.T @ Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    shift_mm = frame.axes.T @ (transforms.apply(motion, frame.centre_mm) - frame.centre_mm)
    across_mm = np.array([np.hypot(*np.delete(frame.spread_mm, axis)) for axis in range(3)])
    angle = float(np.linalg.norm(turn))
    # A rotation displaces a point by twice the sine of half its angle times the distance from its axis.
    chord = 2 * np.sin(0.5 * angle) / angle if angle > 0 else 1.0
    turned_mm = chord * np.abs(turn) * across_mm
    tilt = "flip" if np.rad2deg(np.hypot(turn[1], turn[2])) > FLIP_DEG else "tilt"
    parts_mm = {
        "slide": abs(float(shift_mm[0])),
        "shift": float(np.hypot(shift_mm[1], shift_mm[2])),
        "roll": float(turned_mm[0]),
        tilt: float(np.hypot(turned_mm[1], turned_mm[2])),
    }
    whole_mm = float(np.sqrt(sum(part**2 for part in parts_mm.values())))
    return tuple(name for name in DIRECTIONS if parts_mm.get(name, 0.0) > max(NAMED_SHARE * whole_mm, min_mm))


def weak_motion(motions_mm: Float64[np.ndarray, "k 6"]) -> Float64[np.ndarray, "6"]:
    """Find the motion along which samples spread most.

    Parameters
    ----------
    motions_mm : ndarray, shape (k, 6)
        Sampled motions (rotation times radius, translation) in mm.

    Returns
    -------
    ndarray, shape (6,)
        Direction of largest spread, as long as the standard deviation along it, in mm.
    """
    variances, ways = np.linalg.eigh(motions_mm.T @ motions_mm / len(motions_mm))
    return np.sqrt(max(float(variances[-1]), 0.0)) * ways[:, -1]


def probes(frame: PrincipalFrame, slide_mm: float) -> Float64[np.ndarray, "k 4 4"]:
    """Compute motions that a vessel without features would not feel: rolls about its axis and slides along it.

    Parameters
    ----------
    frame : PrincipalFrame
        Principal axes of the vessel.
    slide_mm : float
        Length of the slides in mm.

    Returns
    -------
    ndarray, shape (k, 4, 4)
        Motions (fixed_T_fixed).
    """
    turns = Rotation.from_rotvec(np.deg2rad(PROBED_DEG)[:, None] * frame.axes[:, 0])
    rolled = transforms.from_rotation(turns, frame.centre_mm - turns.apply(frame.centre_mm))
    slid = np.tile(np.eye(4), (2, 1, 1))
    slid[:, :3, 3] = slide_mm * np.array([[1.0], [-1.0]]) * frame.axes[:, 0]
    return np.concatenate([rolled, slid])


def displacement_mm(
    motions: Float64[np.ndarray, "k 4 4"], points_mm: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, " k"]:
    """Compute by how much each motion displaces points.

    Parameters
    ----------
    motions : ndarray, shape (k, 4, 4)
        Motions (fixed_T_fixed).
    points_mm : ndarray, shape (n, 3)
        Points in mm in the fixed coordinate frame.

    Returns
    -------
    ndarray, shape (k,)
        Root mean square displacement in mm.
    """
    moved_mm = points_mm @ np.swapaxes(motions[:, :3, :3], 1, 2) + motions[:, None, :3, 3]
    return np.sqrt(((moved_mm - points_mm) ** 2).sum(axis=2).mean(axis=1))
