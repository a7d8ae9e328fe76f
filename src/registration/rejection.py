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
from registration.pairs import Pairs


@runtime_checkable
class Rejection(Protocol):
    """A rule that says which pairs count."""

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """1 for a pair that counts, 0 for one that does not."""
        ...


@dataclass(frozen=True)
class TrimRejection:
    """Keeps the closest ``keep`` share of the pairs (Chetverikov et al., ICPR 2002)."""

    keep: float = 0.9

    def __post_init__(self) -> None:
        require_positive("keep", self.keep, 1.0)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """1 for the closest share of each pose's pairs."""
        return trimming_weights(pairs.squared_mm2, self.keep)


@dataclass(frozen=True)
class DistanceRejection:
    """Keeps pairs at most ``most_mm`` apart (Zhang, Int. J. Comput. Vis. 13(2), 1994)."""

    most_mm: float

    def __post_init__(self) -> None:
        require_positive("most_mm", self.most_mm)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """1 for the pairs within the distance."""
        return (pairs.squared_mm2 <= self.most_mm**2).astype(np.float64)


@dataclass(frozen=True)
class NormalRejection:
    """Keeps pairs whose normals, as lines without a sign, are within ``most_deg`` (Pulli, 3DIM 1999).

    Raises InputError where either cloud has no normals.
    """

    most_deg: float = 45.0

    def __post_init__(self) -> None:
        require_positive("most_deg", self.most_deg, 90.0)

    def __call__(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """1 for the pairs of surfaces that face alike."""
        if pairs.normals is None or pairs.moved_normals is None:
            raise InputError("pairs: expected normals of both clouds to compare them, received none")
        cosine = np.abs(np.einsum("snk,snk->sn", pairs.normals, pairs.moved_normals))
        return (cosine >= np.cos(np.deg2rad(self.most_deg))).astype(np.float64)


def trimming_weights(squared: Float64[np.ndarray, "s n"], keep: float) -> Float64[np.ndarray, "s n"]:
    """1 for the closest ``keep`` share of each row (three at least), 0 for the others."""
    if keep >= 1:
        return np.ones_like(squared)
    last = max(int(np.ceil(keep * squared.shape[1])), 3) - 1
    return (squared <= np.partition(squared, last, axis=1)[:, last, None]).astype(np.float64)
