"""Device sets of PLUS: coordinate definitions and phantoms, of both generations of the format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sweeps import CALIBRATION

from registration.errors import InputError
from registration.readers.chain.graph import TransformGraph
from registration.readers.plus.config import device_set_xml, read_device_set

XML = """<PlusConfiguration version="2.1">
  <CoordinateDefinitions>
    <Transform From="Image" To="Probe" Matrix="0.1 0 0 1  0 0.2 0 2  0 0 0.1 3  0 0 0 1" Error="0.5"/>
  </CoordinateDefinitions>
  <PhantomDefinition><Geometry>{pattern}</Geometry></PhantomDefinition>
</PlusConfiguration>"""
WIRES = """<Wire Name="a" EndPointFront="0 0 5" EndPointBack="0 40 5"/>
<Wire Name="b" EndPointFront="5 0 5" EndPointBack="25 40 5"/>
<Wire Name="c" EndPointFront="30 0 5" EndPointBack="30 40 5"/>"""


@pytest.mark.parametrize("pattern", [f"<NWire>{WIRES}</NWire>", f'<Pattern Type="NWire">{WIRES}</Pattern>'])
def test_transforms_and_wires(tmp_path: Path, pattern: str) -> None:
    path = tmp_path / "set.xml"
    path.write_text(XML.format(pattern=pattern))
    device_set = read_device_set(path)
    np.testing.assert_allclose(device_set.transforms.chain("Image", "Probe")[:3, 3], [1, 2, 3])
    assert device_set.wire_names == ("a", "b", "c")
    assert device_set.wires_mm[1].tolist() == [[5, 0, 5], [25, 40, 5]]


def test_written_definitions_come_back_exactly(tmp_path: Path) -> None:
    path = tmp_path / "set.xml"
    path.write_text(device_set_xml(TransformGraph({("Image", "Probe"): CALIBRATION.probe_A_pixel})))
    np.testing.assert_array_equal(
        read_device_set(path).transforms.chain("Image", "Probe"), CALIBRATION.probe_A_pixel
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (XML.replace("0.1 0 0 1 ", "0.1 0 0 "), "expected 16 numbers in Transform Matrix, found"),
        (XML.replace("0.1 0 0 1 ", "0.1 0 0 nan "), "expected 16 numbers in Transform Matrix, found"),
        (
            XML.format(pattern="<NWire>" + WIRES.splitlines()[0] + "</NWire>"),
            "expected three wires in each NWire",
        ),
        (XML[:60], "expected an XML file, found one that does not parse"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + XML, "expected an XML file without a document type"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "set.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"set\.xml: {message}"):
        read_device_set(path)


def test_device_set_of_plus(real_data: Path) -> None:
    device_set = read_device_set(
        real_data / "plus" / "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"
    )
    assert device_set.wires_mm.shape == (6, 2, 3)
    assert device_set.volume["ClipRectangleOrigin"] == "167 62"
    newer = read_device_set(real_data / "plus" / "PlusDeviceSet_fCal_Sim_SpatialCalibration_2.0.xml")
    assert newer.wire_names[1] == "8:L1_h1"
    # Image to TransducerOrigin goes through TransducerOriginPixel: a shift by -410 px, then 0.0796446 mm a pixel.
    assert newer.transforms.chain("Image", "TransducerOrigin")[0, 3] == pytest.approx(-410 * 0.0796446)


def test_stylus_of_plus(real_data: Path) -> None:
    transforms = read_device_set(real_data / "plus" / "StylusCalibration.results.xml").transforms
    np.testing.assert_allclose(
        transforms.chain("StylusTip", "Stylus")[:3, 3], [210.019, -0.170252, 0.0463022]
    )
