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
UNDEFORMED = "undeformed"


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
    moving_centerline_mm, fixed_centerline_mm : ndarray, shapes (p, 3) and (q, 3), or None, optional
        Coarse points on both centerlines, each in the frame of its cloud in mm; None where a case gives none.
    initial : ndarray, shape (4, 4), or None, optional
        Roughly known pose (fixed_T_moving) to start from; None where nothing is known.
    """

    name: str
    anatomy: str
    kind: str
    moving_mm: Float64[np.ndarray, "m 3"]
    moving_normals: Float64[np.ndarray, "m 3"]
    moving_frame: Int64[np.ndarray, " m"]
    fixed: Mesh
    fixed_mm: Float64[np.ndarray, "n 3"]
    moving_centerline_mm: Float64[np.ndarray, "p 3"] | None = None
    fixed_centerline_mm: Float64[np.ndarray, "q 3"] | None = None
    initial: Float64[np.ndarray, "4 4"] | None = None


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
        True pose; where tissue deforms, the pose that brings the wall of the whole model, as it was swept, nearest to
        where it is in the CT (least squares). All NaN where the sweep shows another vessel than the model: no pose is
        true.
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
    block : str, optional
        Block of the benchmark that the case belongs to.
    displacement_mm : ndarray, shape (t, 3), or None, optional
        Where the material of each target lies in the true pose, less the target, in the fixed frame in mm; None where
        tissue does not deform.
    same_vessel : bool, optional
        Whether the model is that of the vessel that was swept. If not, any accepted result is wrong.
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
    block: str = UNDEFORMED
    displacement_mm: Float64[np.ndarray, "t 3"] | None = None
    same_vessel: bool = True


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
    pose = (truth.fixed_T_moving,) if truth.same_vessel else ()
    # What a case does not have leaves its digest as it is.
    optional = (truth.displacement_mm, case.moving_centerline_mm, case.fixed_centerline_mm, case.initial)
    for lengths_mm in (
        case.moving_mm,
        case.fixed.vertices_mm,
        case.fixed_mm,
        *pose,
        truth.targets_mm,
        *(one for one in optional if one is not None),
    ):
        found.update(np.round(lengths_mm * 10**DECIMALS).astype("<i8").tobytes())
    for whole in (case.moving_frame, case.fixed.triangles, truth.covered, truth.outlier):
        found.update(whole.astype("<i8").tobytes())
    return found.hexdigest()[:16]
