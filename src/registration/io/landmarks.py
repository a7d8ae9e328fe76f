"""Landmarks set by hand in two files: read with the axes their header names, paired by name, laid on each other."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.brief import brief_repr
from registration.errors import InputError
from registration.geometry.rigid_fit import kabsch
from registration.geometry.shapes import LINE_SHARE, principal_frame
from registration.input_files import guarded
from registration.io.atomic import write_atomic
from registration.io.centerlines import MARKUPS_SCHEMA
from registration.io.patient_space import lps_from
from registration.io.truncation import require_file
from registration.text_files import parse_number, read_text

MIN_PAIRS = 3
# Numbers stand for the axes in .fcsv files of 3D Slicer before 4.11 (user guide, "Markups").
SPACES = {"ras": "ras", "lps": "lps", "0": "ras", "1": "lps"}
# Lengths by their code in UCUM, which 3D Slicer gives alone or as [code, "UCUM", meaning] (markups schema 1.0.3).
MM_PER_CODE = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3}
# 3D Slicer 5 adds two fields to a row of .fcsv that its header does not name: the state of the position and whether
# the point was made by itself. The states are vtkMRMLMarkupsNode's: 0 undefined, 1 preview, 2 defined, 3 missing.
_STATUS = "positionStatus"
_UNNAMED = (_STATUS, "autoCreated")
_STATES = ("0", "1", "2", "3")
_PLACED = ("2", "defined", "")


@dataclass(frozen=True)
class Landmarks:
    """Named points.

    Parameters
    ----------
    names : tuple of str
        A name of its own for each point.
    points_mm : ndarray, shape (n, 3)
        Points in LPS in mm.

    Raises
    ------
    InputError
        If there are not as many names as points, a name is there twice, or a coordinate is not finite.
    """

    names: tuple[str, ...]
    points_mm: Float64[np.ndarray, "n 3"]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        if len(self.names) != len(self.points_mm):
            raise InputError(
                f"names: expected one for each of {len(self.points_mm)} points, received {len(self.names)}"
            )
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        if twice:
            raise InputError(f"names: expected a name of its own for each, received {', '.join(twice)} twice")
        if not np.isfinite(self.points_mm).all():
            raise InputError("points_mm: expected finite coordinates, received NaN or infinity")


@dataclass(frozen=True)
class LandmarkPairs:
    """The same landmarks in two coordinate frames.

    Parameters
    ----------
    names : tuple of str
        Names of the landmarks, at least three.
    moving_mm : ndarray, shape (n, 3)
        Points in the moving coordinate frame in mm, not on one line.
    fixed_mm : ndarray, shape (n, 3)
        The same points in the fixed coordinate frame in mm.

    Raises
    ------
    InputError
        If there are fewer than three pairs, not as many names, or points on one line.
    """

    names: tuple[str, ...]
    moving_mm: Float64[np.ndarray, "n 3"]
    fixed_mm: Float64[np.ndarray, "n 3"]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        if not len(self.names) == len(self.moving_mm) == len(self.fixed_mm) >= MIN_PAIRS:
            raise InputError(
                f"landmarks: expected at least {MIN_PAIRS} pairs with the same names, received {len(self.names)}"
            )
        for side, points_mm in (("moving", self.moving_mm), ("fixed", self.fixed_mm)):
            spread_mm = principal_frame(points_mm).spread_mm
            if not spread_mm[1] > LINE_SHARE * spread_mm[0]:
                raise InputError(
                    f"{side}_landmarks: expected landmarks that span a plane, received them on one line"
                )

    @property
    def fixed_T_moving(self) -> Float64[np.ndarray, "4 4"]:
        """The rigid transform without scale that brings the pairs closest (Kabsch, Acta Cryst. A32, 1976)."""
        return kabsch(self.moving_mm, self.fixed_mm)

    def errors_mm(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, " n"]:
        """Measure how far each moving landmark is from its fixed one after registration.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Rigid transform from moving to fixed in mm.

        Returns
        -------
        ndarray, shape (n,)
            Distances in mm.
        """
        return np.linalg.norm(transforms.apply(fixed_T_moving, self.moving_mm) - self.fixed_mm, axis=1)


def paired(moving: Landmarks, fixed: Landmarks) -> LandmarkPairs:
    """Pair landmarks by name.

    Parameters
    ----------
    moving : Landmarks
        Landmarks in the moving coordinate frame.
    fixed : Landmarks
        Landmarks in the fixed coordinate frame.

    Returns
    -------
    LandmarkPairs
        Pairs in the order of ``moving``.

    Raises
    ------
    InputError
        If one side has a name that the other has not, or the pairs fix no pose.
    """
    for side, own, other in (("moving", moving, fixed), ("fixed", fixed, moving)):
        alone = [name for name in own.names if name not in other.names]
        if alone:
            raise InputError(
                f"{side}_landmarks: expected the same names on both sides, received {', '.join(alone)} on one only"
            )
    place = {name: row for row, name in enumerate(fixed.names)}
    order = np.array([place[name] for name in moving.names], dtype=np.int64)
    return LandmarkPairs(moving.names, moving.points_mm, fixed.points_mm[order])


@guarded("landmarks")
def read_landmarks(path: Path) -> Landmarks:
    """Read the landmarks of a file of 3D Slicer's into LPS and mm, those left out that were never placed.

    Parameters
    ----------
    path : Path
        File ending in ``.mrk.json`` or ``.fcsv``; lengths in other units than mm are converted.

    Returns
    -------
    Landmarks
        Named points.

    Raises
    ------
    InputError
        If the file is missing or of another kind, does not name its axes (LPS or RAS), states a unit that is
        no length, or a landmark has no name of its own.
    """
    path = require_file(path)
    read = {".json": _read_markups, ".fcsv": _read_fcsv}.get(path.suffix.lower())
    if read is None:
        raise InputError(
            f"{path}: expected landmarks as .mrk.json or .fcsv, received {path.suffix or 'no suffix'}"
        )
    try:
        names, points, space = read(path)
        if any(len(point) != 3 for point in points):
            raise InputError("expected three coordinates a point, received another number")
        points_mm = np.array(points, dtype=np.float64).reshape(-1, 3)
        if space.lower() not in SPACES:
            raise InputError(f"expected a header that names its axes LPS or RAS, received {space or 'none'}")
        return Landmarks(tuple(names), lps_from(points_mm, SPACES[space.lower()]))
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as refusal:
        raise InputError(
            f"{path}: expected landmarks as 3D Slicer writes them, received {type(refusal).__name__} {refusal}"
        ) from refusal


def write_landmarks(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as 3D Slicer's .mrk.json, in LPS and mm.

    Parameters
    ----------
    path : Path
        File to write.
    landmarks : Landmarks
        Landmarks.
    """
    points = [
        {"id": str(place), "label": name, "position": position, "positionStatus": "defined"}
        for place, (name, position) in enumerate(
            zip(landmarks.names, landmarks.points_mm.round(6).tolist(), strict=True), start=1
        )
    ]
    markup = {
        "type": "Fiducial",
        "name": path.name.split(".")[0],
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": points,
    }
    text = json.dumps({"@schema": MARKUPS_SCHEMA, "markups": [markup]}, indent=2)
    write_atomic(path, (text + "\n").encode())


def _read_markups(path: Path) -> tuple[list[str], list[Any], str]:
    """Names, positions in mm and the name of the axes in a .mrk.json file, over all its lists of points."""
    names: list[str] = []
    points: list[Any] = []
    spaces: set[str] = set()
    for markup in json.loads(read_text(path))["markups"]:
        spaces.add(str(markup.get("coordinateSystem", "")).strip())
        scale = _mm_per_unit(markup.get("coordinateUnits", "mm"))
        for point in markup.get("controlPoints", []):
            if point.get(_STATUS, "defined") == "defined":
                names.append(str(point["label"]).strip())
                points.append([scale * parse_number(str(value)) for value in point["position"]])
    if len(spaces) > 1:
        raise InputError(f"expected one coordinateSystem, received {', '.join(sorted(spaces))}")
    return names, points, next(iter(spaces), "")


def _mm_per_unit(units: Any) -> float:
    """Millimetres in a unit of length, given by its code or as code, coding scheme and meaning."""
    coded = isinstance(units, list) and len(units) in (2, 3) and units[1] == "UCUM"
    code = units[0] if coded else units
    if not isinstance(code, str) or code not in MM_PER_CODE:
        raise InputError(f"expected coordinateUnits of {', '.join(MM_PER_CODE)}, received {units}")
    return MM_PER_CODE[code]


def _read_fcsv(path: Path) -> tuple[list[str], list[Any], str]:
    """Names, positions and the name of the axes in a .fcsv file, whose header names its columns in their order."""
    lines = read_text(path).splitlines()
    header = {
        key.strip(): value.strip()
        for key, _, value in (line.lstrip("# ").partition("=") for line in lines if line.startswith("#"))
    }
    columns = [name.strip() for name in header.get("columns", "").split(",")]
    if not {"x", "y", "z", "label"} <= set(columns):
        raise InputError(f"expected the columns x, y, z and label, received {', '.join(columns) or 'none'}")
    names, points = [], []
    for row in csv.reader(line for line in lines if line.strip() and not line.startswith("#")):
        entries = _fcsv_entries(columns, row)
        if entries.get(_STATUS, "").lower() in _PLACED:
            names.append(entries["label"])
            points.append([parse_number(entries[axis]) for axis in "xyz"])
    return names, points, header.get("CoordinateSystem", "")


def _fcsv_entries(columns: list[str], row: list[str]) -> dict[str, str]:
    """The fields of a row by column; those that the header does not name are Slicer's state and origin of the point."""
    own = [name for name in _UNNAMED if name not in columns][: max(len(row) - len(columns), 0)]
    # More or other fields come of numbers with decimal commas, which move all that follows into the wrong column.
    unnamed = [entry.strip() for entry in row[len(columns) :]]
    if len(row) < len(columns) or len(unnamed) > len(own) or not set(unnamed) <= set(_STATES):
        raise InputError(f"expected {len(columns)} fields a row, received {len(row)} in {','.join(row)!r}")
    return {name: entry.strip() for name, entry in zip([*columns, *own], row, strict=True)}
