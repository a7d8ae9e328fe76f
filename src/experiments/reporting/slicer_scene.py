"""Scene files of 3D Slicer (MRML): what lies in a folder, with names, colours and axes; and bundles of them (MRB).

A node class, its tag and its attributes are those of Slicer's own sources (Libs/MRML/Core, vtkMRMLModelStorageNode.cxx
and its neighbours). Every node that holds data refers to a storage node, which names a file, and most of them to a
display node. A model's storage node without ``coordinateSystem`` is taken for RAS, the default of old scenes.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote
from xml.etree import ElementTree

from experiments import files
from experiments.errors import InputError
from registration.io.atomic import atomic_write

# Slicer's three slice views are the models 1 to 3 of every scene; with other numbers nothing has to be renamed.
_FIRST = 11
_POINTS, _SURFACE = "0", "2"
_SIZE_PX = "3"


@dataclass(frozen=True)
class Model:
    """Mesh, cloud or line in a file of its own.

    Parameters
    ----------
    name : str
        Name in Slicer.
    file : str
        File relative to the scene, in LPS: PLY, STL, OBJ, VTK or VTP. Points need a cell each (``write_model``).
    color : str
        Colour as ``#rrggbb``.
    opacity : float, optional
        Opacity from 0 to 1.
    shown : bool, optional
        Whether it is shown at first.
    points : bool, optional
        Whether it is drawn as points.
    under : str or None, optional
        Name of the linear transform that moves it; None for none.
    """

    name: str
    file: str
    color: str
    opacity: float = 1.0
    shown: bool = True
    points: bool = False
    under: str | None = None


@dataclass(frozen=True)
class PointList:
    """Landmarks in a file ``.mrk.json``.

    Parameters
    ----------
    name : str
        Name in Slicer.
    file : str
        File relative to the scene; it names its own axes.
    color : str
        Colour as ``#rrggbb``.
    shown : bool, optional
        Whether they are shown at first.
    """

    name: str
    file: str
    color: str
    shown: bool = True


@dataclass(frozen=True)
class Transform:
    """Transform in a file of ITK's.

    Parameters
    ----------
    name : str
        Name in Slicer.
    file : str
        File relative to the scene, in LPS.
    is_displacement : bool, optional
        Whether it is a displacement, which maps points to where they go; else it is linear and maps fixed points to
        moving ones. Either way Slicer moves what is put under it forwards: moving to fixed, and by the displacement.
    """

    name: str
    file: str
    is_displacement: bool = False


Node = Model | PointList | Transform


def write_slicer_scene(path: Path, nodes: Sequence[Node]) -> None:
    """Write a scene file that 3D Slicer opens.

    Parameters
    ----------
    path : Path
        File ending in ``.mrml``.
    nodes : sequence of Node
        What the scene holds; a transform that another node lies under among them.

    Raises
    ------
    InputError
        If the suffix is another, there is no node, a name is there twice, a file is missing or lies outside of the
        scene's folder, or a transform is not among the nodes.
    """
    if path.suffix != ".mrml":
        raise InputError(f"{path}: expected a scene ending in .mrml, received {path.suffix or 'none'}")
    _check(path.parent, nodes)
    root = ElementTree.Element("MRML")
    numbered = list(enumerate(nodes, start=_FIRST))
    transforms = {node.name: number for number, node in numbered if _is_linear(node)}
    for number, node in numbered:
        root.extend(_elements(node, number, transforms))
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    files.write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')


def scene_files(path: Path) -> tuple[str, ...]:
    """List the files that a scene names.

    Parameters
    ----------
    path : Path
        Scene file.

    Returns
    -------
    tuple of str
        Paths relative to the scene, in its order, each once.
    """
    named = (element.get("fileName") for element in ElementTree.parse(path).getroot())
    return tuple(dict.fromkeys(unquote(name) for name in named if name is not None))


def write_slicer_bundle(path: Path, scene: Path) -> None:
    """Write a scene with all its files into one file, a zip archive of one folder.

    Parameters
    ----------
    path : Path
        File ending in ``.mrb``.
    scene : Path
        Scene file with its files beside it.

    Raises
    ------
    InputError
        If the suffix is another.
    """
    if path.suffix != ".mrb":
        raise InputError(f"{path}: expected a bundle ending in .mrb, received {path.suffix or 'none'}")
    with (
        atomic_write(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as archive,
    ):
        for name in (scene.name, *scene_files(scene)):
            archive.write(scene.parent / name, f"{path.stem}/{name}")


def _check(folder: Path, nodes: Sequence[Node]) -> None:
    if not nodes:
        raise InputError("nodes: expected at least one, received none")
    names = [node.name for node in nodes]
    if len(set(names)) < len(names):
        raise InputError(f"nodes: expected names that differ, received {', '.join(names)}")
    for node in nodes:
        if not (folder / node.file).resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{node.name}: expected a file in {folder}, received {node.file}")
        if not (folder / node.file).is_file():
            raise InputError(f"{node.name}: expected the file {node.file} in {folder}, found none")
    transforms = [node.name for node in nodes if _is_linear(node)]
    for node in nodes:
        if isinstance(node, Model) and node.under is not None and node.under not in transforms:
            raise InputError(
                f"{node.name}: expected one of the transforms {', '.join(transforms) or 'none'}, received {node.under}"
            )


def _is_linear(node: Node) -> bool:
    return isinstance(node, Transform) and not node.is_displacement


def _elements(node: Node, number: int, transforms: dict[str, int]) -> Iterator[ElementTree.Element]:
    """Storage and display nodes first, as Slicer writes them, then the node that refers to them."""
    stored = {"fileName": quote(node.file)}
    if isinstance(node, Transform):
        yield _element("TransformStorage", number, node.name, stored, hidden=True)
        # Slicer takes a file as the transform "from parent" and moves models by its inverse. With this attribute it is
        # the one "to parent"; of a linear transform any value of it, also false, means something else.
        sense = {"readWriteAsTransformToParent": "true"} if node.is_displacement else {}
        kind = "GridTransform" if node.is_displacement else "LinearTransform"
        yield _element(kind, number, node.name, sense, {"storage": f"vtkMRMLTransformStorageNode{number}"})
        return
    is_model = isinstance(node, Model)
    kind, own, display = ("Model",) * 3 if is_model else ("MarkupsFiducial", "MarkupsJson", "Markups")
    yield _element(f"{own}Storage", number, node.name, stored | {"coordinateSystem": "LPS"}, hidden=True)
    yield _element(f"{display}Display", number, node.name, _look(node), hidden=True)
    refers = {
        "display": f"vtkMRML{display}DisplayNode{number}",
        "storage": f"vtkMRML{own}StorageNode{number}",
    }
    if isinstance(node, Model) and node.under is not None:
        refers["transform"] = f"vtkMRMLLinearTransformNode{transforms[node.under]}"
    yield _element(kind, number, node.name, {}, refers)


def _look(node: Model | PointList) -> dict[str, str]:
    color = " ".join(f"{int(node.color[at : at + 2], 16) / 255:.4f}" for at in (1, 3, 5))
    look = {"color": color, "visibility": "true" if node.shown else "false"}
    if isinstance(node, PointList):
        # Landmarks are selected unless said otherwise, and have the colour of what is selected.
        return look | {"selectedColor": color, "pointLabelsVisibility": "true", "glyphScale": "2"}
    return look | {
        "opacity": f"{node.opacity:g}",
        "representation": _POINTS if node.points else _SURFACE,
        "pointSize": _SIZE_PX,
        "lineWidth": _SIZE_PX,
        # An open vessel is seen from inside too.
        "backfaceCulling": "false",
    }


def _element(
    tag: str,
    number: int,
    name: str,
    own: dict[str, str],
    refers: dict[str, str] | None = None,
    *,
    hidden: bool = False,
) -> ElementTree.Element:
    common = {
        "id": f"vtkMRML{tag}Node{number}",
        "name": name,
        "hideFromEditors": "true" if hidden else "false",
    }
    # Slicer before 4.4 reads one attribute a reference, later ones the list; Slicer itself writes both.
    refers = refers or {}
    each = {f"{role}NodeRef": referred for role, referred in refers.items()}
    if refers:
        each["references"] = "".join(f"{role}:{referred};" for role, referred in refers.items())
    return ElementTree.Element(tag, common | own | each)
