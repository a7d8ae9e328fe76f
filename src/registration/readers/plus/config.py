"""PLUS device sets and results in XML: coordinate definitions, N-wire phantoms, calibrations.

Elements as in PLUS's own files (Lasso et al., IEEE Trans. Biomed. Eng. 61(10), 2014, and the toolkit's test data).
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, guarded, read_regular
from registration.readers.chain.graph import TransformGraph


@dataclass(frozen=True)
class DeviceSet:
    """What a device-set file states of geometry.

    Parameters
    ----------
    transforms : TransformGraph
        Its coordinate definitions.
    wires_mm : ndarray, shape (w, 2, 3)
        Front and back end of each wire of the N-wire phantom, in mm in the phantom's coordinate frame, three
        wires a pattern in order; empty where no phantom is defined.
    wire_names : tuple of str
        Names of the wires.
    volume : dict of str to str
        Attributes of the volume reconstruction as text.
    """

    transforms: TransformGraph
    wires_mm: Float64[np.ndarray, "w 2 3"]
    wire_names: tuple[str, ...]
    volume: dict[str, str]


@guarded("a device set of PLUS", LARGEST_TEXT_BYTES)
def read_device_set(path: Path) -> DeviceSet:
    """Read a device set, or the transform in the ``.results.xml`` of a calibration.

    Parameters
    ----------
    path : Path
        XML file; transforms and phantom may both be absent.

    Returns
    -------
    DeviceSet
        What it states of geometry.

    Raises
    ------
    InputError
        If the file is no XML, a matrix or a wire is malformed, or a pattern has no three wires.
    """
    root = parse_xml(path)
    edges = {
        (str(node.get("From")), str(node.get("To"))): numbers(node, "Matrix", 16, path).reshape(4, 4)
        for definitions in root.iter()
        if definitions.tag in ("CoordinateDefinitions", "CalibrationResults")
        for node in definitions.findall("Transform")
    }
    # Older files call a pattern NWire, newer ones Pattern of type NWire.
    patterns = [*root.iter("NWire"), *(node for node in root.iter("Pattern") if node.get("Type") == "NWire")]
    wires = [wire for pattern in patterns for wire in pattern.findall("Wire")]
    if any(len(pattern.findall("Wire")) != 3 for pattern in patterns):
        raise InputError(f"{path}: expected three wires in each NWire pattern, found another number")
    ends = [[numbers(wire, f"EndPoint{end}", 3, path) for end in ("Front", "Back")] for wire in wires]
    volume = next(iter(root.iter("VolumeReconstruction")), None)
    return DeviceSet(
        transforms=TransformGraph(edges),
        wires_mm=np.array(ends, dtype=np.float64).reshape(-1, 2, 3),
        wire_names=tuple(str(wire.get("Name")) for wire in wires),
        volume={} if volume is None else dict(volume.attrib),
    )


def device_set_xml(transforms: TransformGraph) -> str:
    """Format a device-set file that defines transforms and nothing else, as PLUS reads it.

    Parameters
    ----------
    transforms : TransformGraph
        Transforms to define.

    Returns
    -------
    str
        XML.
    """
    root = ElementTree.Element("PlusConfiguration", version="2.1")
    definitions = ElementTree.SubElement(root, "CoordinateDefinitions")
    for (source, target), matrix in transforms.edges.items():
        text = " ".join(repr(float(number)) for number in np.asarray(matrix).reshape(-1))
        ElementTree.SubElement(definitions, "Transform", {"From": source, "To": target, "Matrix": text})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def parse_xml(path: Path) -> ElementTree.Element:
    """Read the root of an XML file. Entities are not expanded.

    Parameters
    ----------
    path : Path
        XML file.

    Returns
    -------
    ElementTree.Element
        Root.

    Raises
    ------
    InputError
        If the file cannot be read, is no XML, or has a document type definition.
    """
    try:
        content = read_regular(path, LARGEST_TEXT_BYTES)
        # In UTF-16 every second byte is zero.
        if b"<!DOCTYPE" in content.replace(b"\0", b""):
            raise InputError(f"{path}: expected an XML file without a document type, found one with it")
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as failure:
        raise InputError(
            f"{path}: expected an XML file, found one that does not parse ({failure})"
        ) from failure


def numbers(node: ElementTree.Element, attribute: str, count: int, path: Path) -> Float64[np.ndarray, " n"]:
    """Read the numbers in an attribute.

    Parameters
    ----------
    node : ElementTree.Element
        Element of an XML file.
    attribute : str
        Name of the attribute.
    count : int
        How many numbers there must be.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    ndarray, shape (count,)
        Numbers.

    Raises
    ------
    InputError
        If the attribute does not hold ``count`` numbers.
    """
    text = node.get(attribute, "")
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(
            f"{path}: expected {count} numbers in {node.tag} {attribute}, found {text.strip()!r}"
        )
    return values
