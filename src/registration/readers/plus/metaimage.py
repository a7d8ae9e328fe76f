"""PLUS sequences in MetaImage files (``.igs.mha``, ``.igs.mhd``): frames, and text fields for each.

Field names follow the files that PLUS writes and the MetaIO documentation (ITK wiki, MetaIO/Documentation).
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.io.metaimage_file import read_metaimage_file
from registration.readers.plus.sequence import (
    PlusSequence,
    is_placeholder,
    numbered_fields,
    split_fields,
    to_mf,
)

_STRUCTURAL = {
    "NDims", "DimSize", "ElementType", "ElementNumberOfChannels", "ElementDataFile", "CompressedData",
    "CompressedDataSize", "BinaryData", "BinaryDataByteOrderMSB", "ElementByteOrderMSB", "HeaderSize",
    "UltrasoundImageOrientation", "ObjectType",
}  # fmt: skip
_WRITTEN = {"u1": "MET_UCHAR", "i1": "MET_CHAR", "u2": "MET_USHORT", "i2": "MET_SHORT", "u4": "MET_UINT"}
_WRITTEN |= {"i4": "MET_INT", "f4": "MET_FLOAT", "f8": "MET_DOUBLE"}


def read_metaimage(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a MetaImage sequence.

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
        If the header is no MetaImage's, the orientation is missing, the pixel type is unknown, or there are
        fewer pixels than the header promises.
    """
    file = read_metaimage_file(path)
    header, by_frame = split_fields(file.fields, path)
    width, height, count = _frame_sizes(file.sizes, header, path)
    if is_placeholder(width, height):
        count = max(count, max(by_frame, default=-1) + 1)
    frame_fields = tuple(by_frame.get(number, {}) for number in range(count))
    kept_header = {key: value for key, value in header.items() if key not in _STRUCTURAL}
    if is_placeholder(width, height):
        return PlusSequence(np.zeros((count, 0, 0), np.uint8), frame_fields, kept_header)
    stored = orientation or header.get("UltrasoundImageOrientation")
    if stored is None:
        raise InputError(
            f"{path}: expected the field UltrasoundImageOrientation, found none (set orientation)"
        )
    shape = (count, height, width, file.channels) if file.channels > 1 else (count, height, width)
    return PlusSequence(to_mf(file.values.reshape(shape), stored, path), frame_fields, kept_header)


def metaimage_bytes(sequence: PlusSequence, compressed: bool) -> bytes:
    """Format a file that PLUS, MetaIO and SimpleITK read; orientation MF.

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
    pixels = np.ascontiguousarray(sequence.pixels)
    code = _WRITTEN.get(pixels.dtype.newbyteorder("=").str[1:])
    if code is None:
        raise InputError(f"pixels: expected one of {', '.join(_WRITTEN)}, received {pixels.dtype}")
    raw = pixels.astype(pixels.dtype.newbyteorder("<"), copy=False).tobytes()
    compressed = compressed and len(raw) > 0
    data = zlib.compress(raw, 6) if compressed else raw
    count, height, width = pixels.shape[:3]
    fields = [("ObjectType", "Image"), ("NDims", "3"), ("BinaryData", "True")]
    fields += [("BinaryDataByteOrderMSB", "False"), ("CompressedData", str(compressed))]
    fields += [("CompressedDataSize", str(len(data)))] if compressed else []
    fields += [("DimSize", f"{width} {height} {count}")]
    fields += [("ElementNumberOfChannels", str(pixels.shape[3]))] if pixels.ndim == 4 else []
    fields += [("ElementType", code), ("UltrasoundImageOrientation", "MF")]
    known = {"Kinds": "domain domain list", "ElementSpacing": "1 1 1", "Offset": "0 0 0"}
    known |= {"TransformMatrix": "1 0 0 0 1 0 0 0 1", "AnatomicalOrientation": "RAI"}
    known |= {"UltrasoundImageType": "BRIGHTNESS"}
    fields += list((known | dict(sequence.header)).items())
    fields += numbered_fields(sequence.frame_fields)
    text = "".join(f"{key} = {value}\n" for key, value in fields) + "ElementDataFile = LOCAL\n"
    return text.encode("latin-1") + data


def _frame_sizes(sizes: tuple[int, ...], header: dict[str, str], path: Path) -> tuple[int, int, int]:
    """Width, height and number of 2-D frames."""
    kinds = header.get("Kinds", "").split()
    if "list" in kinds[:-1]:
        raise InputError(f"{path}: expected the frames as the last axis, found Kinds {' '.join(kinds)}")
    # PLUS writes 2-D frames as width height count, or as width height 1 count.
    if len(sizes) == 4 and sizes[2] == 1:
        sizes = (sizes[0], sizes[1], sizes[3])
    if len(sizes) == 2:
        sizes = (*sizes, 1)
    if len(sizes) != 3:
        raise InputError(
            f"{path}: expected DimSize 'width height count' of 2-D frames, found {header['DimSize']}"
        )
    return sizes[0], sizes[1], sizes[2]
