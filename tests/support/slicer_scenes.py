"""A scene of 3D Slicer read back as Slicer's sources say it is read, by VTK, SimpleITK and the json of its markups.

Slicer itself is not here. What stands below was taken from Libs/MRML/Core and Modules/Loadable/Markups/MRML of its
repository: the tags, the attributes, how references are resolved, and whose axes count.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import SimpleITK
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

NODE = {"id", "name", "hideFromEditors", "references"}
STORED = NODE | {"fileName"}
DISPLAY = NODE | {
    "color",
    "selectedColor",
    "opacity",
    "visibility",
    "representation",
    "pointSize",
    "lineWidth",
}
# Tag (GetNodeTagName) and the attributes that ReadXMLAttributes of its class and of those above it know.
KNOWN = {
    "Model": NODE | {"displayNodeRef", "storageNodeRef", "transformNodeRef"},
    "ModelStorage": STORED | {"coordinateSystem"},
    "ModelDisplay": DISPLAY | {"backfaceCulling"},
    "MarkupsFiducial": NODE | {"displayNodeRef", "storageNodeRef"},
    "MarkupsJsonStorage": STORED | {"coordinateSystem"},
    "MarkupsDisplay": DISPLAY | {"pointLabelsVisibility", "glyphScale"},
    "LinearTransform": NODE | {"storageNodeRef"},
    "GridTransform": NODE | {"storageNodeRef", "readWriteAsTransformToParent"},
    "TransformStorage": STORED,
}
READERS = {".ply": vtkPLYReader, ".stl": vtkSTLReader, ".vtp": vtkXMLPolyDataReader}


@dataclass(frozen=True)
class Shown:
    """A node that is seen: its points in LPS, where they lie after its transform, and its numbers of cells."""

    tag: str
    points_mm: np.ndarray
    placed_mm: np.ndarray
    polygons: int
    lines: int
    vertices: int
    display: dict[str, str]


def read_scene(path: Path) -> tuple[dict[str, Shown], dict[str, SimpleITK.Transform]]:
    """Everything that a scene shows, and its transforms as they move what is put under them, by name."""
    elements = {each.get("id"): each for each in ElementTree.parse(path).getroot()}
    assert len(elements) == len(ElementTree.parse(path).getroot())
    for each in elements.values():
        assert set(each.keys()) <= KNOWN[each.tag], each.tag
    shown, transforms = {}, {}
    for each in elements.values():
        if each.tag.endswith("Transform"):
            transforms[each.get("id")] = _moving_transform(path.parent, each, elements)
    for each in elements.values():
        if each.tag in ("Model", "MarkupsFiducial"):
            shown[each.get("name")] = _shown(path.parent, each, elements, transforms)
    return shown, {elements[name].get("name"): found for name, found in transforms.items()}


def references(element: ElementTree.Element) -> dict[str, str]:
    """Role and id of each node that a node refers to; both ways of writing them agree."""
    parts = [part.split(":") for part in (element.get("references") or "").split(";") if part]
    found = dict(parts)
    for role, referred in found.items():
        assert element.get(f"{role}NodeRef") == referred
    return found


def _file(folder: Path, element: ElementTree.Element, elements: dict[Any, ElementTree.Element]) -> Path:
    storage = elements[references(element)["storage"]]
    assert storage.tag.endswith("Storage")
    file = folder / unquote(storage.get("fileName") or "")
    assert file.is_file() and not Path(storage.get("fileName") or "").is_absolute()
    return file


def _moving_transform(folder: Path, element: ElementTree.Element, elements: Any) -> SimpleITK.Transform:
    found = SimpleITK.ReadTransform(str(_file(folder, element, elements)))
    if element.tag == "LinearTransform":
        # A file is the transform from the parent, so that models move by its inverse.
        assert element.get("readWriteAsTransformToParent") is None
        return found.GetInverse()
    assert element.get("readWriteAsTransformToParent") == "true"
    return found


def _shown(folder: Path, element: ElementTree.Element, elements: Any, transforms: Any) -> Shown:
    refers = references(element)
    file, storage = _file(folder, element, elements), elements[refers["storage"]]
    counts = (0, 0, 0)
    if element.tag == "Model":
        points_mm, counts, space = _model(file)
        space = space or storage.get("coordinateSystem") or "RAS"
    else:
        (markup,) = json.loads(file.read_text())["markups"]
        assert markup["type"] == "Fiducial"
        points_mm = np.array([point["position"] for point in markup["controlPoints"]])
        space = markup["coordinateSystem"]
    if space == "RAS":
        points_mm = points_mm * [-1, -1, 1]
    placed_mm = points_mm
    if "transform" in refers:
        move = transforms[refers["transform"]]
        placed_mm = np.array([move.TransformPoint(point.tolist()) for point in points_mm.astype(np.float64)])
    display = elements[refers["display"]]
    return Shown(element.tag, points_mm, placed_mm, *counts, dict(display.attrib))


def _model(file: Path) -> tuple[np.ndarray, tuple[int, int, int], str | None]:
    reader: Any = READERS[file.suffix]()
    reader.SetFileName(str(file))
    reader.Update()
    data = reader.GetOutput()
    counts = (data.GetNumberOfPolys(), data.GetNumberOfLines(), data.GetNumberOfVerts())
    space = None
    if file.suffix == ".vtp" and data.GetFieldData().GetAbstractArray("SPACE") is not None:
        space = data.GetFieldData().GetAbstractArray("SPACE").GetValue(0)
    return vtk_to_numpy(data.GetPoints().GetData()), counts, space
