"""Whether a surface in VTK's XML format is whole and undamaged, before VTK takes memory for what its header promises.

VTK aborts the process where the memory is not there, and follows any count of blocks. The format is a tree of arrays,
each as text, in base 64 or in a block at the end of the file, packed or not (VTK File Formats, "XML File Formats").
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
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
_ADDED_IN_BASE_64 = 4 / 3


@dataclass(frozen=True)
class _Layout:
    path: Path
    # What follows the underscore of the appended data, and whether it is in base 64.
    appended: bytes
    in_text: bool
    order: str
    header: str
    packing: str

    def refusal(self, node: ElementTree.Element, found: str) -> InputError:
        return InputError(
            f"{self.path}: expected a whole array {node.get('Name', node.tag)!r}, received {found} "
            "(cut short or damaged)"
        )

    def size(self, node: ElementTree.Element) -> int:
        """Bytes of an array when unpacked, for text as if it were binary; packed blocks are unpacked and checked."""
        form = node.get("format", "ascii")
        if form == "ascii":
            return len((node.text or "").split()) * _BYTES.get(node.get("type", ""), 1)
        if form == "appended":
            begin = int(node.get("offset", ""))
            if not 0 <= begin < len(self.appended):
                raise self.refusal(node, f"an offset of {begin} in {len(self.appended)} bytes")
            return self._binary(node, self.appended[begin:], self.in_text)
        return self._binary(node, (node.text or "").strip().encode("ascii"), True)

    def _binary(self, node: ElementTree.Element, data: bytes, in_text: bool) -> int:
        width = np.dtype(self.header).itemsize
        counts = self._head(data, 0, 3 if self.packing else 1, in_text, node)
        if not self.packing:
            size = int(counts[0])
            there = len(data) - width if not in_text else int(len(data) / _ADDED_IN_BASE_64) - width
            if size > there:
                raise self.refusal(node, f"{max(there, 0)} of {size} bytes")
            return size
        blocks, full, last = (int(count) for count in counts)
        if blocks * width > len(data):
            raise self.refusal(node, f"{blocks} blocks in {len(data)} bytes")
        packed = self._head(data, 3, blocks, in_text, node)
        total = blocks * full if not last else (blocks - 1) * full + last
        total = total if blocks else 0
        require_unpacked_size(total, len(data), self.path)
        begin = (3 + blocks) * width
        if in_text:
            # Counts and blocks are each encoded on their own.
            body = base64.b64decode(data[4 * -(-begin // 3) :][: 4 * -(-int(packed.sum()) // 3)])
        else:
            body = data[begin : begin + int(packed.sum())]
        if len(body) < int(packed.sum()):
            raise self.refusal(node, f"{len(body)} of {int(packed.sum())} packed bytes")
        ends = np.cumsum(packed.astype(np.int64))
        for number, end in enumerate(ends.tolist()):
            size = last if last and number == blocks - 1 else full
            self._require_block(node, body[end - int(packed[number]) : end], size)
        return total

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

    def _require_block(self, node: ElementTree.Element, block: bytes, size: int) -> None:
        try:
            if "ZLib" in self.packing:
                stream = zlib.decompressobj()
                found = len(stream.decompress(block, size + 1))
                found = found if stream.eof else -1
            elif "LZMA" in self.packing:
                found = len(lzma.LZMADecompressor().decompress(block, size + 1))
            else:  # VTK itself compares the sizes of blocks packed by LZ4, which have no sum
                return
        except (zlib.error, lzma.LZMAError) as failure:
            raise self.refusal(node, f"a damaged block ({failure})") from failure
        if found != size:
            raise self.refusal(node, f"a block that is not {size} bytes when unpacked")


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
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
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
