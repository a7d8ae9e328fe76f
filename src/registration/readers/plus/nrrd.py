"""PLUS sequences in NRRD files (``.igs.nrrd``, ``.igs.nhdr``): frames, and text keys for each.

Which axis holds the frames and which the colours is in ``kinds``: PLUS writes the frames last, 3D Slicer first.
"""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.io.nrrd_file import NrrdFile, read_nrrd_file
from registration.readers.plus.sequence import (
    PlusSequence,
    is_placeholder,
    numbered_fields,
    split_fields,
    to_mf,
)

_WRITTEN = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32"}
_WRITTEN |= {"f4": "float", "f8": "double"}
_PLANE = {"domain", "space"}
_FRAMES = {"list", "time"}
_COLOURS = {"vector", "RGB-color", "RGBA-color", "3-color", "4-color", "3-vector", "4-vector"}
_NO_AXIS = {"scalar", "stub"}
# Of a header's fields those that speak of the numbers' layout alone, which a sequence in memory does not keep.
_KEPT_OUT = {
    "dimension", "encoding", "endian", "kinds", "sizes", "space dimension", "space directions", "space origin", "type",
    "space", "data file", "byte skip", "line skip", "ultrasound image orientation",
}  # fmt: skip


def read_nrrd(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a NRRD sequence.

    Parameters
    ----------
    path : Path
        Sequence file.
    orientation : str, optional
        Orientation in place of the one that the file names.

    Returns
    -------
    PlusSequence
        Everything in the file, orientation MF.

    Raises
    ------
    InputError
        If the file is no NRRD, its encoding or type is not known, its axes are no 2-D frames, or there are
        fewer pixels than the header promises.
    """
    file = read_nrrd_file(path)
    header, by_frame = split_fields(file.fields | file.keys, path)
    pixels = _frames_first(file, path)
    count, height, width = pixels.shape[:3]
    if is_placeholder(width, height):
        count = max(count, max(by_frame, default=-1) + 1)
    # In NRRD files PLUS names the status of a frame's image Status, in MetaImage files ImageStatus.
    frame_fields = tuple(
        {"ImageStatus" if key == "Status" else key: value for key, value in by_frame.get(number, {}).items()}
        for number in range(count)
    )
    kept_header = {key: value for key, value in header.items() if key not in _KEPT_OUT}
    # An NRRD axis cannot have size 0: PLUS gives recordings of poses alone one pixel a frame.
    if is_placeholder(width, height):
        return PlusSequence(np.zeros((count, 0, 0), np.uint8), frame_fields, kept_header)
    stored = orientation or header.get("ultrasound image orientation")
    if stored is None:
        raise InputError(
            f"{path}: expected the key 'ultrasound image orientation', found none (set orientation)"
        )
    return PlusSequence(to_mf(pixels, stored, path), frame_fields, kept_header)


def nrrd_bytes(sequence: PlusSequence, compressed: bool) -> bytes:
    """Format a file that PLUS and SimpleITK read; orientation MF.

    Parameters
    ----------
    sequence : PlusSequence
        What to write.
    compressed : bool
        Whether pixels are compressed.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    InputError
        If the type of the pixels is none of the format's.
    """
    empty = np.zeros((len(sequence.frame_fields), 1, 1), np.uint8)
    pixels = empty if sequence.tracker_only else np.ascontiguousarray(sequence.pixels)
    name = _WRITTEN.get(pixels.dtype.newbyteorder("=").str[1:])
    if name is None:
        raise InputError(f"pixels: expected one of {', '.join(_WRITTEN)}, received {pixels.dtype}")
    raw = pixels.astype(pixels.dtype.newbyteorder("<"), copy=False).tobytes()
    count, height, width = pixels.shape[:3]
    vector = pixels.ndim == 4
    sizes = [*map(str, pixels.shape[3:]), str(width), str(height), str(count)]
    lines = ["NRRD0004", f"type: {name}", f"dimension: {len(sizes)}", "space dimension: 2"]
    lines += [f"sizes: {' '.join(sizes)}", f"kinds: {'vector ' if vector else ''}domain domain list"]
    lines += [f"space directions: {'none ' if vector else ''}(1,0) (0,1) none", "endian: little"]
    lines += [f"encoding: {'gzip' if compressed else 'raw'}", "space origin: (0,0)"]
    keys = {} if sequence.tracker_only else {"ultrasound image orientation": "MF"}
    keys |= {"ultrasound image type": "BRIGHTNESS"} | dict(sequence.header)
    renamed = tuple(
        {"Status" if key == "ImageStatus" else key: value for key, value in fields.items()}
        for fields in sequence.frame_fields
    )
    lines += [f"{key}:={value}" for key, value in [*keys.items(), *numbered_fields(renamed)]]
    return ("\n".join(lines) + "\n\n").encode("latin-1") + (
        gzip.compress(raw, 6, mtime=0) if compressed else raw
    )


def _frames_first(file: NrrdFile, path: Path) -> np.ndarray:
    """The numbers as (frame, row, column), and a last axis for the channels where there are several."""
    roles = _roles(file, path)
    # The header lists the fastest axis first, NumPy has it last.
    place = {
        role: len(roles) - 1 - roles.index(role)
        for role in ("frame", "row", "column", "colour")
        if role in roles
    }
    order = [place[role] for role in ("frame", "row", "column", "colour") if role in place]
    alone = [axis for axis in range(len(roles)) if axis not in order]
    pixels = file.values.transpose(*alone, *order)
    pixels = pixels.reshape(pixels.shape[len(alone) :])
    if "frame" not in place:
        pixels = pixels[None]
    return pixels[..., 0] if "colour" in place and pixels.shape[-1] == 1 else pixels


def _roles(file: NrrdFile, path: Path) -> list[str]:
    """What each axis of the header is: column, row, frame, colour, or empty for one of a single entry."""
    kinds = file.per_axis("kinds") or ["???"] * len(file.sizes)
    directions = file.per_axis("space directions")
    refusal = InputError(
        f"{path}: expected two domain axes, at most one list axis (frames) and one of colours, found sizes "
        f"{list(file.sizes)}, kinds {' '.join(kinds)}"
    )
    if len(kinds) != len(file.sizes):
        raise refusal
    roles: list[str] = []
    for axis, (kind, size) in enumerate(zip(kinds, file.sizes, strict=True)):
        if kind in _FRAMES:
            roles.append("frame")
        elif kind in _COLOURS:
            roles.append("colour")
        elif kind in _NO_AXIS and size == 1:
            roles.append("")
        elif kind in _PLANE or (kind in ("???", "none") and _spatial(directions, axis, len(file.sizes))):
            roles.append("plane")
        else:
            raise refusal
    plane = [axis for axis, role in enumerate(roles) if role == "plane"]
    # Software of volumes writes an image as a slice of one voxel.
    if len(plane) == 3 and file.sizes[plane[2]] == 1:
        roles[plane.pop()] = ""
    if len(plane) != 2 or roles.count("frame") > 1 or roles.count("colour") > 1:
        raise refusal
    roles[plane[0]], roles[plane[1]] = "column", "row"
    return roles


def _spatial(directions: list[str], axis: int, count: int) -> bool:
    """Whether an axis without a kind lies in space: where it has a direction, or in a header of two axes alone."""
    if len(directions) == count:
        return directions[axis].lower() != "none"
    return count == 2
