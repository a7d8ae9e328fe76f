"""MetaImage files: a text header and the numbers that it promises, wherever they lie.

After the MetaIO documentation (ITK wiki, MetaIO/Documentation). SimpleITK reads such files too, but takes packed
voxels whose sum is wrong, that break off, or whose ``CompressedDataSize`` is missing, for other numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, beside, guarded
from registration.io.stored_data import Encoding, numbered_files, read_numbers, whole_number

TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4", "MET_INT": "i4",
    "MET_ULONG": "u4", "MET_LONG": "i4", "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
_LONGEST_HEADER_LINE = 1 << 20


@dataclass(frozen=True)
class MetaImageFile:
    """Header and numbers of a MetaImage file.

    Parameters
    ----------
    fields : dict of str to str
        Fields of the header in order.
    sizes : tuple of int
        Sizes of the axes, the fastest first.
    channels : int
        Number of values at each place.
    values : ndarray
        Numbers with the axes in NumPy's order, the fastest last, then one axis for the channels where there
        are several.
    """

    fields: dict[str, str]
    sizes: tuple[int, ...]
    channels: int
    values: np.ndarray


@guarded("a MetaImage file")
def read_metaimage_file(path: Path) -> MetaImageFile:
    """Read header and numbers of a MetaImage file.

    Parameters
    ----------
    path : Path
        File ending in ``.mha`` or ``.mhd``.

    Returns
    -------
    MetaImageFile
        Header and numbers.

    Raises
    ------
    InputError
        If the file is another or holds less than it promises.
    """
    fields, begin, rest = _read_header(path)
    try:
        sizes = tuple(int(number) for number in fields["DimSize"].split())
    except (KeyError, ValueError) as failure:
        raise InputError(
            f"{path}: expected DimSize with whole numbers, found {fields.get('DimSize')}"
        ) from failure
    channels = whole_number(fields.get("ElementNumberOfChannels", "1"), "ElementNumberOfChannels", path)
    kind = TYPES.get(fields.get("ElementType", "").removesuffix("_ARRAY"))
    if kind is None:
        raise InputError(
            f"{path}: expected ElementType {', '.join(TYPES)}, found {fields.get('ElementType')}"
        )
    if not sizes or min(sizes) < 0 or channels < 1:
        raise InputError(
            f"{path}: expected sizes of axes and one channel at least, found {fields['DimSize']}, {channels} channels"
        )
    shape = (*sizes[::-1], channels) if channels > 1 else sizes[::-1]
    count = math.prod(shape)
    values = _values(fields, begin, rest, kind, count, path) if count else np.zeros(0, kind)
    return MetaImageFile(fields, sizes, channels, values.reshape(shape))


def _read_header(path: Path) -> tuple[dict[str, str], int, list[str]]:
    """The fields, the byte after them, and the lines after them where they are names of files."""
    fields: dict[str, str] = {}
    try:
        with path.open("rb") as stream:
            while "ElementDataFile" not in fields and stream.tell() < LARGEST_TEXT_BYTES:
                line = stream.readline(_LONGEST_HEADER_LINE)
                key, equals, value = line.decode("latin-1").partition("=")
                if not equals:
                    raise InputError(
                        f"{path}: expected a MetaImage header that ends in ElementDataFile, found a line without '='"
                    )
                fields[key.strip()] = value.strip()
            begin = stream.tell()
            listed = fields["ElementDataFile"].upper().split()[:1] == ["LIST"]
            rest = stream.read(LARGEST_TEXT_BYTES).decode("latin-1").splitlines() if listed else []
    except OSError as failure:
        raise InputError(
            f"{path}: expected a readable file, found {failure.strerror or failure}"
        ) from failure
    return fields, begin, [line.strip() for line in rest if line.strip()]


def _values(
    fields: dict[str, str], begin: int, rest: list[str], kind: str, count: int, path: Path
) -> np.ndarray:
    files = _data_files(fields["ElementDataFile"], rest, path)
    skipped = whole_number(fields.get("HeaderSize", "0"), "HeaderSize", path)
    packed = fields.get("CompressedData", "False").lower() == "true"
    packing = "zlib" if packed else "ascii" if fields.get("BinaryData", "True").lower() == "false" else "raw"
    # HeaderSize counts from the beginning of the file, also where the voxels follow the header.
    if skipped < -1 or (skipped == -1 and packing != "raw"):
        raise InputError(
            f"{path}: expected a HeaderSize of 0 or more, or -1 for raw voxels, found {skipped}, {packing}"
        )
    begin = skipped if skipped > 0 else begin if files == [path] else 0
    msb = fields.get("ElementByteOrderMSB", fields.get("BinaryDataByteOrderMSB", "False"))
    encoding = Encoding(packing, bytes_skipped=min(skipped, 0), order=">" if msb.lower() == "true" else "<")
    return read_numbers(files, encoding, kind, count, path, begin)


def _data_files(where: str, rest: list[str], path: Path) -> list[Path]:
    words = where.split()
    if where.upper() == "LOCAL":
        return [path]
    if words[:1] and words[0].upper() == "LIST":
        return [beside(path, name) for name in rest]
    if words and "%" in words[0]:
        return numbered_files(words[0], words[1:], path)
    return [beside(path, where)]
