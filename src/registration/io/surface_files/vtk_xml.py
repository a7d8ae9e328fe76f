"""Whether a surface in VTK's XML format is whole and undamaged, before VTK takes memory for what its header promises.

VTK aborts the process where the memory is not there, and follows any count of blocks. The format is a tree of arrays,
each as text, in base 64 or in a block at the end of the file, packed or not (VTK File Formats, "XML File Formats").
"""

from __future__ import annotations

import base64
import itertools
import lzma
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from registration.errors import InputError
from registration.input_files import read_regular, require_unpacked_size

_BYTES = {
    "Int8": 1, "UInt8": 1, "Int16": 2, "UInt16": 2, "Int32": 4, "UInt32": 4, "Int64": 8, "UInt64": 8,
    "Float32": 4, "Float64": 8,
}  # fmt: skip
_CELLS = {
    "Verts": "NumberOfVerts",
    "Lines": "NumberOfLines",
    "Strips": "NumberOfStrips",
    "Polys": "NumberOfPolys",
}
_APPENDED = re.compile(rb"<AppendedData[^>]*encoding\s*=\s*[\"'](raw|base64)[\"'][^>]*>")


@dataclass(frozen=True)
class _Layout:
    path: Path
    # What follows the underscore of the appended data, and whether it is in base 64.
    appended: bytes
    in_text: bool
    order: Literal["<", ">"]
    header: str
    packing: str

    def refusal(self, node: ElementTree.Element, found: str) -> InputError:
        return InputError(
            f"{self.path}: expected a whole array {node.get('Name', node.tag)!r}, received {found} "
            "(cut short or damaged)"
        )

    def size(self, node: ElementTree.Element) -> int:
        """Bytes of an array when unpacked, for text as if it were binary; packed blocks are unpacked and checked."""
        if node.get("format", "ascii") == "ascii":
            return len((node.text or "").split()) * _BYTES.get(node.get("type", ""), 1)
        return sum(map(len, self._content(node)))

    def whole_numbers(self, node: ElementTree.Element) -> np.ndarray:
        """The values of an array of whole numbers."""
        kind = node.get("type", "")
        if kind not in _BYTES:
            raise self.refusal(node, f"values of type {kind or 'none'}")
        if node.get("format", "ascii") == "ascii":
            return np.array((node.text or "").split(), dtype=np.float64)  # as VTK, which takes 3.0 for 3
        dtype = np.dtype(kind.lower())
        return np.frombuffer(b"".join(self._content(node)), dtype.newbyteorder(self.order))

    def _content(self, node: ElementTree.Element) -> Iterator[bytes]:
        """The bytes of a binary array, block by block."""
        if node.get("format") != "appended":
            yield from self._binary(node, "".join((node.text or "").split()).encode("ascii"), True)
            return
        begin = int(node.get("offset", ""))
        if not 0 <= begin < len(self.appended):
            raise self.refusal(node, f"an offset of {begin} in {len(self.appended)} bytes")
        appended = self.appended[begin:]
        yield from self._binary(node, b"".join(appended.split()) if self.in_text else appended, self.in_text)

    def _binary(self, node: ElementTree.Element, data: bytes, in_text: bool) -> Iterator[bytes]:
        width = np.dtype(self.header).itemsize
        counts = self._head(data, 0, 3 if self.packing else 1, in_text, node)
        if not self.packing:
            end, head = width + int(counts[0]), 4 * -(-width // 3)
            # The number of bytes and the bytes are one text, or a text each.
            texts = [data[:head], data[head:]] if b"=" in data[:head] else [data]
            left = [text[: 4 * -(-end // 3)] for text in texts]
            body = b"".join(base64.b64decode(text + b"==") for text in left) if in_text else data[:end]
            if len(body) < end:
                raise self.refusal(node, f"{max(len(body) - width, 0)} of {int(counts[0])} bytes")
            yield body[width:end]
            return
        blocks, full, last = (int(count) for count in counts)
        # VTK divides by the size of a whole block.
        if blocks * width > len(data) or (blocks and not full):
            raise self.refusal(node, f"{blocks} blocks of {full} bytes in {len(data)} bytes")
        packed = self._head(data, 3, blocks, in_text, node).tolist()
        sizes = [full] * (blocks - 1) + [last or full] if blocks else []
        require_unpacked_size(sum(sizes), len(data), self.path)
        begin, held = (3 + blocks) * width, sum(packed)
        # In text, counts and blocks are each encoded on their own.
        text = data[4 * -(-begin // 3) :][: 4 * -(-held // 3)]
        body = base64.b64decode(text) if in_text else data[begin : begin + held]
        if len(body) < held:
            raise self.refusal(node, f"{len(body)} of {held} packed bytes")
        ends = itertools.accumulate(packed)
        for taken, end, size in zip(packed, ends, sizes, strict=True):
            yield self._unpacked(node, body[end - taken : end], size)

    def _head(
        self, data: bytes, first: int, count: int, in_text: bool, node: ElementTree.Element
    ) -> np.ndarray:
        """Some of the whole numbers before the blocks."""
        width = np.dtype(self.header).itemsize
        end = (first + count) * width
        raw = base64.b64decode(data[: 4 * -(-end // 3)] + b"==") if in_text else data[:end]
        if len(raw) < end:
            raise self.refusal(node, f"{len(data)} bytes")
        return np.frombuffer(raw, self.order + self.header, count, first * width)

    def _unpacked(self, node: ElementTree.Element, block: bytes, size: int) -> bytes:
        try:
            if "ZLib" in self.packing:
                stream = zlib.decompressobj()
                found = stream.decompress(block, size + 1)
                found = found if stream.eof else b""
            elif "LZMA" in self.packing:
                found = lzma.LZMADecompressor().decompress(block, size + 1)
            elif "LZ4" in self.packing:
                found = _unpacked_lz4(block, size)
            else:
                raise self.refusal(node, f"blocks packed by {self.packing}")
        except (zlib.error, lzma.LZMAError) as failure:
            raise self.refusal(node, f"a damaged block ({failure})") from failure
        if len(found) != size:
            raise self.refusal(node, f"a block that is not {size} bytes when unpacked")
        return found


def _unpacked_lz4(block: bytes, size: int) -> bytes:
    """What VTK makes of a block; nothing if it is damaged. Python itself has no LZ4."""
    from vtkmodules.vtkIOCore import vtkLZ4DataCompressor

    compressor: Any = vtkLZ4DataCompressor()
    compressor.AddObserver("ErrorEvent", lambda *_: None)  # instead of VTK's own report on the terminal
    into = bytearray(size)
    return bytes(into) if compressor.Uncompress(block, len(block), into, size) == size else b""


def require_whole_xml(path: Path) -> None:
    """Raise InputError unless every array of a surface is undamaged and as long as the file says.

    Parameters
    ----------
    path : Path
        File ending in ``.vtp``.

    Raises
    ------
    InputError
        If it is no such file, cut short, damaged, or promises what it does not hold.
    """
    root, layout = _parsed(path)
    pieces = root.findall("PolyData/Piece")
    if root.tag != "VTKFile" or root.get("type") != "PolyData" or not pieces:
        raise InputError(f"{path}: expected PolyData of VTK, received {root.get('type') or root.tag}")
    for piece in pieces:
        points = int(piece.get("NumberOfPoints", "0"))
        cells = {tag: int(piece.get(name, "0")) for tag, name in _CELLS.items()}
        _require_arrays(layout, piece.find("Points"), points)
        _require_arrays(layout, piece.find("PointData"), points)
        _require_arrays(layout, piece.find("CellData"), sum(cells.values()))
        for tag, count in cells.items():
            _require_cells(layout, piece.find(tag), count)
    for array in root.iterfind("PolyData/FieldData/*"):
        layout.size(array)


def _parsed(path: Path) -> tuple[ElementTree.Element, _Layout]:
    """The tree without the appended data, which need be no XML, and what is known of the arrays."""
    data = read_regular(path)
    found = _APPENDED.search(data)
    appended = b""
    if found:
        begin = data.find(b"_", found.end()) + 1
        appended = data[begin : data.rfind(b"</AppendedData>")] if begin else b""
        data = data[: found.start()] + b"</VTKFile>"
    if b"<!DOCTYPE" in data.replace(b"\0", b""):
        raise InputError(f"{path}: expected an XML file without a document type, found one with it")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as failure:
        raise InputError(
            f"{path}: expected a complete VTP file, received one that does not parse"
        ) from failure
    order: Literal["<", ">"] = ">" if root.get("byte_order") == "BigEndian" else "<"
    header = "u8" if root.get("header_type") == "UInt64" else "u4"
    in_text = found is not None and found.group(1) == b"base64"
    return root, _Layout(path, appended, in_text, order, header, root.get("compressor", ""))


def _require_arrays(layout: _Layout, group: ElementTree.Element | None, tuples: int) -> None:
    for array in group if group is not None else ():
        kind = array.get("type", "")
        size = layout.size(array)
        if kind not in _BYTES:  # texts and bits, whose length no header says
            continue
        expected = tuples * int(array.get("NumberOfComponents", "1")) * _BYTES[kind]
        if tuples < 0 or size != expected:
            raise layout.refusal(array, f"{size} bytes of {expected}")


def _require_cells(layout: _Layout, group: ElementTree.Element | None, count: int) -> None:
    found = {array.get("Name"): array for array in (group if group is not None else ())}
    if count < 0 or (count and not {"connectivity", "offsets"} <= found.keys()):
        raise InputError(f"{layout.path}: expected {count} cells with their points, received none")
    for name, array in found.items():
        size, width = layout.size(array), _BYTES.get(array.get("type", ""), 1)
        if (name == "offsets" and size != count * width) or size % width:
            raise layout.refusal(array, f"{size} bytes for {count} cells")
    if count:
        # VTK follows them without a look at how many there are.
        ends, corners = layout.whole_numbers(found["offsets"]), found["connectivity"]
        there = layout.size(corners) // _BYTES.get(corners.get("type", ""), 1)
        if int(ends[0]) < 0 or np.any(ends[1:] < ends[:-1]) or int(ends[-1]) > there:
            raise layout.refusal(found["offsets"], f"cells that end outside {there} corners")
        if group is not None and group.tag == "Strips" and (ends[0] == 0 or np.any(ends[1:] == ends[:-1])):
            raise layout.refusal(found["offsets"], "strips of no corner")
