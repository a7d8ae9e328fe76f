"""Rigid transforms from and to files: JSON and text of this package's, and ITK's, which 3D Slicer and ANTs write.

An ITK transform maps points of the fixed image to points of the moving one, because that is the way a resampler asks;
both in LPS. In a file of ITK's (.tfm, .txt, .h5, and the binary .mat of 3D Slicer and of ANTs, as
``0GenericAffine.mat``), a ``fixed_T_moving`` is therefore its inverse, ``moving_T_fixed``, whose centre of rotation is
applied. 3D Slicer inverts what it reads again, so that a moving model put under the transform lies on the fixed one
(Slicer developer guide, "Transforms"). In JSON, and in text of four rows of four numbers, it is ``fixed_T_moving``
itself: columns as in ``p_fixed = M @ p_moving``, mm, LPS.
"""

from __future__ import annotations

import codecs
import json
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.input_files import guarded
from registration.io.atomic import atomic_write
from registration.io.itk_mat import require_itk_mat
from registration.io.trial_process import require_harmless_transform
from registration.io.truncation import require_file
from registration.text_files import parse_number, read_text

ITK_SUFFIXES = (".tfm", ".txt", ".h5", ".hdf5", ".mat")
WRITABLE = (".tfm", ".h5")
KEY = "fixed_T_moving"
_ITK_TEXT = "#Insight Transform File"
_BETWEEN = re.compile(r"[\s,;\[\]]+")
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@guarded("a transform")
def read_transform(path: Path) -> Float64[np.ndarray, "4 4"]:
    """Read a ``fixed_T_moving`` in mm.

    Parameters
    ----------
    path : Path
        JSON with that name, 4x4 text (.txt), or an ITK file (.tfm, .txt, .h5, .mat), which is inverted; the
        module's description says which way each maps.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform from moving to fixed.

    Raises
    ------
    InputError
        If the file is missing, unreadable or of another kind, or the transform not rigid.
    """
    path = require_file(path)
    suffix = path.suffix.lower()
    if suffix == ".json":
        fixed_T_moving = _rigid(path, _read_json(path), KEY)
    elif suffix == ".txt" and not read_text(path).lstrip().startswith(_ITK_TEXT):
        fixed_T_moving = _rigid(path, _read_rows(path), KEY)
    elif suffix in ITK_SUFFIXES:
        fixed_T_moving = transforms.invert_rigid(_rigid(path, _read_itk(path), "transform"))
    else:
        raise InputError(
            f"{path}: expected a transform as .json, {', '.join(ITK_SUFFIXES)}, received {suffix or 'no suffix'}"
        )
    return fixed_T_moving


def write_transform(path: Path, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> None:
    """Write a rigid transform as an ITK file, in ITK's direction.

    Parameters
    ----------
    path : Path
        File ending in ``.tfm`` or ``.h5``; its folder must exist.
    fixed_T_moving : ndarray, shape (4, 4)
        Rigid transform from moving to fixed in mm.

    Raises
    ------
    InputError
        If the suffix is another or the transform not rigid.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITABLE:
        raise InputError(
            f"{path}: expected one of {', '.join(WRITABLE)} to write, received {path.suffix or 'none'}"
        )
    moving_T_fixed = transforms.invert_rigid(transforms.require_rigid(fixed_T_moving, KEY))
    sitk = _sitk()
    transform = sitk.AffineTransform(3)
    transform.SetMatrix(moving_T_fixed[:3, :3].ravel().tolist())
    transform.SetTranslation(moving_T_fixed[:3, 3].tolist())
    with atomic_write(path) as temporary:
        sitk.WriteTransform(transform, str(temporary))


def _rigid(path: Path, matrix: np.ndarray, name: str) -> np.ndarray:
    try:
        return transforms.require_rigid(matrix, name)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal


def _read_rows(path: Path) -> np.ndarray:
    """Four rows of four numbers, between blanks, commas, semicolons or brackets; what follows a # is left out."""
    lines = [line.partition("#")[0] for line in read_text(path).splitlines()]
    rows = [_BETWEEN.sub(" ", line).split() for line in lines]
    rows = [row for row in rows if row]
    try:
        if [len(row) for row in rows] != [4] * 4:
            raise ValueError(f"rows of {', '.join(str(len(row)) for row in rows) or 'no'} numbers")
        matrix = np.array([[parse_number(entry) for entry in row] for row in rows], dtype=np.float64)
    except ValueError as refusal:
        raise InputError(
            f"{path}: expected {KEY} as 4 rows of 4 numbers or an ITK transform, received {refusal}"
        ) from refusal
    if (matrix[3, :3] != 0).any() and (matrix[:3, 3] == 0).all() and matrix[3, 3] == 1:
        raise InputError(f"{path}: expected {KEY} with last row 0 0 0 1, received a transposed one")
    return matrix


def _read_json(path: Path) -> np.ndarray:
    try:
        content = json.loads(read_text(path))
        if not isinstance(content, dict) or KEY not in content:
            names = ", ".join(map(str, content)) if isinstance(content, dict) else type(content).__name__
            raise ValueError(f"no {KEY}: {names or 'nothing'}")
        matrix = np.array(content[KEY], dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"an array of shape {matrix.shape}")
    except (ValueError, TypeError) as refusal:
        raise InputError(f"{path}: expected {KEY} as 4 rows of 4 numbers, received {refusal}") from refusal
    return matrix


def _read_itk(path: Path) -> np.ndarray:
    """The 4x4 matrix of a linear transform, found from where it takes four points, whatever class wrote it."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        require_whole_hdf5(path)
        require_harmless_transform(path)
    if path.suffix.lower() == ".mat":
        require_itk_mat(path)
    sitk = _sitk()
    try:
        with _without_mark(path) as plain:
            transform = sitk.ReadTransform(str(plain))
    except RuntimeError as refusal:
        # ITK's own report has several lines, with places in its sources.
        raise InputError(
            f"{path}: expected a complete ITK transform, received a file that cannot be read as one"
        ) from refusal
    if path.suffix.lower() in (".tfm", ".txt"):
        _require_whole_text(path, transform)
    if transform.GetDimension() != 3 or not transform.IsLinear():
        raise InputError(
            f"{path}: expected a linear transform in three dimensions, received {transform.GetName()} "
            f"in {transform.GetDimension()}"
        )
    origin = np.array(transform.TransformPoint((0.0, 0.0, 0.0)))
    columns = [np.array(transform.TransformPoint(unit)) - origin for unit in np.eye(3).tolist()]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.stack(columns, axis=1), origin
    return matrix


@contextmanager
def _without_mark(path: Path) -> Iterator[Path]:
    """The file, or where it is text with a byte-order mark, which ITK does not know, a copy without."""
    with path.open("rb") as stream:
        marked = stream.read(3).startswith((codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if not marked:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / path.name
        plain.write_text(read_text(path), encoding="utf-8")
        yield plain


def require_whole_hdf5(path: Path) -> None:
    """Refuse what is no HDF5 file or shorter than it says, for which the library prints a page before it fails.

    Parameters
    ----------
    path : Path
        File.

    Raises
    ------
    InputError
        If it is no whole HDF5 file.

    Notes
    -----
    HDF5 File Format Specification, superblock: the version follows the signature, and the address of the end of the
    file is the third of four addresses that begin at byte 24 (versions 0 and 1), 28 (1) or 12 (2 and 3).
    """
    data = path.read_bytes()
    if not data.startswith(HDF5_SIGNATURE) or len(data) < 64:
        raise InputError(
            f"{path}: expected an HDF5 file, received {len(data)} bytes of another kind or cut short"
        )
    version = data[8]
    width = data[13] if version < 2 else data[9]
    place = {0: 24, 1: 28}.get(version, 12) + 2 * width
    end = int.from_bytes(data[place : place + width], "little")
    if len(data) < end:
        raise InputError(f"{path}: expected an HDF5 file of {end} bytes, received {len(data)}: cut short")


def _require_whole_text(path: Path, transform: Any) -> None:
    """Refuse a text file that lacks a line or a number, in whose place ITK puts the identity without a word."""
    parts = [transform]
    if transform.GetName() == "CompositeTransform":
        composite = _sitk().CompositeTransform(transform)
        parts = [composite.GetNthTransform(number) for number in range(composite.GetNumberOfTransforms())]
    expected = [
        (key, len(values))
        for part in parts
        for key, values in (
            ("Parameters", part.GetParameters()),
            ("FixedParameters", part.GetFixedParameters()),
        )
    ]
    lines = [line.partition(":") for line in read_text(path).splitlines()]
    found = [(key, len(values.split())) for key, _, values in lines if key.endswith("Parameters")]
    if found != expected:
        raise InputError(
            f"{path}: expected {sum(count for _, count in expected)} numbers in {len(expected)} lines of parameters, "
            f"received {sum(count for _, count in found)} in {len(found)}: cut short"
        )


def _sitk() -> Any:
    """SimpleITK, imported only where a transform is read or written, with its reports kept off the terminal."""
    import SimpleITK

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    return SimpleITK
