"""Volumes from files, whole or not at all: what the reading library leaves unsaid is checked here."""

from __future__ import annotations

import gzip
import math
import shutil
import struct
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from registration.errors import InputError
from registration.file_checks import require_file

# The suffixes that are read, and SimpleITK's name of what reads them: the choice is not left to a file's content.
READERS = {
    ".nii": "NiftiImageIO",
    ".nii.gz": "NiftiImageIO",
    ".nrrd": "NrrdImageIO",
    ".nhdr": "NrrdImageIO",
    ".mha": "MetaImageIO",
    ".mhd": "MetaImageIO",
}
_META_BYTES = {
    "MET_CHAR": 1, "MET_UCHAR": 1, "MET_SHORT": 2, "MET_USHORT": 2, "MET_INT": 4, "MET_UINT": 4, "MET_LONG": 4,
    "MET_ULONG": 4, "MET_LONG_LONG": 8, "MET_ULONG_LONG": 8, "MET_FLOAT": 4, "MET_DOUBLE": 8,
}  # fmt: skip
_LONGEST_HEADER_LINE = 1 << 16


def volume_suffix(path: Path) -> str:
    """The suffix of a volume's file in small letters (``.nii.gz`` is one), empty if it is none that is read."""
    name = Path(path).name.lower()
    return next((suffix for suffix in sorted(READERS, key=len, reverse=True) if name.endswith(suffix)), "")


def read_volume(path: Path) -> Any:
    """Read a file as SimpleITK's image. Raises InputError for one that is missing, unreadable, or cut short."""
    import SimpleITK

    path = require_file(Path(path))
    suffix = volume_suffix(path)
    if not suffix:
        raise InputError(
            f"{path}: expected one of {', '.join(READERS)}, received {path.suffix or 'no suffix'}"
        )
    with _complete(path, suffix) as complete:
        reader = SimpleITK.ImageFileReader()
        reader.SetImageIO(READERS[suffix])
        reader.SetFileName(str(complete))
        SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
        try:
            return reader.Execute()
        except RuntimeError as refusal:
            raise InputError(f"{path}: {_why(str(refusal), suffix)}") from refusal


def _why(message: str, suffix: str) -> str:
    if "orthonormal" in message:
        return "expected axes at right angles, received a header with sheared ones"
    kind = READERS[suffix].removesuffix("ImageIO")
    return (
        f"expected a complete {kind} volume, received one that cannot be read (cut short, or of another kind)"
    )


@contextmanager
def _complete(path: Path, suffix: str) -> Iterator[Path]:
    """Give a file that is known to be complete; NRRD files are checked as they are read."""
    if suffix == ".nii.gz":
        # Unpacked under a name of its own: the reader would prefer a file x.nii that stands beside x.nii.gz.
        with tempfile.TemporaryDirectory() as folder:
            unpacked = Path(folder) / "volume.nii"
            _unpack(path, unpacked)
            _check_nifti(unpacked, path)
            yield unpacked
        return
    if suffix == ".nii":
        _check_nifti(path, path)
    elif suffix in (".mha", ".mhd"):
        _check_metaimage(path)
    yield path


def _unpack(path: Path, target: Path) -> None:
    try:
        with gzip.open(path) as packed, target.open("wb") as stream:
            shutil.copyfileobj(packed, stream, 1 << 20)
    except (EOFError, gzip.BadGzipFile, zlib.error) as refusal:
        raise InputError(
            f"{path}: expected a complete gzip file, received one that breaks off ({refusal})"
        ) from refusal


def _check_nifti(path: Path, named: Path) -> None:
    """The reader returns zeros for what is missing of a NIfTI file, without a word."""
    with path.open("rb") as stream:
        head = stream.read(540)
    order = next((order for order in "<>" if head[:4] in (_int(order, 348), _int(order, 540))), "")
    if not order or len(head) < 348:
        raise InputError(f"{named}: expected the header of a NIfTI volume, received another file")
    # Where the header says how many axes there are, their lengths, the bits of a voxel, and where voxels begin.
    places = ("8h", 40, "h", 72, "f", 108) if head[:4] == _int(order, 348) else ("8q", 16, "h", 14, "q", 168)
    sizes = struct.unpack_from(order + str(places[0]), head, int(places[1]))
    bits = struct.unpack_from(order + str(places[2]), head, int(places[3]))[0]
    begin = struct.unpack_from(order + str(places[4]), head, int(places[5]))[0]
    expected = int(begin) + math.prod(sizes[1 : 1 + max(sizes[0], 0)]) * bits // 8
    _require_bytes(named, path.stat().st_size, expected)


def _int(order: str, value: int) -> bytes:
    return struct.pack(order + "i", value)


def _check_metaimage(path: Path) -> None:
    """The reader prints lines of its own about what is missing of a MetaImage file."""
    fields: dict[str, str] = {}
    with path.open("rb") as stream:
        while "ElementDataFile" not in fields:
            name, equals, value = stream.readline(_LONGEST_HEADER_LINE).decode("latin-1").partition("=")
            if not equals:
                raise InputError(
                    f"{path}: expected a MetaImage header that ends in ElementDataFile, received another"
                )
            fields[name.strip()] = value.strip()
        begin = stream.tell()
    where = fields["ElementDataFile"]
    data = path if where.upper() == "LOCAL" else path.parent / where
    if where.upper().startswith("LIST") or "%" in where:
        return
    if not data.is_file():
        raise InputError(f"{path}: expected its voxels in {data}, received no such file")
    try:
        if fields.get("CompressedData", "").lower() == "true":
            expected = int(fields.get("CompressedDataSize", "1"))
        else:
            channels = int(fields.get("ElementNumberOfChannels", "1"))
            sizes = [int(size) for size in fields["DimSize"].split()]
            expected = math.prod(sizes) * channels * _META_BYTES[fields["ElementType"]]
    except (KeyError, ValueError) as refusal:
        raise InputError(
            f"{path}: expected a header that can be read, received {refusal!r} in it"
        ) from refusal
    _require_bytes(path, data.stat().st_size - (begin if data == path else 0), expected)


def _require_bytes(path: Path, received: int, expected: int) -> None:
    if received < expected:
        raise InputError(f"{path}: expected at least {expected} bytes of it, received {received}: cut short")
