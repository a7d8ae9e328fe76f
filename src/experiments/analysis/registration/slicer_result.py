"""A registration as a scene of 3D Slicer: both sides, what moved, what deformed, lines, landmarks and transforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from experiments.analysis.registration.deformed_model import Deformed
from experiments.errors import InputError
from experiments.reporting.scene_layers import BLUE, GREEN, GREY, ORANGE, RED
from experiments.reporting.slicer_scene import (
    Model,
    Node,
    PointList,
    Transform,
    write_slicer_bundle,
    write_slicer_scene,
)
from registration.geometry.shapes import Centerline, Mesh, Surface, transformed
from registration.io.centerlines import write_centerline
from registration.io.landmarks import Landmarks, write_landmarks
from registration.io.patient_space import write_model
from registration.io.surfaces import read_surface

SCENE, BUNDLE, NONE = "scene", "bundle", "none"
FILES = ("scene.mrml", "scene.mrb")
POSE, POSE_FILE = "fixed_T_moving", "fixed_T_moving.h5"
# Copies in a form that Slicer reads of what has none: clouds in PLY have no cells, and inputs lie elsewhere.
DATA = "Data"


@dataclass(frozen=True)
class SlicerResult:
    """What a registration has found, for 3D Slicer.

    Parameters
    ----------
    fixed : Surface
        What stays, in the fixed frame in mm (LPS).
    moving : Surface
        What moves, in its own frame in mm (LPS).
    fixed_T_moving : ndarray, shape (4, 4)
        Pose, which also lies in the folder as ``fixed_T_moving.h5``.
    lines : Mapping[str, Centerline], optional
        Centerlines in the fixed frame in mm, by name.
    landmarks : Mapping[str, Landmarks], optional
        Landmarks in the fixed frame in mm, by name.
    further : Mapping[str, Surface], optional
        Other surfaces in the fixed frame in mm, by name, at first hidden.
    deformed : Deformed or None, optional
        Result of the deformable stage, whose files lie in the folder; None for none.
    carried : sequence of str, optional
        Further files of the folder, in the fixed frame after the deformable stage.
    """

    fixed: Surface
    moving: Surface
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    lines: Mapping[str, Centerline] = field(default_factory=dict)
    landmarks: Mapping[str, Landmarks] = field(default_factory=dict)
    further: Mapping[str, Surface] = field(default_factory=dict)
    deformed: Deformed | None = None
    carried: Sequence[str] = ()


def require_slicer(slicer: str) -> None:
    """Check the setting ``slicer``.

    Parameters
    ----------
    slicer : str
        What is written for 3D Slicer.

    Raises
    ------
    InputError
        If it is none of scene, bundle and none.
    """
    if slicer not in (SCENE, BUNDLE, NONE):
        raise InputError(f"slicer: expected {SCENE}, {BUNDLE} or {NONE}, received {slicer!r}")


def write_slicer_result(workspace: Path, result: SlicerResult, slicer: str) -> None:
    """Write scene.mrml with its folder ``Data``, and as a bundle scene.mrb too.

    Parameters
    ----------
    workspace : Path
        Folder of the run, in which pose, moved surface and what deformed already lie as files.
    result : SlicerResult
        What was found.
    slicer : {'scene', 'bundle', 'none'}
        The scene, a bundle beside it, or nothing.
    """
    require_slicer(slicer)
    if slicer == NONE:
        return
    (workspace / DATA).mkdir(exist_ok=True)
    folder = _Folder(workspace)
    moved = transformed(result.moving, result.fixed_T_moving)
    nodes: list[Node] = [
        Transform(POSE, POSE_FILE),
        folder.shape("fixed", result.fixed, GREY, opacity=0.35),
        folder.shape("moving, as given", result.moving, ORANGE, shown=False, under=POSE),
        folder.shape("moved", moved, BLUE, file="moved.ply"),
    ]
    nodes += [folder.shape(name, surface, ORANGE, shown=False) for name, surface in result.further.items()]
    for (name, line), color in zip(result.lines.items(), (RED, BLUE), strict=False):
        nodes.append(folder.line(name, line, color))
    for (name, points), color in zip(result.landmarks.items(), (RED, BLUE), strict=False):
        nodes.append(folder.points(name, points, color))
    if result.deformed is not None:
        nodes += _deformed(folder, result.deformed)
        nodes += [folder.carried(file) for file in result.carried]
    write_slicer_scene(workspace / FILES[0], nodes)
    if slicer == BUNDLE:
        write_slicer_bundle(workspace / FILES[1], workspace / FILES[0])


@dataclass(frozen=True)
class _Folder:
    """Writes what Slicer could not read where it already lies, and names what it can."""

    workspace: Path

    def shape(
        self,
        name: str,
        surface: Surface,
        color: str,
        *,
        file: str = "",
        opacity: float = 1.0,
        shown: bool = True,
        under: str | None = None,
    ) -> Model:
        is_mesh = isinstance(surface, Mesh)
        if not (file and is_mesh):
            file = self._own(name, ".vtp")
            write_model(self.workspace / file, surface)
        return Model(name, file, color, opacity if is_mesh else 1.0, shown, not is_mesh, under)

    def line(self, name: str, line: Centerline, color: str) -> Model:
        file = self._own(name, ".vtp")
        write_centerline(self.workspace / file, line)
        return Model(name, file, color)

    def points(self, name: str, landmarks: Landmarks, color: str) -> PointList:
        file = self._own(name, ".mrk.json")
        write_landmarks(self.workspace / file, landmarks)
        return PointList(name, file, color)

    def carried(self, file: str) -> Model | PointList:
        name = file.partition(".")[0]
        if file.endswith(".mrk.json"):
            return PointList(name, file, GREEN, shown=False)
        if file.endswith(".vtp"):
            return Model(name, file, GREEN, shown=False)
        return self.shape(name, read_surface(self.workspace / file), GREEN, file=file, shown=False)

    def _own(self, name: str, suffix: str) -> str:
        return f"{DATA}/{name.replace(', ', '_').replace(' ', '_')}{suffix}"


def _deformed(folder: _Folder, deformed: Deformed) -> list[Node]:
    return [
        folder.shape("moved, deformed", deformed.moved, GREEN, file="moved_deformed.ply", shown=False),
        folder.shape(
            "model, deformed",
            deformed.model_deformed,
            RED,
            file="model_deformed.ply",
            opacity=0.35,
            shown=False,
        ),
        Transform("displacement of the model", "displacement.h5", is_displacement=True),
    ]
