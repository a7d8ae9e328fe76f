"""Study ``centerline``: the centerline of a vessel whose surface or cloud the user has."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.outcome import InputData, Outcome, Progress
from experiments.paths import PathSetting
from experiments.reporting.scene import CloudLayer, Layer, LineLayer, Scene, SurfaceLayer
from experiments.studies.centerline.report import cases, metrics, table
from registration.centerline.extractor import CenterlineExtractor
from registration.errors import InputError as RegistrationInputError
from registration.geometry.hollow import Lumen
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.mesh_repair import repair
from registration.geometry.point_cloud import with_normals
from registration.geometry.shapes import Centerline, Mesh, Surface, diagonal_mm
from registration.io.centerlines import write_centerline
from registration.io.landmarks import Landmarks, read_landmarks
from registration.io.patient_space import lps_from, stated_space, write_model
from registration.io.surfaces import read_surface
from registration.io.units import DIAGONAL_MM, MM_PER_UNIT, to_millimetres
from registration.pipeline import timed
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.vessel_pieces import VesselPieces

SPACES = ("lps", "ras")
WHERE = "The files are in mm in LPS; open scene.html in a browser to look at them."


def check(*, mesh: PathSetting, ends: PathSetting | None, space: str | None, units: str | None) -> None:
    """Check that the files can be read and that the settings exist.

    Parameters
    ----------
    mesh : PathSetting
        File of the surface or point cloud.
    ends : PathSetting or None
        File of 3D Slicer landmarks inside the vessel, the source first; None to find the ends.
    space : str or None
        Axes of ``mesh``, lps or ras; None to take them from the file.
    units : str or None
        Length unit of ``mesh``; None for mm.

    Raises
    ------
    InputError
        If a file cannot be read, or ``space`` or ``units`` does not exist.
    """
    if space not in (None, *SPACES):
        raise InputError(f"space: expected lps, ras or null, received {space!r}")
    if units not in (None, *MM_PER_UNIT):
        raise InputError(f"units: expected {', '.join(MM_PER_UNIT)} or null, received {units!r}")
    _read(Path(mesh), space)
    _ends(ends)


def run(
    *,
    mesh: PathSetting,
    ends: PathSetting | None,
    space: str | None,
    units: str | None,
    surface: SurfaceMethod,
    centerline: CenterlineExtractor,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Extract the centerline of a surface or point cloud.

    Leaves ``centerline.vtp``, ``.csv`` and ``.mrk.json``, ``centerline.json`` and ``scene.html`` in
    ``workspace``. A cloud becomes a surface first, left as ``surface.ply``.

    Parameters
    ----------
    mesh : PathSetting
        File of the surface or point cloud.
    ends : PathSetting or None
        File of 3D Slicer landmarks inside the vessel, the source first; None to find the ends.
    space : str or None
        Axes of ``mesh``, lps or ras; None to take them from the file.
    units : str or None
        Length unit of ``mesh``; None for mm.
    surface : SurfaceMethod
        Method that makes a surface of a cloud.
    centerline : CenterlineExtractor
        Extraction of the centerline.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each point, a table of lines, and findings.

    Raises
    ------
    InputError
        If the input is no vessel or not of a vessel's size, or the ends lie outside.
    """
    path, seconds = Path(mesh), dict[str, float]()
    progress.note(f"reading {path.name}")
    read, axes = _read(path, space)
    landmarks = _ends(ends)
    with timed(seconds, "surface"):
        wall, lumen = _wall(read, units, surface, path)
    if not isinstance(read, Mesh):
        write_model(workspace / "surface.ply", wall)
    progress.note(f"centerline of {len(wall.triangles)} triangles")
    with timed(seconds, "centerline"):
        found = centerline(wall, None if landmarks is None else landmarks.points_mm)
    for suffix in ("vtp", "csv", "mrk.json"):
        write_centerline(workspace / f"centerline.{suffix}", found)
    report = _record(path, wall, found, landmarks, seconds) | {
        "input_space": axes,
        "input_units": units or "mm",
        "lumen": None if lumen is None else lumen.record(),
    }
    files.write_text(workspace / "centerline.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    _scene(path, wall, found, landmarks).write(workspace / "scene.html")
    used = [path] if ends is None else [path, Path(ends)]
    return Outcome(
        metrics=metrics(found) | {f"{stage}_s": value for stage, value in seconds.items()},
        cases=cases(found),
        tables={"centerline": table(found)},
        findings=(
            *(() if lumen is None else (lumen.described,)),
            _counted(found, path),
            WHERE,
        ),
        inputs=tuple(InputData(file.name, files.digest(file), str(file)) for file in used),
    )


def _counted(found: Centerline, path: Path) -> str:
    lengths = ", ".join(f"{line.length_mm:.1f}" for line in found.lines)
    if len(found.lines) == 1:
        return f"1 line of {lengths} mm from {path.name}."
    return f"{len(found.lines)} lines of {lengths} mm from {path.name}; those of one trunk include it each."


def _read(path: Path, space: str | None) -> tuple[Surface, str]:
    """The file's surface or points in LPS, in its own unit, and the axes it was taken to have."""
    try:
        found = read_surface(path)
    except RegistrationInputError as refusal:
        raise InputError(f"mesh: {refusal}") from refusal
    stated = stated_space(path)
    if stated is not None and space not in (None, stated):
        raise InputError(f"space: expected {stated}, as the header of {path} says, received {space}")
    axes = space or stated or "lps"
    if isinstance(found, Mesh):
        return Mesh(lps_from(found.vertices_mm, axes), found.triangles), axes
    return lps_from(found, axes), axes


def _ends(ends: PathSetting | None) -> Landmarks | None:
    if ends is None:
        return None
    try:
        return read_landmarks(Path(ends))
    except RegistrationInputError as refusal:
        raise InputError(f"ends: {refusal}") from refusal


def _wall(read: Surface, units: str | None, surface: SurfaceMethod, path: Path) -> tuple[Mesh, Lumen | None]:
    """The vessel's surface in mm: a mesh made whole, or made of a cloud; and whether it is a hollow body's lumen."""
    if isinstance(read, Mesh):
        try:
            repaired = repair(read)
        except RegistrationInputError as refusal:
            raise InputError(f"mesh: {path}: {refusal}") from refusal
        return to_millimetres(repaired.mesh, units, str(path)), repaired.lumen
    points_mm = MM_PER_UNIT[units or "mm"] * read
    length = diagonal_mm(points_mm)
    if units is None and not DIAGONAL_MM[0] <= length <= DIAGONAL_MM[1]:
        raise InputError(
            f"mesh: expected a vessel in millimetres in {path}, received points with a diagonal of {length:.3g}: "
            "pass units=m or units=cm to convert them or units=mm to take them as they are"
        )
    return VesselPieces()(surface(with_normals(points_mm))).mesh, None


def _record(
    path: Path, wall: Mesh, found: Centerline, landmarks: Landmarks | None, seconds: dict[str, float]
) -> dict[str, Any]:
    lines = [
        {
            "length_mm": line.length_mm,
            "points": len(line.points_mm),
            "radius_min_mm": float(line.radius_mm.min()),
            "radius_median_mm": float(np.median(line.radius_mm)),
            "radius_max_mm": float(line.radius_mm.max()),
            "begin_mm": line.points_mm[0].tolist(),
            "end_mm": line.points_mm[-1].tolist(),
        }
        for line in found.lines
    ]
    return {
        "mesh": str(path),
        "units": {"length": "mm", "time": "s"},
        "space": "LPS",
        "ends": "found" if landmarks is None else list(landmarks.names),
        "lines": lines,
        "quality": asdict(mesh_quality(wall)),
        "seconds": seconds,
    }


def _scene(path: Path, wall: Mesh, found: Centerline, landmarks: Landmarks | None) -> Scene:
    layers: list[Layer] = [SurfaceLayer("surface", wall), LineLayer.of("centerline", found)]
    if landmarks is not None:
        layers.append(CloudLayer("given ends", landmarks.points_mm, size_px=6.0))
    return Scene(layers, f"Centerline of {path.name}", space="LPS")
