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

    Parameters
    ----------
    mesh : Mesh
        Surface; of a hollow body the lumen's.
    units : str
        Unit that the file's numbers were taken for: mm, cm or m.
    space : str
        Axes of the file: lps or ras, or ``header`` for a volume that states them itself.
    mask : VesselMask, optional
        Voxels of the label; None for a mesh.
    label_name : str, optional
        Name of the label, empty for none.
    lost_mm : float, optional
        Largest distance of the label's voxels from the surface in mm.
    repaired : Repaired, optional
        What was repaired of a mesh; None for a label map.
    stated_units : str, optional
        Unit that the header states, empty for none.
    lumen : Lumen, optional
        How the lumen of a hollow body was found; None for other models.
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
    """Read a label map or a mesh.

    Parameters
    ----------
    path : Path
        Label map (NIfTI, NRRD, MetaImage) or mesh (STL, PLY, OBJ, VTK, VTP).
    surface : LabelSurface
        Method that makes the surface of a label.
    label : int or str, optional
        Number or name of the segment to take, needed where there are several.
    space : {'lps', 'ras'}, optional
        The file's axes, needed where it does not state them.
    units : {'mm', 'cm', 'm'}, optional
        Unit in place of the header's and of the check of the vessel's size.
    nifti_form : {'qform', 'sform'}, optional
        Which of two transforms of a NIfTI file counts where they differ.

    Returns
    -------
    ModelInput
        Surface in mm in LPS.

    Raises
    ------
    InputError
        If the file cannot be read, a choice is missing, or the model is of no vessel's size.
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
    """Return the path, or raise InputError for what is wrong without reading all of the file.

    Parameters
    ----------
    path : Path
        Label map or mesh.
    label : int or str or None
        Number or name of the segment; None for a mesh.
    space : str or None
        The file's axes, lps or ras.
    units : str or None
        Unit of length: mm, cm or m.
    nifti_form : str, optional
        Which of two transforms of a NIfTI file counts: qform or sform.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    InputError
        If the file is missing or of an unknown kind, or a setting has no value that is allowed for it.
    """
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
