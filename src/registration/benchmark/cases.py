"""A benchmark case and its truth, which a method does not see."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration.benchmark.symmetry import Symmetry
from registration.geometry import Mesh

# Numbers are compared to this many decimals of a millimetre.
DECIMALS = 4


@dataclass(frozen=True)
class BenchmarkCase:
    """What a method is given: a cloud from a sweep, in a frame of its own, and the model from CT.

    ``moving_mm`` and ``moving_normals`` (m, 3) in a frame of their own; ``moving_frame`` (m,) is the frame of the sweep
    that each point was seen in. ``fixed`` is the model's surface and ``fixed_mm`` (n, 3) points of it, even by area.
    """

    name: str
    anatomy: str
    kind: str
    moving_mm: Float64[np.ndarray, "m 3"]
    moving_normals: Float64[np.ndarray, "m 3"]
    moving_frame: Int64[np.ndarray, "m"]
    fixed: Mesh
    fixed_mm: Float64[np.ndarray, "n 3"]


@dataclass(frozen=True)
class CaseTruth:
    """What is known of a case: the pose, where its error is measured, and which other poses are as right.

    ``targets_mm`` (t, 3) lie on the model's centerline, in the fixed frame; ``covered`` (t,) says which of them were
    swept. ``outlier`` (m,) marks moving points that belong to no vessel. ``angle_deg`` and ``translation_mm`` say how
    far the start is from the truth, ``place`` which part of the sweep was used. All of the benchmark is ``simulated``.
    """

    name: str
    anatomy: str
    kind: str
    place: str
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    targets_mm: Float64[np.ndarray, "t 3"]
    covered: Bool[np.ndarray, "t"]
    outlier: Bool[np.ndarray, "m"]
    angle_deg: float
    translation_mm: float
    symmetry: Symmetry = field(default_factory=Symmetry)
    simulated: bool = True


def digest(case: BenchmarkCase, truth: CaseTruth) -> str:
    """SHA-256 of all numbers of a case, lengths rounded to 0.1 micrometre, in 16 hexadecimal digits."""
    found = hashlib.sha256()
    for lengths_mm in (
        case.moving_mm,
        case.fixed.vertices_mm,
        case.fixed_mm,
        truth.fixed_T_moving,
        truth.targets_mm,
    ):
        found.update(np.round(lengths_mm * 10**DECIMALS).astype("<i8").tobytes())
    for whole in (case.moving_frame, case.fixed.triangles, truth.covered, truth.outlier):
        found.update(whole.astype("<i8").tobytes())
    return found.hexdigest()[:16]
