"""Whether a .mat file is a complete transform that ITK wrote: MATLAB's format 4, as ANTs and 3D Slicer use it.

A variable is five 32-bit numbers (type, rows, columns, imaginary, length of the name), the name, and the values, by
columns (MAT-File Format, "Level 4"). ITK writes two: the transform's parameters under the name of its class, and its
fixed ones (the centre of rotation) under ``fixed``.
"""

from __future__ import annotations

import struct
from pathlib import Path

from registration.errors import InputError

_FIXED = "fixed"
_LONGEST_NAME = 256
# The tens of a variable's type are the size of its values.
_BYTES = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}


def require_itk_mat(path: Path) -> None:
    """Raise InputError unless a .mat file is a complete transform that ITK wrote.

    Parameters
    ----------
    path : Path
        File ending in ``.mat``.

    Raises
    ------
    InputError
        If the file is text (as FSL writes it), of another version of MATLAB's format, or cut short.
    """
    data = path.read_bytes()
    if data.startswith(b"MATLAB 5.0") or data.startswith(b"\x89HDF"):
        raise InputError(
            f"{path}: expected a transform of ITK (MATLAB 4), received variables of a later MATLAB"
        )
    if len(_numbers(data)) >= 12:
        raise InputError(
            f"{path}: expected a binary transform of ITK, ANTs or 3D Slicer, received text (FSL's matrices are between "
            "voxels; four rows of fixed_T_moving in mm are read from .txt)"
        )
    names = _variables(path, data)
    if len(names) != 2 or names[1] != _FIXED:
        raise InputError(
            f"{path}: expected a transform and its fixed parameters, received {', '.join(names) or 'no variable'}"
        )


def _numbers(data: bytes) -> list[float]:
    """The numbers of a file that is text, none of one that is not."""
    try:
        return [float(word) for word in data.decode("ascii").split()]
    except ValueError:
        return []


def _variables(path: Path, data: bytes) -> list[str]:
    names: list[str] = []
    at = 0
    while at < len(data):
        order = "<" if len(data) >= at + 4 and struct.unpack_from("<I", data, at)[0] < 5000 else ">"
        if len(data) < at + 20:
            raise InputError(
                f"{path}: expected a complete variable, received {len(data) - at} bytes of one: cut short"
            )
        kind, rows, columns, _, length = struct.unpack_from(f"{order}5I", data, at)
        if kind // 10 % 10 not in _BYTES or not 0 < length <= _LONGEST_NAME or rows * columns > len(data):
            raise InputError(
                f"{path}: expected a transform of ITK (MATLAB 4), received another file or one cut short"
            )
        end = at + 20 + length + rows * columns * _BYTES[kind // 10 % 10]
        if len(data) < end:
            raise InputError(f"{path}: expected {end} bytes, received {len(data)}: cut short")
        names.append(data[at + 20 : at + 20 + length].rstrip(b"\0").decode("ascii", errors="replace"))
        at = end
    return names
