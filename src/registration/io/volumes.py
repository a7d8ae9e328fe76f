"""Volumes from files, complete or refused: what the reading library leaves unsaid is checked here.

SimpleITK reads voxels and axes. It sees a copy whose voxels were unpacked and counted here (it takes packed voxels with
a wrong sum or without their end for others), whose NIfTI transforms agree, and whose lengths become millimetres after.
"""

from __future__ import annotations

import gzip
import shutil
import struct
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.input_files import guarded, require_unpacked_size
from registration.io.length_units import MM_PER_UNIT, quoted, require_plain_lengths, stated_units
from registration.io.metaimage_file import read_metaimage_file
from registration.io.nifti_header import FORMS, NiftiHeader, read_nifti_header
from registration.io.nrrd_file import nrrd_header, read_nrrd_file
from registration.io.truncation import require_file

# The suffixes that are read, and SimpleITK's name of what reads them: the choice is not left to a file's content.
READERS = {
    ".nii": "NiftiImageIO",
    ".nii.gz": "NiftiImageIO",
    ".nrrd": "NrrdImageIO",
    ".nhdr": "NrrdImageIO",
    ".mha": "MetaImageIO",
    ".mhd": "MetaImageIO",
}
# Under this name the image carries the unit that the file states, empty where it states none.
UNITS_KEY = "stated units"
_MOST_AXES = 10
# The library writes what it does not know into a message of fixed length, past its end.
_LONGEST_FIELD = 400
_NRRD_LENGTHS = ("space directions", "space origin", "spacings", "axis mins", "axis maxs", "thicknesses")
_META_LENGTHS = (
    *("TransformMatrix", "Orientation", "Rotation", "Offset", "Position", "Origin", "CenterOfRotation"),
    *("ElementSpacing", "ElementSize"),
)
# Programs may write a little after the voxels; what is more is none of theirs.
_NIFTI_HEAD, _BLOCK, _AFTER_VOXELS = 544, 1 << 20, 1 << 16
_DETACHED = {"ElementDataFile", "CompressedData", "CompressedDataSize", "HeaderSize", "BinaryData"}
_DETACHED |= {"BinaryDataByteOrderMSB", "ElementByteOrderMSB"}


@dataclass(frozen=True)
class _Copy:
    """A file that SimpleITK reads as it should, and what the library leaves out.

    ``units`` are those of the axes of space (or of the voxels' axes, where the file names no others), empty where
    none are stated; ``lps_A_voxel`` is in mm, None where SimpleITK's is taken.
    """

    path: Path
    units: tuple[str, ...] = ()
    lps_A_voxel: Float64[np.ndarray, "4 4"] | None = None


def volume_suffix(path: Path) -> str:
    """Return the suffix of a volume's file in small letters (``.nii.gz`` is one).

    Parameters
    ----------
    path : Path
        File.

    Returns
    -------
    str
        Suffix, empty if it is none that is read.
    """
    name = Path(path).name.lower()
    return next((suffix for suffix in sorted(READERS, key=len, reverse=True) if name.endswith(suffix)), "")


@guarded("a volume")
def read_volume(path: Path, units: str | None = None, nifti_form: str | None = None) -> Any:
    """Read a volume by SimpleITK, its lengths in millimetres.

    Parameters
    ----------
    path : Path
        NIfTI, NRRD or MetaImage file.
    units : {'mm', 'cm', 'm', 'um'}, optional
        Unit of the file's lengths in place of the one that its header states (mm where it states none).
    nifti_form : {'qform', 'sform'}, optional
        Which of two transforms of a NIfTI file counts where they differ.

    Returns
    -------
    SimpleITK.Image
        Image in LPS and mm.

    Raises
    ------
    InputError
        If the file is missing, unreadable or cut short, its transforms differ without a choice, or its unit
        is not known.
    """
    import SimpleITK

    path = require_file(Path(path))
    suffix = volume_suffix(path)
    if not suffix:
        raise InputError(
            f"{path}: expected one of {', '.join(READERS)}, received {path.suffix or 'no suffix'}"
        )
    if nifti_form is not None and (nifti_form not in FORMS or READERS[suffix] != READERS[".nii"]):
        raise InputError(
            f"nifti_form: expected {' or '.join(FORMS)}, and that for NIfTI files alone, received {nifti_form!r} for "
            f"{path.name}"
        )
    with _complete(path, suffix, units, nifti_form) as copy:
        reader = SimpleITK.ImageFileReader()
        reader.SetImageIO(READERS[suffix])
        reader.SetFileName(str(copy.path))
        SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
        try:
            image = reader.Execute()
        except RuntimeError as refusal:
            raise InputError(f"{path}: {_why(str(refusal), suffix)}") from refusal
    return _placed(image, copy, units)


def _why(message: str, suffix: str) -> str:
    if "orthonormal" in message:
        return "expected axes at right angles, received a header with sheared ones"
    kind = READERS[suffix].removesuffix("ImageIO")
    return (
        f"expected a complete {kind} volume, received one that cannot be read (cut short, or of another kind)"
    )


def _placed(image: Any, copy: _Copy, units: str | None) -> Any:
    """The image with its lengths in millimetres, and the unit that its file states among its metadata."""
    # NIfTI files of one volume may have a fourth axis of a single entry.
    while image.GetDimension() > 3 and image.GetSize()[-1] == 1:
        image = image[(slice(None),) * (image.GetDimension() - 1) + (0,)]
    dimension = image.GetDimension()
    if copy.lps_A_voxel is not None and dimension == 3:
        _set_axes(image, copy.lps_A_voxel)
    else:
        used = (units,) * dimension if units is not None else copy.units[:dimension]
        if used:
            factors = np.diag([*(MM_PER_UNIT[unit] for unit in used), *[1.0] * (dimension - len(used)), 1.0])
            _set_axes(image, factors @ _axes(image))
    image.SetMetaData(UNITS_KEY, " ".join(dict.fromkeys(copy.units)))
    return image


def _axes(image: Any) -> Float64[np.ndarray, "m m"]:
    dimension = image.GetDimension()
    matrix = np.eye(dimension + 1)
    direction = np.array(image.GetDirection(), dtype=np.float64).reshape(dimension, dimension)
    matrix[:-1, :-1] = direction * np.array(image.GetSpacing(), dtype=np.float64)
    matrix[:-1, -1] = image.GetOrigin()
    return matrix


def _set_axes(image: Any, matrix: Float64[np.ndarray, "m m"]) -> None:
    spacing = np.linalg.norm(matrix[:-1, :-1], axis=0)
    # A size of nothing is refused where the axes are read; it must not become NaN here.
    image.SetSpacing(np.where(spacing > 0, spacing, 1.0).tolist())
    image.SetDirection((matrix[:-1, :-1] / np.where(spacing > 0, spacing, 1.0)).reshape(-1).tolist())
    image.SetOrigin(matrix[:-1, -1].tolist())


@contextmanager
def _complete(path: Path, suffix: str, units: str | None, form: str | None) -> Iterator[_Copy]:
    """Give a copy that is known to be complete."""
    with tempfile.TemporaryDirectory() as folder:
        if suffix in (".nii", ".nii.gz"):
            yield _nifti(path, suffix, Path(folder) / "volume.nii", units, form)
        elif suffix in (".nrrd", ".nhdr"):
            yield _nrrd(path, Path(folder) / "volume.nrrd")
        else:
            yield _metaimage(path, Path(folder) / "volume.mha")


def _nrrd(path: Path, target: Path) -> _Copy:
    file = read_nrrd_file(path)
    _require_axes(path, file.fields.get("dimension", ""), len(file.sizes))
    for field in _NRRD_LENGTHS:
        require_plain_lengths(file.fields.get(field, ""), field, path)
    # How the image was made, in the words of the tools that made it: as long as they like.
    fields = {name: value for name, value in file.fields.items() if name != "content"}
    for field, value in fields.items():
        if len(field) + len(value) > _LONGEST_FIELD:
            raise InputError(
                f"{path}: expected NRRD fields of at most {_LONGEST_FIELD} characters, found {field[:20]!r} of "
                f"{len(field) + len(value)}"
            )
    with target.open("wb") as stream:
        stream.write(nrrd_header(fields, file.keys, "raw"))
        stream.write(np.ascontiguousarray(file.values.astype(file.values.dtype.newbyteorder("<"))).tobytes())
    if file.fields.get("space", "").lower().startswith("3d-left-handed"):
        raise InputError(
            f"{path}: expected axes of the patient or right-handed ones, received space {file.fields['space']}, "
            "which may be a mirror image"
        )
    # Where the header has directions, lengths are along the axes of space, otherwise along those of the voxels.
    field = "space units" if "space directions" in file.fields else "units"
    return _Copy(target, stated_units(quoted(file.fields.get(field, "")), field, path))


def _require_axes(path: Path, stated: str, sizes: int) -> None:
    """Libraries follow the stated number of axes without a look at how many sizes there are."""
    if stated != str(sizes) or sizes > _MOST_AXES:
        raise InputError(
            f"{path}: expected as many axes as sizes, found {stated or 'none'} and {sizes} sizes"
        )


def _metaimage(path: Path, target: Path) -> _Copy:
    file = read_metaimage_file(path)
    _require_axes(path, file.fields.get("NDims", ""), len(file.sizes))
    fields = {name: value for name, value in file.fields.items() if name not in _DETACHED}
    for field in _META_LENGTHS:
        require_plain_lengths(fields.get(field, ""), field, path)
    fields = {"BinaryData": "True", "BinaryDataByteOrderMSB": "False", "CompressedData": "False"} | fields
    # ObjectType comes first in a file that MetaIO writes, ElementDataFile last in any.
    ordered = {"ObjectType": fields.pop("ObjectType", "Image"), **fields, "ElementDataFile": "LOCAL"}
    with target.open("wb") as stream:
        stream.write("".join(f"{name} = {value}\n" for name, value in ordered.items()).encode("latin-1"))
        stream.write(np.ascontiguousarray(file.values.astype(file.values.dtype.newbyteorder("<"))).tobytes())
    stated = stated_units([file.fields.get("DistanceUnits", "")], "DistanceUnits", path)
    return _Copy(target, stated * len(file.sizes))


def _nifti(path: Path, suffix: str, target: Path, units: str | None, form: str | None) -> _Copy:
    """The reader returns zeros for what is missing of a NIfTI file, without a word, and takes one of two transforms."""
    # Unpacked under a name of its own: the reader would prefer a file x.nii next to x.nii.gz.
    source = path
    if suffix == ".nii.gz":
        _unpack(path, target)
        source = target
    header = read_nifti_header(source, path)
    _require_bytes(path, source.stat().st_size, header.bytes)
    unit = units or header.units or "mm"
    name, ras_A_voxel = header.ras_A_voxel(form, MM_PER_UNIT[unit], path)
    if source != target and (header.qform is not None) and (header.sform is not None):
        shutil.copyfile(source, target)
        source = target
    if source == target:
        _keep_form(target, header, name)
    lps_A_voxel = np.diag([-1.0, -1.0, 1.0, 1.0]) @ ras_A_voxel if name else ras_A_voxel
    for number in (*header.spacing, *ras_A_voxel.ravel()):
        require_plain_lengths(f"{number:g}", "pixdim, qform or sform", path)
    return _Copy(source, (header.units,) * 3 if header.units else (), lps_A_voxel)


def _keep_form(path: Path, header: NiftiHeader, name: str) -> None:
    """Take the code of the other transform out of a copy, so that the reader has no choice."""
    for form, place in zip(FORMS, header.code_places, strict=True):
        if name and form != name:
            with path.open("r+b") as stream:
                stream.seek(place)
                stream.write(struct.pack(header.code_format, 0))


def _unpack(path: Path, target: Path) -> None:
    """Unpack no more than the header asks for, and to the end, where the sum is checked."""
    try:
        with gzip.open(path) as packed, target.open("wb") as stream:
            head = packed.read(_NIFTI_HEAD)
            stream.write(head)
            stream.flush()
            size = read_nifti_header(target, path).bytes
            require_unpacked_size(size, path.stat().st_size, path)
            left = size + _AFTER_VOXELS - len(head)
            while block := packed.read(min(_BLOCK, left + 1)):
                left -= len(block)
                if left < 0:
                    raise InputError(f"{path}: expected {size} bytes, as its header says, found more")
                stream.write(block)
    except (EOFError, gzip.BadGzipFile, zlib.error) as refusal:
        raise InputError(
            f"{path}: expected a complete gzip file, received one that breaks off ({refusal})"
        ) from refusal


def _require_bytes(path: Path, received: int, expected: int) -> None:
    if received < expected:
        raise InputError(f"{path}: expected at least {expected} bytes of it, received {received}: cut short")
