"""How probable it is that both clouds show one vessel: what a right one leaves, and what its mirror image leaves."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

# Log-odds: constant, and factors of the log of the misfit in mm, of the log of the mirror image's misfit over it, and
# of the share of points far from the surface. Rounded from a logistic regression on right and wrong vessels of
# anatomies with seeds below 1000, whole and in part, still and deforming. The misfit counts for more than there, so
# that a still piece that is nearly its own mirror image passes; lost points for less, as a piece may reach beyond the
# model.
INTERCEPT, OF_MISFIT, OF_MIRROR, OF_LOST = -5.0, -3.0, 5.0, -5.0
# Tissue was displaced by up to this much in mm.
USUAL_MM = 2.0
# A ratio of misfits beyond this says nothing more.
LARGEST_LOG_RATIO = 1.5


def probability_right_vessel(
    misfit_mm: float, mirrored_misfit_mm: float, lost_share: float, expected_mm: float = 0.0
) -> float:
    """Compute the probability that both clouds show one vessel.

    A vessel and its mirror image, or another, were as probable before.

    Parameters
    ----------
    misfit_mm : float
        Root mean square distance in mm of the moved cloud from the surface, its noise left out.
    mirrored_misfit_mm : float
        The same of its mirror image at its own best place.
    lost_share : float
        Share of points that are far from the surface.
    expected_mm : float, optional
        Expected displacement of tissue in mm; where it is more than the vessels had that the odds are from, a right
        vessel may differ by as much more.

    Returns
    -------
    float
        Probability.
    """
    ratio = np.clip(np.log(mirrored_misfit_mm / misfit_mm), -LARGEST_LOG_RATIO, LARGEST_LOG_RATIO)
    usual_mm = misfit_mm * min(1.0, USUAL_MM / max(expected_mm, USUAL_MM))
    odds = INTERCEPT + OF_MISFIT * np.log(usual_mm) + OF_MIRROR * ratio + OF_LOST * lost_share
    return float(expit(odds))
