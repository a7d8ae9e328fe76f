"""Whether a geometry file is all there: readers return zeros for what is missing from a file that was cut short."""

from __future__ import annotations

from pathlib import Path

from registration.errors import InputError

_BYTES = {
    "char": 1, "int8": 1, "uchar": 1, "uint8": 1, "short": 2, "int16": 2, "ushort": 2, "uint16": 2,
    "int": 4, "int32": 4, "uint": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
_LONGEST_HEADER = 1 << 16


def require_file(path: Path) -> Path:
    """Return the path, or raise InputError unless there is a file that can be opened for reading."""
    path = Path(path)
    if not path.is_file():
        found = "a folder" if path.is_dir() else "nothing there"
        raise InputError(f"{path}: expected a file, received {found}")
    try:
        path.open("rb").close()
    except OSError as refusal:
        raise InputError(
            f"{path}: expected a file that can be read, received {refusal.strerror}"
        ) from refusal
    return path


def require_complete(path: Path) -> None:
    """Raise InputError if a PLY, PCD, STL or OBJ file has less in it than its header (or its last line) promises."""
    check = {".ply": _check_ply, ".pcd": _check_pcd, ".stl": _check_stl, ".obj": _check_obj}.get(
        path.suffix.lower()
    )
    if check is None:
        return
    try:
        check(path)
    except InputError:
        raise
    except (KeyError, IndexError, ValueError) as refusal:
        raise InputError(
            f"{path}: expected a header that can be read, received {refusal!r} in it"
        ) from refusal


def _check_ply(path: Path) -> None:
    head, body = _split_header(path, b"end_header")
    form, words_expected, size, count = "", 0, 0, 0
    for line in head:
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1] if len(words) > 1 else ""
        elif words[:1] == ["element"]:
            count = int(words[2])
        elif words[:2] == ["property", "list"]:
            # A face has three corners at least: exact for triangles, a lower bound for polygons.
            corners = 3 if words[-1].startswith("vertex_ind") else 0
            size += count * (_BYTES[words[2]] + corners * _BYTES[words[3]])
            words_expected += count * (1 + corners)
        elif words[:1] == ["property"]:
            size += count * _BYTES[words[1]]
            words_expected += count
    if form == "ascii":
        _require_words(path, body, words_expected)
    elif len(body) < size:
        raise InputError(f"{path}: expected {size} bytes after the header, received {len(body)}: cut short")


def _check_pcd(path: Path) -> None:
    head, body = _split_header(path, b"\nDATA")
    entries = {line.split()[0].upper(): line.split()[1:] for line in head if line.strip()}
    if body.lstrip().lower().startswith(b"ascii"):
        points = int(entries.get("POINTS", ["0"])[0])
        _require_words(path, body.partition(b"\n")[2], points * len(entries.get("FIELDS", [])))


def _check_stl(path: Path) -> None:
    data = path.read_bytes()
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            return
    if data[:5] == b"solid" and b"facet" in data[:_LONGEST_HEADER]:
        if b"endsolid" in data[-_LONGEST_HEADER:]:
            return
        raise InputError(f"{path}: expected endsolid at the end, received an STL file that was cut short")
    raise InputError(
        f"{path}: expected an STL file of 84 + 50 bytes a triangle, received {len(data)} bytes "
        "(cut short, or of another kind)"
    )


def _check_obj(path: Path) -> None:
    last = path.read_bytes().rstrip().rpartition(b"\n")[2].split()
    if last[:1] in ([b"v"], [b"vn"], [b"f"]) and len(last) < 4:
        raise InputError(
            f"{path}: expected three entries in its last line, received {len(last) - 1}: cut short"
        )


def _split_header(path: Path, end: bytes) -> tuple[list[str], bytes]:
    data = path.read_bytes()
    place = data.find(end, 0, _LONGEST_HEADER)
    if place < 0:
        raise InputError(f"{path}: expected a header that ends in {end.decode().strip()}, received none")
    body = data[place + len(end) :]
    if end == b"end_header":
        body = body.removeprefix(b"\r").removeprefix(b"\n")
    return data[:place].decode("ascii", errors="replace").splitlines(), body


def _require_words(path: Path, body: bytes, words: int) -> None:
    received = len(body.split())
    if received < words:
        raise InputError(f"{path}: expected {words} numbers after the header, received {received}: cut short")
