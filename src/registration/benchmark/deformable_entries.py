"""What a deformable method enters in the benchmark: beside the pose of each case a displacement of the model.

``<case>_displacement.nrrd`` (or ``.mha``, ``.h5``) is an ITK displacement field in LPS and mm. It maps a point of the
fixed model to where its material lies in the moving cloud after the method's own pose of that case, in the fixed frame.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.benchmark.cases import CaseTruth
from registration.benchmark.scoring import INFINITE, NOT_DEFINED, material_error_mm
from registration.errors import InputError
from registration.io.atomic import write_atomic
from registration.io.displacement_fields import sample_grid, write_displacement_grid
from registration.io.sampled_displacement import read_sampled_displacement
from registration.metrics.surface_distance import rms

STEM = "_displacement"
# The grid reaches so far beyond the model, and its nodes are so far apart.
MARGIN_MM, SPACING_MM = 6.0, 1.5


@dataclass(frozen=True)
class DisplacementScore:
    """Errors after a method's displacement; infinite without a result, NaN where not defined.

    Parameters
    ----------
    tre_deformed_mm : float, optional
        Root mean square distance in mm between where a target was moved to and where its material was swept.
    tre_deformed_covered_mm, tre_deformed_uncovered_mm : float, optional
        The same over the targets that were swept and those that were not; NaN where there are none.
    jacobian_min : float, optional
        Smallest Jacobian determinant of the field over its whole grid; at 0 and below it folds. NaN without a field.
    """

    tre_deformed_mm: float = INFINITE
    tre_deformed_covered_mm: float = INFINITE
    tre_deformed_uncovered_mm: float = INFINITE
    jacobian_min: float = NOT_DEFINED


def score_displacement(
    path: Path, fixed_T_moving: Float64[np.ndarray, "4 4"], truth: CaseTruth
) -> DisplacementScore:
    """Measure the errors of a pose and the displacement after it.

    Parameters
    ----------
    path : Path
        File of the displacement.
    fixed_T_moving : ndarray, shape (4, 4)
        The method's pose.
    truth : CaseTruth
        Truth of the case.

    Returns
    -------
    DisplacementScore
        The errors; NaN where the model is that of another vessel.

    Raises
    ------
    InputError
        If the file cannot be read, or its grid does not hold all targets; the message names it.
    """
    field = read_sampled_displacement(path)
    if not truth.same_vessel:
        return DisplacementScore(NOT_DEFINED, NOT_DEFINED, NOT_DEFINED, field.jacobian_min())
    try:
        displacement_mm = field(truth.targets_mm)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}; the bounding box of the model is enough") from refusal
    errors_mm = material_error_mm(fixed_T_moving, truth, displacement_mm)
    covered, uncovered = (
        rms(errors_mm[chosen]) if chosen.any() else NOT_DEFINED for chosen in (truth.covered, ~truth.covered)
    )
    return DisplacementScore(rms(errors_mm), covered, uncovered, field.jacobian_min())


def write_entry(
    folder: Path,
    case: str,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    displacement: Callable[[np.ndarray], np.ndarray],
    model_mm: Float64[np.ndarray, "n 3"],
) -> None:
    """Write a method's entry for one case: ``<case>.json`` and ``<case>_displacement.nrrd``.

    Parameters
    ----------
    folder : Path
        Folder of the entries.
    case : str
        Name of the case.
    fixed_T_moving : ndarray, shape (4, 4)
        The method's pose.
    displacement : callable
        Displacement in mm at points of the fixed frame in mm, from the model to where it was swept.
    model_mm : ndarray, shape (n, 3)
        Points of the model in the fixed frame in mm, which the grid is laid around.
    """
    told = {"fixed_T_moving": np.asarray(fixed_T_moving).tolist()}
    write_atomic(folder / f"{case}.json", (json.dumps(told) + "\n").encode())
    low_mm, high_mm = model_mm.min(axis=0) - MARGIN_MM, model_mm.max(axis=0) + MARGIN_MM
    grid = sample_grid(displacement, low_mm, high_mm, SPACING_MM)
    write_displacement_grid(folder / f"{case}{STEM}.nrrd", grid, "lps")
