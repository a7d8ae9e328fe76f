"""Benchmark cases as files: one folder a case, and its truth in a folder apart.

``<subset>/<case>/`` holds what a method is given: ``moving.ply`` (points with normals and the frame each was seen in),
``fixed.ply`` (the model's triangles), ``fixed_points.ply`` (points of it, even by area) and ``case.json``, all in mm in
LPS; where a case gives them, the last also holds a coarse centerline of each side and a pose to start from.
``<subset>/truth/<case>.json`` holds the pose, the targets, which of them were swept, where their material lay, and the
symmetry.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from registration.benchmark.cases import BenchmarkCase, CaseTruth, digest
from registration.benchmark.truth_files import read_json, truth_as_json
from registration.errors import InputError
from registration.geometry.open3d_bridge import quiet_open3d
from registration.geometry.shapes import Mesh, require_cloud, require_points
from registration.input_files import refusing
from registration.io.atomic import atomic_folder, write_atomic
from registration.io.point_clouds import write_cloud
from registration.io.surfaces import read_surface, write_surface
from registration.reconstruction.contours import ContourCloud
from registration.transforms import require_rigid

TRUTH = "truth"
CASE_FILE = "case.json"
INITIAL = "initial"
HINTS = ("moving_centerline_mm", "fixed_centerline_mm", INITIAL)
MOVING, FIXED, FIXED_POINTS = "moving.ply", "fixed.ply", "fixed_points.ply"


def write_case(folder: Path, case: BenchmarkCase, truth: CaseTruth) -> None:
    """Write a case into ``folder``/<case> and its truth next to it.

    The case's folder is written atomically, after the truth.

    Parameters
    ----------
    folder : Path
        Folder of the subset.
    case : BenchmarkCase
        Case to write.
    truth : CaseTruth
        Its truth, written into ``folder``/truth.
    """
    told = truth_as_json(truth) | {"digest": digest(case, truth)}
    write_atomic(truth_file(folder, case.name), (json.dumps(told) + "\n").encode())
    with atomic_folder(folder / case.name) as stage:
        write_cloud(stage / MOVING, _contours(case))
        write_surface(stage / FIXED, case.fixed)
        write_surface(stage / FIXED_POINTS, case.fixed_mm)
        about = {
            "case": case.name,
            "anatomy": case.anatomy,
            "kind": case.kind,
            "simulated": True,
            "units": {"length": "mm"},
            "space": "lps",
            "moving": MOVING,
            "fixed": FIXED,
            "fixed_points": FIXED_POINTS,
            "moving_points": len(case.moving_mm),
            "frames": len(np.unique(case.moving_frame)),
            **{name: value.tolist() for name in HINTS if (value := getattr(case, name)) is not None},
        }
        write_atomic(stage / CASE_FILE, (json.dumps(about, indent=2) + "\n").encode())


def read_case(folder: Path) -> BenchmarkCase:
    """Read one case.

    Parameters
    ----------
    folder : Path
        Folder of the case.

    Returns
    -------
    BenchmarkCase
        The case, without its truth.

    Raises
    ------
    InputError
        If a file is missing or malformed; the message names it.
    """
    with refusing(folder, "a benchmark case"):
        return _case(folder)


def _case(folder: Path) -> BenchmarkCase:
    about = read_json(folder / CASE_FILE)
    missing = [key for key in ("case", "anatomy", "kind") if not isinstance(about.get(key), str)]
    if missing:
        raise InputError(f"{folder / CASE_FILE}: expected {', '.join(missing)} as text, received none")
    fixed, fixed_mm = read_surface(folder / FIXED), read_surface(folder / FIXED_POINTS)
    if not isinstance(fixed, Mesh):
        raise InputError(f"{folder / FIXED}: expected a mesh, received points alone")
    if isinstance(fixed_mm, Mesh):
        raise InputError(f"{folder / FIXED_POINTS}: expected points alone, received a mesh")
    moving_mm, normals, frame = _read_moving(folder / MOVING)
    return BenchmarkCase(
        about["case"],
        about["anatomy"],
        about["kind"],
        moving_mm,
        normals,
        frame,
        fixed,
        fixed_mm,
        **{name: _hint(folder / CASE_FILE, name, about[name]) for name in HINTS if name in about},
    )


def truth_file(folder: Path, case: str) -> Path:
    """Return the path of a case's truth.

    Parameters
    ----------
    folder : Path
        Folder of the subset.
    case : str
        Name of the case.

    Returns
    -------
    Path
        Path of the JSON file, which need not exist.
    """
    return folder / TRUTH / f"{case}.json"


def case_names(folder: Path) -> list[str]:
    """List the cases whose truth is present.

    Parameters
    ----------
    folder : Path
        Folder of the subset.

    Returns
    -------
    list of str
        Names in alphabetical order.
    """
    return sorted(path.stem for path in (folder / TRUTH).glob("*.json") if not path.name.startswith("."))


def written_digest(folder: Path, case: str) -> str | None:
    """Read the digest of a case that is completely written.

    Parameters
    ----------
    folder : Path
        Folder of the subset.
    case : str
        Name of the case.

    Returns
    -------
    str or None
        The digest; None where the case or its truth is missing or has none.

    Raises
    ------
    InputError
        If the truth is not JSON.
    """
    if not (folder / case / CASE_FILE).is_file() or not truth_file(folder, case).is_file():
        return None
    found = read_json(truth_file(folder, case)).get("digest")
    return found if isinstance(found, str) else None


def _hint(path: Path, name: str, told: object) -> np.ndarray:
    """A centerline or a pose that a case gives along with its clouds."""
    try:
        found = np.array(told, dtype=np.float64)
        if name == INITIAL:
            return require_rigid(found.reshape(4, 4), name)
        return require_points(found, name, 2)
    except (TypeError, ValueError) as refusal:
        raise InputError(f"{path}: expected {name} as numbers, received {refusal}") from refusal


def _contours(case: BenchmarkCase) -> ContourCloud:
    """The moving cloud as ``write_cloud`` takes it; which contour a point was on is not kept."""
    count = len(case.moving_mm)
    return ContourCloud(
        case.moving_mm,
        case.moving_normals,
        frame_index=case.moving_frame,
        contour_index=np.zeros(count, dtype=np.int64),
        is_open=np.zeros(count, dtype=bool),
        confidence=np.ones(count),
        world_A_pixel=np.empty((0, 4, 4)),
    )


def _read_moving(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    read_surface(path)  # refuses what is missing, cut short or degenerate, in one sentence
    with quiet_open3d() as open3d:
        cloud = open3d.t.io.read_point_cloud(path)
    if "normals" not in cloud.point or "frame" not in cloud.point:
        raise InputError(f"{path}: expected points with normals and frames, received points without")
    points_mm = cloud.point["positions"].numpy().astype(np.float64)
    normals = cloud.point["normals"].numpy().astype(np.float64)
    return require_cloud(points_mm, str(path)), normals, cloud.point["frame"].numpy().ravel().astype(np.int64)
