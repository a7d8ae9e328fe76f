"""A benchmark case and its truth, which a method does not see."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration.benchmark.symmetry import Symmetry
from registration.geometry.shapes import Mesh

# Numbers are compared to this many decimals of a millimetre.
DECIMALS = 4


@dataclass(frozen=True)
class BenchmarkCase:
    """What a method is given: a cloud from a sweep and the model from CT.

    Parameters
    ----------
    name : str
        Name of the case.
    anatomy : str
        Name of the anatomy.
    kind : str
        Name of the kind of case.
    moving_mm : ndarray, shape (m, 3)
        Moving points in a coordinate frame of their own, in mm.
    moving_normals : ndarray, shape (m, 3)
        Unit normals of the moving points, in the same frame.
    moving_frame : ndarray of int, shape (m,)
        Index of the sweep's frame that each moving point was seen in.
    fixed : Mesh
        Surface of the model in the fixed frame, in mm.
    fixed_mm : ndarray, shape (n, 3)
        Points sampled from it uniformly by area, in mm.
    """

    name: str
    anatomy: str
    kind: str
    moving_mm: Float64[np.ndarray, "m 3"]
    moving_normals: Float64[np.ndarray, "m 3"]
    moving_frame: Int64[np.ndarray, " m"]
    fixed: Mesh
    fixed_mm: Float64[np.ndarray, "n 3"]


@dataclass(frozen=True)
class CaseTruth:
    """Truth of a case, which a method does not see.

    Parameters
    ----------
    name : str
        Name of the case.
    anatomy : str
        Name of the anatomy.
    kind : str
        Name of the kind of case.
    place : str
        Part of the sweep that was used: ``start``, ``middle`` or ``end``.
    fixed_T_moving : ndarray, shape (4, 4)
        True pose.
    targets_mm : ndarray, shape (t, 3)
        Targets on the model's centerline, in the fixed frame in mm.
    covered : ndarray of bool, shape (t,)
        Which targets were swept.
    outlier : ndarray of bool, shape (m,)
        Which moving points are outliers that belong to no vessel.
    angle_deg, translation_mm : float
        Angle in degrees and length in mm by which the start is off the truth.
    symmetry : Symmetry, optional
        Symmetry of the vessel; empty for most.
    simulated : bool, optional
        Whether the data are simulated; all of the benchmark is.
    """

    name: str
    anatomy: str
    kind: str
    place: str
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    targets_mm: Float64[np.ndarray, "t 3"]
    covered: Bool[np.ndarray, " t"]
    outlier: Bool[np.ndarray, " m"]
    angle_deg: float
    translation_mm: float
    symmetry: Symmetry = field(default_factory=Symmetry)
    simulated: bool = True


def digest(case: BenchmarkCase, truth: CaseTruth) -> str:
    """Compute a digest of all numbers of a case, lengths rounded to 0.1 micrometre.

    Parameters
    ----------
    case : BenchmarkCase
        Case.
    truth : CaseTruth
        Its truth.

    Returns
    -------
    str
        First 16 hexadecimal digits of a SHA-256.
    """
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
