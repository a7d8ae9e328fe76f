"""PLUS sequences in NRRD files (``.igs.nrrd``): a text header, an empty line, then raw or gzipped pixels.

Format: http://teem.sourceforge.net/nrrd/format.html. Frames are the axis of kind ``list`` (or ``time``).
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.readers.sequence import PlusSequence, numbered_fields, split_fields, to_mf

_TYPES = {
    "uchar": "u1", "unsigned char": "u1", "uint8": "u1", "uint8_t": "u1",
    "char": "i1", "signed char": "i1", "int8": "i1", "int8_t": "i1",
    "short": "i2", "int16": "i2", "int16_t": "i2", "ushort": "u2", "unsigned short": "u2", "uint16": "u2",
    "uint16_t": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "double": "f8",
}  # fmt: skip
_WRITTEN = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "u4": "uint32", "i4": "int32"}
_WRITTEN |= {"f4": "float", "f8": "double"}
_STRUCTURAL = {
    "dimension", "encoding", "endian", "kinds", "sizes", "space dimension", "space directions", "space origin", "type",
    "space", "ultrasound image orientation", "data file", "datafile",
}  # fmt: skip


def read_nrrd(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a sequence; ``orientation`` stands in for (and overrules) the one that the file names.

    Raises InputError, naming the file, for a file that is no NRRD, an encoding or type that is not known, more than
    one spatial axis too many, or fewer pixels than the header promises.
    """
    fields, data = _read_parts(path)
    header, by_frame = split_fields(fields, path)
    count, height, width, channels = _shape(header, path)
    # In NRRD files PLUS names the status of a frame's image Status, in MetaImage files ImageStatus.
    frame_fields = tuple(
        {"ImageStatus" if key == "Status" else key: value for key, value in by_frame.get(number, {}).items()}
        for number in range(count)
    )
    kept_header = {key: value for key, value in header.items() if key not in _STRUCTURAL}
    stored = orientation or header.get("ultrasound image orientation")
    # An NRRD axis cannot have size 0: PLUS gives tracker-only recordings one pixel a frame and no orientation.
    if 0 in (width, height) or (stored is None and (width, height) == (1, 1)):
        return PlusSequence(np.zeros((count, 0, 0), np.uint8), frame_fields, kept_header)
    if stored is None:
        raise InputError(
            f"{path}: expected the key 'ultrasound image orientation', found none (set orientation)"
        )
    shape = (count, height, width) if channels == 1 else (count, height, width, channels)
    return PlusSequence(to_mf(_decode(header, data, shape, path), stored, path), frame_fields, kept_header)


def nrrd_bytes(sequence: PlusSequence, compressed: bool) -> bytes:
    """The content of a file that PLUS and SimpleITK read; orientation MF."""
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


def _read_parts(path: Path) -> tuple[dict[str, str], bytes]:
    """The header's fields and keys, and the bytes after the empty line (or in the file that it names)."""
    try:
        content = path.read_bytes()
        if not content.startswith(b"NRRD"):
            raise InputError(f"{path}: expected an NRRD file, found one that does not begin with NRRD")
        # Pixels may hold anything, line ends too: only the first empty line counts.
        ends = [(content.find(mark), mark) for mark in (b"\n\n", b"\r\n\r\n") if mark in content]
        end, mark = min(ends, default=(len(content), b""))
        head, data = content[:end], content[end + len(mark) :]
        fields: dict[str, str] = {}
        for line in head.decode("latin-1").splitlines()[1:]:
            if line.startswith("#") or ":" not in line:
                continue
            key, _, value = line.partition(":")
            fields[key.strip()] = value.removeprefix("=").strip()
        detached = fields.get("data file", fields.get("datafile"))
        return fields, (path.parent / detached).read_bytes() if detached else data
    except OSError as failure:
        raise InputError(
            f"{path}: expected a readable file, found {failure.strerror or failure}"
        ) from failure


def _shape(header: dict[str, str], path: Path) -> tuple[int, int, int, int]:
    """Frames, height, width and channels, from the sizes and kinds of the axes."""
    try:
        sizes = [int(size) for size in header["sizes"].split()]
    except (KeyError, ValueError) as failure:
        raise InputError(
            f"{path}: expected whole numbers for sizes, found {header.get('sizes')}"
        ) from failure
    kinds = header.get("kinds", "").split() or ["domain"] * len(sizes)
    domains = [size for size, kind in zip(sizes, kinds, strict=False) if kind in ("domain", "space")]
    counts = [size for size, kind in zip(sizes, kinds, strict=False) if kind in ("list", "time")]
    channels = [
        size
        for size, kind in zip(sizes, kinds, strict=False)
        if kind in ("vector", "RGB-color", "RGBA-color", "3-color")
    ]
    if len(domains) == 3 and domains[2] == 1:
        domains = domains[:2]
    known = len(domains) + len(counts) + len(channels) >= len([kind for kind in kinds if kind]) - 1
    if len(domains) != 2 or len(counts) > 1 or len(channels) > 1 or not known:
        raise InputError(
            f"{path}: expected two domain axes and at most one list axis (frames), found sizes {sizes}, kinds {kinds}"
        )
    return (counts or [1])[0], domains[1], domains[0], (channels or [1])[0]


def _decode(header: dict[str, str], data: bytes, shape: tuple[int, ...], path: Path) -> np.ndarray:
    kind = _TYPES.get(header.get("type", ""))
    encoding = header.get("encoding", "raw").lower()
    if kind is None or encoding not in ("raw", "gz", "gzip"):
        raise InputError(
            f"{path}: expected a number type and encoding raw or gzip, "
            f"found type {header.get('type')}, encoding {encoding}"
        )
    if encoding != "raw":
        try:
            data = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32).decompress(data)
        except zlib.error as failure:
            raise InputError(f"{path}: expected gzipped pixels, found broken data ({failure})") from failure
    expected = int(np.prod(shape)) * np.dtype(kind).itemsize
    if len(data) < expected:
        raise InputError(
            f"{path}: expected {expected} bytes of pixels, found {len(data)} (a truncated file?)"
        )
    order = ">" if header.get("endian", "little").lower() == "big" else "<"
    numbers = np.frombuffer(data, np.dtype(order + kind), count=int(np.prod(shape)))
    return numbers.reshape(shape).astype(kind, copy=False)
