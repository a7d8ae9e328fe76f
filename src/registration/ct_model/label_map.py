"""Label maps of segmented volumes: what stands in the file, and where it lies in the patient."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64, Shaped

from registration import transforms
from registration.brief import brief_repr
from registration.errors import InputError
from registration.input_files import guarded
from registration.io.segments import Segment, read_segments, scan_ends
from registration.io.volumes import UNITS_KEY, read_volume

SPACES = ("lps", "ras")
# NRRD files that name their axes arrive here in these ones; other names do not refer to the patient.
_PATIENT_SPACE = "left-posterior-superior"


@dataclass(frozen=True)
class LabelMap:
    """Labels of voxels, 0 for none, and where the voxels lie.

    Parameters
    ----------
    labels : ndarray, shape (i, j, k)
        Whole numbers; of layers, the first.
    ct_A_voxel : ndarray, shape (4, 4)
        Map from the index (i, j, k) of a voxel's centre to mm in LPS, whatever axes the file has: its columns
        are at right angles, and left-handed where the file's axes are.
    names : mapping of int to str
        Names of the segments by label, where the file has any.
    layers : ndarray, shape (n, i, j, k), optional
        Layers of overlapping segments; None where none overlap.
    segments : tuple of Segment, optional
        Which segment lies in which layer with which value.
    scan_ends : ndarray, shape (3, 2), optional
        First and last index of the scan along each axis; None where the scan ends with the file.
    units : str, optional
        Unit of length that the header states, empty for none.
    """

    labels: Shaped[np.ndarray, "i j k"]
    ct_A_voxel: Float64[np.ndarray, "4 4"]
    names: Mapping[int, str]
    layers: Shaped[np.ndarray, "n i j k"] | None = None
    segments: tuple[Segment, ...] = ()
    scan_ends: Int64[np.ndarray, "3 2"] | None = None
    units: str = ""

    __repr__ = brief_repr

    @property
    def spacing_mm(self) -> Float64[np.ndarray, "3"]:
        """The distance of neighbouring voxels along i, j and k."""
        return np.asarray(np.linalg.norm(self.ct_A_voxel[:3, :3], axis=0))

    def describe(self, label: int) -> str:
        """Format a label for messages.

        Parameters
        ----------
        label : int
            Label.

        Returns
        -------
        str
            The label, with its name if it has one.
        """
        return f"{label} ({self.names[label]})" if label in self.names else str(label)


@guarded("a label map")
def read_label_map(
    path: Path, space: str | None = None, units: str | None = None, nifti_form: str | None = None
) -> LabelMap:
    """Read a label map (NIfTI, NRRD, MetaImage) into LPS and millimetres.

    Parameters
    ----------
    path : Path
        File of the label map; MetaImage files are in LPS by convention.
    space : {'lps', 'ras'}, optional
        The file's axes where its header does not state them: NIfTI without qform and sform, NRRD without an
        anatomical space.
    units : str, optional
        Unit of length in place of the header's.
    nifti_form : {'qform', 'sform'}, optional
        Which of two transforms of a NIfTI file counts where they differ.

    Returns
    -------
    LabelMap
        Labels and where they lie.

    Raises
    ------
    InputError
        If the file is missing, unreadable or cut short, has not three axes or more than one value a voxel
        (but for layers of segments), values that are no labels, or sheared axes; for an unknown ``space``, a
        missing one, and one that the header states itself.
    """
    if space not in (None, *SPACES):
        raise InputError(f"space: expected lps or ras, received {space!r}")
    image = read_volume(path, units, nifti_form)
    facts = {key: image.GetMetaData(key) for key in image.GetMetaDataKeys()}
    segments = read_segments(facts)
    if image.GetDimension() != 3 or (image.GetNumberOfComponentsPerPixel() != 1 and not segments):
        raise InputError(
            f"{path}: expected a volume of 3 axes with one label a voxel, received {image.GetDimension()} axes of "
            f"{' x '.join(map(str, image.GetSize()))} with {image.GetNumberOfComponentsPerPixel()} a voxel"
        )
    ct_A_voxel = _voxel_axes(image, path)
    _require_one_space(facts, space, path)
    if space == "ras":
        ct_A_voxel = np.diag([-1.0, -1.0, 1.0, 1.0]) @ ct_A_voxel
    layers = _layers(image, path)
    return LabelMap(
        labels=layers[0],
        ct_A_voxel=ct_A_voxel,
        names={segment.label: segment.name for segment in segments if segment.name and segment.layer == 0},
        layers=layers if len(layers) > 1 else None,
        segments=segments,
        scan_ends=scan_ends(facts, layers.shape[1:], ct_A_voxel) if segments else None,
        units=facts.get(UNITS_KEY, ""),
    )


def _voxel_axes(image: Any, path: Path) -> Float64[np.ndarray, "4 4"]:
    direction = np.array(image.GetDirection(), dtype=np.float64).reshape(3, 3)
    spacing_mm = np.array(image.GetSpacing(), dtype=np.float64)
    defect = float(np.abs(direction.T @ direction - np.eye(3)).max())
    if not defect <= transforms.RIGID_TOLERANCE:
        raise InputError(
            f"{path}: expected orthonormal axes within {transforms.RIGID_TOLERANCE:g}, "
            f"received a defect of {defect:.3g}"
        )
    if not (np.isfinite(spacing_mm).all() and (spacing_mm > 0).all()):
        raise InputError(
            f"{path}: expected a voxel size above 0 along every axis, received {spacing_mm.tolist()}"
        )
    ct_A_voxel = np.eye(4)
    ct_A_voxel[:3, :3] = direction * spacing_mm
    ct_A_voxel[:3, 3] = image.GetOrigin()
    return ct_A_voxel


def _require_one_space(facts: Mapping[str, str], space: str | None, path: Path) -> None:
    """Raise InputError unless either the header or the user names the axes."""
    stated = _states_space(facts, path)
    if stated and space is not None:
        raise InputError(
            f"space: expected none, because the header of {path} says how its axes lie, received {space}"
        )
    if not stated and space is None:
        raise InputError(
            f"space: expected lps or ras, because the header of {path} does not say how its axes lie in the patient, "
            "received none"
        )


def _states_space(facts: Mapping[str, str], path: Path) -> bool:
    """Whether a header names its axes in the patient."""
    if "qform_code" in facts or "sform_code" in facts:
        return any(facts.get(f"{form}form_code", "0").strip() != "0" for form in "qs")
    if Path(path).suffix.lower() in (".nrrd", ".nhdr"):
        return facts.get("NRRD_space") == _PATIENT_SPACE
    return True


def _layers(image: Any, path: Path) -> Shaped[np.ndarray, "n i j k"]:
    import SimpleITK

    # SimpleITK hands arrays over with the last axis first, and values of one voxel last.
    values = SimpleITK.GetArrayFromImage(image)
    values = values[None] if values.ndim == 3 else np.moveaxis(values, -1, 0)
    values = values.transpose(0, 3, 2, 1)
    if not np.issubdtype(values.dtype, np.floating):
        return values
    whole = np.isfinite(values).all() and bool((values == np.round(values)).all())
    if not whole:
        raise InputError(f"{path}: expected whole numbers as labels, received a volume with fractions or NaN")
    return values.astype(np.int32)
