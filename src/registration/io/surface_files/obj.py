"""OBJ: vertices and polygons, counted from the first vertex or back from the last."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.io.surface_files.polygons import Polygons, joined


def read_obj(path: Path) -> Polygons:
    """Read all objects of an OBJ file as one.

    Parameters
    ----------
    path : Path
        File ending in ``.obj``.

    Returns
    -------
    Polygons
        Points and polygons.

    Raises
    ------
    InputError
        If a line, which is named, is no vertex or no face.
    """
    # Names of materials may be in any encoding; numbers are not.
    text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words or words[0] not in ("v", "f"):
            continue
        if len(words) < 4:
            raise InputError(
                f"{path}: expected three entries in line {number}, received {len(words) - 1}: cut short"
            )
        try:
            if words[0] == "v":
                points.append([float(word) for word in words[1:4]])
            else:
                faces.append([_corner(word, len(points)) for word in words[1:]])
        except ValueError as refusal:
            raise InputError(f"{path}: expected numbers in line {number}, received {refusal}") from refusal
    return Polygons(np.array(points, dtype=np.float64).reshape(-1, 3), *joined(faces))


def _corner(word: str, points: int) -> int:
    """The place of a corner's vertex, from 0; ``-1`` is the last vertex before the face."""
    index = int(word.partition("/")[0])
    if index == 0:
        raise ValueError("index 0, where the first is 1")
    return index - 1 if index > 0 else points + index
