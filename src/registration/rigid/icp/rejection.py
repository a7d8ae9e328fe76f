"""Rejection: which pairs of points do not count in a step of ICP.

A rejection is called with the pairs and gives each a weight of 1 or 0; several are multiplied.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from registration.checks import require_positive
from registration.errors import InputError
from registration.rigid.icp.pairs import Pairs


@runtime_checkable
class Rejection(Protocol):
    """Rule that decides which pairs count."""

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Decide which pairs count.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            1 for a pair that counts, 0 for one that does not.
        """
        ...


@dataclass(frozen=True)
class TrimRejection:
    """Rejection of all but the closest share of the pairs.

    Parameters
    ----------
    keep : float, optional
        Share of the pairs that is kept, above 0 to 1.

    Raises
    ------
    InputError
        If the share is out of range.

    References
    ----------
    D. Chetverikov et al., ICPR 2002.
    """

    keep: float = 0.9

    def __post_init__(self) -> None:
        require_positive("keep", self.keep, 1.0)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Keep the closest share of each pose's pairs.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            1 for a pair that counts, 0 for one that does not.
        """
        return trimming_weights(pairs.squared_mm2, self.keep)


@dataclass(frozen=True)
class DistanceRejection:
    """Rejection of pairs that are too far apart.

    Parameters
    ----------
    max_distance_mm : float
        Largest distance of a pair in mm.

    Raises
    ------
    InputError
        If the distance is not positive.

    References
    ----------
    Z. Zhang, Int. J. Comput. Vis. 13(2), 1994.
    """

    max_distance_mm: float

    def __post_init__(self) -> None:
        require_positive("max_distance_mm", self.max_distance_mm)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Keep the pairs within the distance.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            1 for a pair that counts, 0 for one that does not.
        """
        return (pairs.squared_mm2 <= self.max_distance_mm**2).astype(np.float64)


@dataclass(frozen=True)
class NormalRejection:
    """Rejection of pairs whose normals, as lines without a sign, differ too much.

    Parameters
    ----------
    max_angle_deg : float, optional
        Largest angle in degrees, above 0 to 90.

    Raises
    ------
    InputError
        If the angle is out of range.

    References
    ----------
    K. Pulli, 3DIM 1999.
    """

    max_angle_deg: float = 45.0

    def __post_init__(self) -> None:
        require_positive("max_angle_deg", self.max_angle_deg, 90.0)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Keep the pairs of surfaces that face alike.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            1 for a pair that counts, 0 for one that does not.

        Raises
        ------
        InputError
            If either cloud has no normals.
        """
        if pairs.normals is None or pairs.moved_normals is None:
            raise InputError("pairs: expected normals of both clouds to compare them, received none")
        cosine = np.abs(np.einsum("snk,snk->sn", pairs.normals, pairs.moved_normals))
        return (cosine >= np.cos(np.deg2rad(self.max_angle_deg))).astype(np.float64)


def trimming_weights(squared: Float64[np.ndarray, "s n"], keep: float) -> Float64[np.ndarray, "s n"]:
    """Compute weights that keep the closest share of each row.

    Parameters
    ----------
    squared : ndarray, shape (s, n)
        Squared distances, one row for each pose.
    keep : float
        Share that is kept, three at least; 1 keeps all.

    Returns
    -------
    ndarray, shape (s, n)
        1 for the closest, 0 for the others.
    """
    if keep >= 1:
        return np.ones_like(squared)
    last = max(int(np.ceil(keep * squared.shape[1])), 3) - 1
    return (squared <= np.partition(squared, last, axis=1)[:, last, None]).astype(np.float64)
