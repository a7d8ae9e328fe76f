"""XML files of VTK in every form that VTK writes are whole; a changed byte of what is packed is refused."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest
from tubes import straight, tube
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from registration.errors import InputError
from registration.io.patient_space import _polydata
from registration.io.surface_files.vtk_polydata import read_vtk_surface
from registration.io.surface_files.vtk_xml import _parsed, require_whole_xml

MESH = tube(straight(10.0), 4.0, around=12)


def stored(path: Path, mode: str, packing: str, wide: bool = True, in_text: bool = False) -> Path:
    data = _polydata(MESH, None)
    values = numpy_to_vtk(np.arange(len(MESH.vertices_mm), dtype=np.float32), deep=True)
    values.SetName("a")
    data.GetPointData().AddArray(values)
    writer = vtkXMLPolyDataWriter()
    getattr(writer, f"SetDataModeTo{mode}")()
    getattr(writer, f"SetCompressorTypeTo{packing}")()
    getattr(writer, f"SetHeaderTypeToUInt{64 if wide else 32}")()
    writer.SetEncodeAppendedData(in_text)
    writer.SetBlockSize(512)
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write()
    return path


@pytest.mark.parametrize("packing", ["None", "ZLib", "LZMA", "LZ4"])
@pytest.mark.parametrize(
    ("mode", "wide", "in_text"),
    [("Ascii", True, False), ("Binary", True, False), ("Binary", False, False), ("Appended", True, False),
     ("Appended", False, True)],
)  # fmt: skip
def test_every_form_is_whole(tmp_path: Path, packing: str, mode: str, wide: bool, in_text: bool) -> None:
    path = stored(tmp_path / "a.vtp", mode, packing, wide, in_text)
    require_whole_xml(path)
    assert len(read_vtk_surface(path).points) == len(MESH.vertices_mm)


@pytest.mark.parametrize("packing", ["ZLib", "LZMA", "LZ4"])
def test_changed_bytes_of_what_is_packed_are_refused(tmp_path: Path, packing: str) -> None:
    path = stored(tmp_path / "a.vtp", "Appended", packing)
    data = path.read_bytes()
    begin, end = data.index(b"_", data.index(b"<AppendedData")) + 1, data.rindex(b"</AppendedData")
    refused = 0
    places = range(begin + 40, end - 40, 97)
    for at in places:
        path.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
        try:
            require_whole_xml(path)
        except InputError as refusal:
            assert "a.vtp: expected" in str(refusal)
            refused += 1
    # LZ4 has no sum: only what no longer unpacks to the right size is noticed.
    assert refused >= (len(places) - 1 if packing != "LZ4" else 1)


@pytest.mark.parametrize(
    ("old", "new"),
    [("NumberOfPoints=\"", "NumberOfPoints=\"9"), ("NumberOfPolys=\"", "NumberOfPolys=\"1"),
     ("NumberOfComponents=\"3", "NumberOfComponents=\"6"), ("offset=\"0", "offset=\"99999999"),
     ("type=\"PolyData", "type=\"ImageData"), ("Float32", "Float64")],
)  # fmt: skip
def test_headers_that_promise_something_else_are_refused(tmp_path: Path, old: str, new: str) -> None:
    path = stored(tmp_path / "a.vtp", "Appended", "ZLib")
    data = path.read_bytes()
    assert old.encode() in data
    path.write_bytes(data.replace(old.encode(), new.encode(), 1))
    with pytest.raises(InputError, match=r"a\.vtp: expected"):
        require_whole_xml(path)


@pytest.mark.parametrize("packing", ["ZLib", "LZMA", "LZ4"])
def test_blocks_of_no_size_are_refused(tmp_path: Path, packing: str) -> None:
    """VTK divides by it."""
    path = stored(tmp_path / "a.vtp", "Appended", packing)
    data = path.read_bytes()
    begin = data.index(b"_", data.index(b"<AppendedData")) + 1
    assert int.from_bytes(data[begin + 8 : begin + 16], "little") == 512
    path.write_bytes(data[: begin + 8] + bytes(8) + data[begin + 16 :])
    with pytest.raises(InputError, match=r"received \d+ blocks of 0 bytes"):
        require_whole_xml(path)


def test_blocks_of_an_unknown_packing_are_refused(tmp_path: Path) -> None:
    path = stored(tmp_path / "a.vtp", "Appended", "ZLib")
    path.write_bytes(path.read_bytes().replace(b"vtkZLibDataCompressor", b"vtkBestDataCompressor"))
    with pytest.raises(InputError, match="received blocks packed by vtkBestDataCompressor"):
        require_whole_xml(path)


@pytest.mark.parametrize("ends", ["3 9", "6 3", "-1 6", "3 7"])
def test_cells_that_end_where_no_corners_are_are_refused(tmp_path: Path, ends: str) -> None:
    array = '<DataArray type="{}" Name="{}" NumberOfComponents="{}" format="ascii">{}</DataArray>'
    (tmp_path / "a.vtp").write_text(
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"><PolyData>'
        '<Piece NumberOfPoints="4" NumberOfPolys="2"><Points>'
        f"{array.format('Float64', 'Points', 3, '0 0 1 4 0 1 4 3 1 0 3 1')}</Points>"
        f"<Polys>{array.format('Int64', 'connectivity', 1, '0 1 2 2 3 0')}"
        f"{array.format('Int64', 'offsets', 1, ends)}</Polys></Piece></PolyData></VTKFile>"
    )
    with pytest.raises(InputError, match=r"'offsets', received cells that end outside 6 corners"):
        read_vtk_surface(tmp_path / "a.vtp")


@pytest.mark.parametrize("packing", ["None", "ZLib", "LZMA", "LZ4"])
@pytest.mark.parametrize("mode", ["Binary", "Appended"])
def test_corners_left_out_of_a_packed_file_are_refused(tmp_path: Path, packing: str, mode: str) -> None:
    """An array of corners that is empty, of polygons that end at so many of them."""
    path = stored(tmp_path / "a.vtp", mode, packing, wide=False, in_text=True)
    data = path.read_bytes()
    root, layout = _parsed(path)
    (corners,) = root.iterfind("PolyData/Piece/Polys/DataArray[@Name='connectivity']")
    if mode == "Appended":
        begin = data.index(b"_", data.index(b"<AppendedData")) + 1 + int(corners.get("offset", ""))
    else:
        begin = data.index((corners.text or "").strip().encode())
    ends = next(root.iterfind("PolyData/Piece/Polys/DataArray[@Name='offsets']"))
    assert layout.size(corners) == 3 * layout.size(ends) > 0
    path.write_bytes(data[:begin] + b"AAAAA" + data[begin + 5 :])
    with pytest.raises(InputError, match=r"a\.vtp: "):
        read_vtk_surface(path)


def test_strips_of_no_corner_are_refused(tmp_path: Path) -> None:
    array = '<DataArray type="{}" Name="{}" NumberOfComponents="{}" format="ascii">{}</DataArray>'
    (tmp_path / "a.vtp").write_text(
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"><PolyData>'
        '<Piece NumberOfPoints="3" NumberOfStrips="1"><Points>'
        f"{array.format('Float64', 'Points', 3, '0 0 1 4 0 1 4 3 1')}</Points>"
        f"<Strips>{array.format('Int64', 'connectivity', 1, '')}"
        f"{array.format('Int64', 'offsets', 1, '0')}</Strips></Piece></PolyData></VTKFile>"
    )
    with pytest.raises(InputError, match="'offsets', received strips of no corner"):
        read_vtk_surface(tmp_path / "a.vtp")


@pytest.mark.parametrize("packing", ["None", "ZLib"])
def test_lines_may_end_within_text_in_base_64(tmp_path: Path, packing: str) -> None:
    path = stored(tmp_path / "a.vtp", "Binary", packing, wide=False)
    wrapped = re.sub(
        r">\s*([A-Za-z0-9+/=]{40,})\s*<",
        lambda found: ">\n" + "\n".join(textwrap.wrap(found.group(1), 16)) + "\n<",
        path.read_text(),
    )
    assert wrapped.count("\n") > path.read_text().count("\n") + 100
    path.write_text(wrapped)
    require_whole_xml(path)
