"""A model of a vessel from a file of any kind, label map or mesh, as one surface in mm in LPS."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from registration.ct_model.label_map import SPACES, LabelMap, read_label_map
from registration.ct_model.label_surface import LabelSurface
from registration.ct_model.vessel_mask import VesselMask, vessel_mask
from registration.errors import InputError
from registration.geometry.hollow import Lumen
from registration.geometry.mesh_repair import Repaired, repair
from registration.geometry.shapes import Mesh
from registration.io.nifti_header import FORMS
from registration.io.patient_space import lps_from, stated_space
from registration.io.surfaces import read_surface
from registration.io.truncation import require_file
from registration.io.units import MM_PER_UNIT, to_millimetres
from registration.io.volumes import READERS, volume_suffix

MESHES = (".stl", ".ply", ".obj", ".vtk", ".vtp")


@dataclass(frozen=True)
class ModelInput:
    """The surface of a vessel in mm in LPS, and where it came from.

    ``units`` (mm, cm or m) is what the file's numbers were taken for, ``stated_units`` what its header says, ``space``
    the axes it has: lps or ras, or ``header`` for a volume that says so itself. A label map leaves its ``mask``, its
    ``label_name`` and how far from the surface its voxels lie at most (``lost_mm``), a mesh what was ``repaired``.
    ``lumen`` is there where the model was the wall of a hollow body, of which the lumen's surface was taken.
    """

    mesh: Mesh
    units: str
    space: str
    mask: VesselMask | None = None
    label_name: str = ""
    lost_mm: float = 0.0
    repaired: Repaired | None = None
    stated_units: str = ""
    lumen: Lumen | None = None


def read_model(
    path: Path,
    surface: LabelSurface,
    label: int | str | None = None,
    space: str | None = None,
    units: str | None = None,
    nifti_form: str | None = None,
) -> ModelInput:
    """Read a label map or a mesh; ``surface`` makes the surface of a label.

    ``label`` (a number, or the name of a segment) chooses among several labels, ``space`` (lps or ras) is needed where
    the file does not state its axes, ``units`` (mm, cm or m) overrides the header and the check of the vessel's size,
    ``nifti_form`` (qform or sform) chooses where both are there and differ. Raises InputError for what cannot be read,
    for a missing choice, and for a model that is no vessel's size.
    """
    path = check_model(path, label, space, units, nifti_form)
    if volume_suffix(path):
        found = read_label_map(path, space, units, nifti_form)
        return _from_labels(path, found, surface, label, space, units)
    return _from_mesh(path, space, units)


def check_model(
    path: Path,
    label: int | str | None,
    space: str | None,
    units: str | None,
    nifti_form: str | None = None,
) -> Path:
    """Return the path, or raise InputError for what is wrong without reading all of the file."""
    path = require_file(Path(path))
    if space is not None and space not in SPACES:
        raise InputError(f"space: expected lps or ras, received {space!r}")
    if units is not None and units not in MM_PER_UNIT:
        raise InputError(f"units: expected one of {', '.join(MM_PER_UNIT)}, received {units!r}")
    if nifti_form is not None and (nifti_form not in FORMS or not volume_suffix(path).startswith(".nii")):
        raise InputError(
            f"nifti_form: expected {' or '.join(FORMS)}, and that for NIfTI files alone, received {nifti_form!r} for "
            f"{path.name}"
        )
    if volume_suffix(path):
        return path
    if path.suffix.lower() not in MESHES:
        known = ", ".join((*READERS, *MESHES))
        raise InputError(f"{path}: expected one of {known}, received {path.suffix or 'no suffix'}")
    if label is not None:
        raise InputError(f"label: expected none, because {path} is a mesh, received {label}")
    return path


def _from_labels(
    path: Path,
    found: LabelMap,
    surface: LabelSurface,
    label: int | str | None,
    space: str | None,
    units: str | None,
) -> ModelInput:
    try:
        mask = vessel_mask(found, label)
        smooth = surface(mask)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    if units is None:
        to_millimetres(smooth.mesh, None, str(path))
    return ModelInput(
        smooth.mesh,
        units or found.units or "mm",
        space or "header",
        mask=mask,
        label_name=mask.name,
        lost_mm=smooth.lost_mm,
        stated_units=found.units,
        lumen=smooth.lumen,
    )


def _from_mesh(path: Path, space: str | None, units: str | None) -> ModelInput:
    raw = read_surface(path)
    if not isinstance(raw, Mesh):
        raise InputError(f"{path}: expected a mesh with triangles, received {len(raw)} points alone")
    stated = stated_space(path)
    if stated is None and space is None:
        raise InputError(
            f"space: expected lps or ras, because {path} does not say how its axes lie in the patient, received none"
        )
    if stated is not None and space not in (None, stated):
        raise InputError(f"space: expected {stated}, as the header of {path} says, received {space}")
    used = stated or str(space)
    try:
        repaired = repair(raw)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    whole = to_millimetres(repaired.mesh, units, str(path))
    mesh = Mesh(lps_from(whole.vertices_mm, used), whole.triangles)
    kept = replace(repaired, mesh=mesh)
    return ModelInput(mesh, units or "mm", used, repaired=kept, lumen=repaired.lumen)
