"""The truth of a simulated sweep as a file: the pose to be found, and where the error of a result is measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.inputs.surfaces import naming
from registration import transforms
from registration.geometry.shapes import Mesh
from registration.input_files import refusing
from registration.metrics.targets import target_points
from registration.text_files import read_text

if TYPE_CHECKING:
    from registration.phantom.scan import SimulatedSweep

TARGETS, FRAME = "targets_mm", "targets_frame"
# The model from CT stays, the sweep in its world moves.
FIXED_FRAME = "ct"


def targets_of(truth: SimulatedSweep) -> np.ndarray:
    """Give the points at which the error is measured: the centerline, or the surface if there is none.

    They do not depend on the seed of a run, so that two results are measured at the same points.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep with its truth.

    Returns
    -------
    ndarray, shape (t, 3)
        Points in the ct frame in mm.
    """
    return target_points(truth.anatomy, truth.centerline)


def surface_in_ct(truth: SimulatedSweep, surface: Mesh) -> tuple[Mesh, Mesh]:
    """Bring a reconstructed surface to where the CT shows the tissue, by the known pose and deformation.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep with its truth.
    surface : Mesh
        Surface in the world frame in mm.

    Returns
    -------
    seen : Mesh
        The surface as tracked, in the ct frame in mm.
    material : Mesh
        The same with the known deformation taken out.
    """
    seen_mm = transforms.apply(truth.ct_T_world, surface.vertices_mm)
    return Mesh(seen_mm, surface.triangles), Mesh(truth.deformation.material(seen_mm), surface.triangles)


def truth_record(truth: SimulatedSweep) -> dict[str, Any]:
    """Make the content of ``truth.json``, under the names that a registration's result has.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep with its truth.

    Returns
    -------
    dict
        Content for JSON: pose, names of the coordinate frames, targets in mm.
    """
    return {
        "fixed_T_moving": truth.ct_T_world.tolist(),
        "moving_frame": "world",
        "fixed_frame": FIXED_FRAME,
        "units": {"length": "mm"},
        TARGETS: np.asarray(targets_of(truth), dtype=np.float64).round(6).tolist(),
        FRAME: FIXED_FRAME,
        "simulated": True,
    }


def read_targets(path: Path, name: str = "reference") -> tuple[np.ndarray, str] | None:
    """Read the targets of a simulated sweep's truth.

    Parameters
    ----------
    path : Path
        File to read.
    name : str, optional
        Name of the setting, for messages.

    Returns
    -------
    tuple[ndarray, str] or None
        Points of shape (t, 3) in mm and the name of their coordinate frame; None for a file of another kind.

    Raises
    ------
    InputError
        If a .json file holds no JSON, or the targets are no points or lie in another coordinate frame than
        the fixed model.
    """
    with naming(name), refusing(path, "JSON"):
        found = json.loads(read_text(path)) if path.suffix.lower() == ".json" else None
    # The truth of a benchmark's case has targets too, and its symmetry, and is read whole.
    if not isinstance(found, dict) or TARGETS not in found or "symmetry" in found:
        return None
    try:
        targets_mm = np.array(found[TARGETS], dtype=np.float64)
    except (TypeError, ValueError):
        targets_mm = np.empty(0)
    if (
        targets_mm.ndim != 2
        or targets_mm.shape[1] != 3
        or not len(targets_mm)
        or not np.isfinite(targets_mm).all()
    ):
        raise InputError(f"{name}: {path}: expected {TARGETS} as points (t, 3), received others")
    fixed, frame = found.get("fixed_frame", FIXED_FRAME), found.get(FRAME, FIXED_FRAME)
    if frame != fixed:
        raise InputError(
            f"{name}: {path}: expected {TARGETS} in the frame of the fixed side ({fixed}), received {frame}"
        )
    return targets_mm, str(frame)
