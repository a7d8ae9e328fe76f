"""XML files of VTK in every form that VTK writes are whole; a changed byte of what is packed is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tubes import straight, tube
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from registration.errors import InputError
from registration.io.patient_space import _polydata
from registration.io.surface_files.vtk_polydata import read_vtk_surface
from registration.io.surface_files.vtk_xml import require_whole_xml

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


@pytest.mark.parametrize("packing", ["ZLib", "LZMA"])
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
    assert refused >= len(places) - 1


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
