"""PLUS sequences in MetaImage files (``.igs.mha``): a text header, then raw or zlib-compressed pixels.

Field names follow the files that PLUS writes and the MetaIO documentation (ITK wiki, MetaIO/Documentation).
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.readers.sequence import PlusSequence, numbered_fields, split_fields, to_mf

_TYPES = {
    "MET_UCHAR": "u1",
    "MET_CHAR": "i1",
    "MET_USHORT": "u2",
    "MET_SHORT": "i2",
    "MET_UINT": "u4",
    "MET_INT": "i4",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
_STRUCTURAL = {
    "NDims", "DimSize", "ElementType", "ElementNumberOfChannels", "ElementDataFile", "CompressedData",
    "CompressedDataSize", "BinaryData", "BinaryDataByteOrderMSB", "UltrasoundImageOrientation", "ObjectType",
}  # fmt: skip
_LONGEST_HEADER_LINE = 1 << 20


def read_metaimage(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a sequence; ``orientation`` stands in for (and overrules) the one that the file names.

    Raises InputError, naming the file, for a header that is no MetaImage's, a missing orientation, an unknown pixel
    type, or fewer pixels than the header promises.
    """
    fields, data = _read_parts(path)
    header, by_frame = split_fields(fields, path)
    size = _dim_size(header, path)
    width, height, count = size
    count = max(count, max(by_frame, default=-1) + 1) if 0 in (width, height) else count
    frame_fields = tuple(by_frame.get(number, {}) for number in range(count))
    kept_header = {key: value for key, value in header.items() if key not in _STRUCTURAL}
    if 0 in (width, height):
        return PlusSequence(np.zeros((count, 0, 0), np.uint8), frame_fields, kept_header)
    stored = orientation or header.get("UltrasoundImageOrientation")
    if stored is None:
        raise InputError(
            f"{path}: expected the field UltrasoundImageOrientation, found none (set orientation)"
        )
    pixels = _decode(header, data, (count, height, width), path)
    return PlusSequence(to_mf(pixels, stored, path), frame_fields, kept_header)


def metaimage_bytes(sequence: PlusSequence, compressed: bool) -> bytes:
    """The content of a file that PLUS, MetaIO and SimpleITK read; orientation MF."""
    pixels = np.ascontiguousarray(sequence.pixels)
    code = {np.dtype(kind): name for name, kind in _TYPES.items()}.get(pixels.dtype.newbyteorder("="))
    if code is None:
        raise InputError(f"pixels: expected one of {', '.join(_TYPES.values())}, received {pixels.dtype}")
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


def _read_parts(path: Path) -> tuple[dict[str, str], bytes]:
    """The header's fields in order, and the bytes after it (or in the file that it names)."""
    fields: dict[str, str] = {}
    try:
        with path.open("rb") as stream:
            while True:
                line = stream.readline(_LONGEST_HEADER_LINE)
                key, equals, value = line.decode("latin-1").partition("=")
                if not equals:
                    raise InputError(
                        f"{path}: expected a MetaImage header of 'name = value' lines, found another"
                    )
                fields[key.strip()] = value.strip()
                if key.strip() == "ElementDataFile":
                    break
            local = fields["ElementDataFile"].upper() == "LOCAL"
            return fields, stream.read() if local else (path.parent / fields["ElementDataFile"]).read_bytes()
    except OSError as failure:
        raise InputError(
            f"{path}: expected a readable file, found {failure.strerror or failure}"
        ) from failure


def _dim_size(header: dict[str, str], path: Path) -> tuple[int, int, int]:
    try:
        size = [int(number) for number in header["DimSize"].split()]
    except (KeyError, ValueError) as failure:
        raise InputError(
            f"{path}: expected DimSize with whole numbers, found {header.get('DimSize')}"
        ) from failure
    # PLUS writes 2-D frames as width height count, or as width height 1 count.
    if len(size) == 4 and size[2] == 1:
        size = [size[0], size[1], size[3]]
    if len(size) == 2:
        size = [*size, 1]
    if len(size) != 3 or min(size) < 0:
        raise InputError(
            f"{path}: expected DimSize 'width height count' of 2-D frames, found {header['DimSize']}"
        )
    return size[0], size[1], size[2]


def _decode(header: dict[str, str], data: bytes, shape: tuple[int, int, int], path: Path) -> np.ndarray:
    kind = _TYPES.get(header.get("ElementType", ""))
    if kind is None:
        raise InputError(
            f"{path}: expected ElementType {', '.join(_TYPES)}, found {header.get('ElementType')}"
        )
    order = ">" if header.get("BinaryDataByteOrderMSB", "False").lower() == "true" else "<"
    if header.get("CompressedData", "False").lower() == "true":
        try:
            data = zlib.decompressobj().decompress(data)
        except zlib.error as failure:
            raise InputError(
                f"{path}: expected zlib-compressed pixels, found broken data ({failure})"
            ) from failure
    channels = int(header.get("ElementNumberOfChannels", "1"))
    full_shape = shape if channels == 1 else (*shape, channels)
    expected = int(np.prod(full_shape)) * np.dtype(kind).itemsize
    if len(data) < expected:
        raise InputError(
            f"{path}: expected {expected} bytes of pixels, found {len(data)} (a truncated file?)"
        )
    numbers = np.frombuffer(data, np.dtype(order + kind), count=expected // np.dtype(kind).itemsize)
    return numbers.reshape(full_shape).astype(kind, copy=False)
