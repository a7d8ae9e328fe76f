"""Clouds of contour points to files that keep what is known of each point."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.geometry.point_cloud import OrientedCloud
from registration.io.atomic import write_atomic
from registration.reconstruction.contours import ContourCloud

_TYPES = {"<f4": "float", "<i4": "int"}


def write_cloud(path: Path, cloud: OrientedCloud, space: str = "LPS") -> None:
    """Write points as binary PLY with normals, those of contours with ``frame`` and ``confidence`` as well.

    The header names the axes, which 3D Slicer obeys. Single precision keeps a micrometre within 8 m of the
    origin.

    Parameters
    ----------
    path : Path
        File ending in ``.ply``; its folder must exist.
    cloud : OrientedCloud
        Points in mm.
    space : {'LPS', 'RAS'}, optional
        Axes that they are in.

    Raises
    ------
    InputError
        If the suffix or a setting is another.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise InputError(f"{path}: expected .ply to write, received {path.suffix or 'none'}")
    if space not in ("LPS", "RAS"):
        raise InputError(f"space: expected LPS or RAS, received {space!r}")
    columns = [(name, "<f4", cloud.points_mm[:, axis]) for axis, name in enumerate("xyz")]
    columns += [(f"n{name}", "<f4", cloud.normals[:, axis]) for axis, name in enumerate("xyz")]
    if isinstance(cloud, ContourCloud):
        columns += [("frame", "<i4", cloud.frame_index), ("confidence", "<f4", cloud.confidence)]
    rows = np.empty(len(cloud), dtype=[(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        rows[name] = values
    head = ["ply", "format binary_little_endian 1.0", f"comment SPACE={space}", f"element vertex {len(rows)}"]
    head += [f"property {_TYPES[kind]} {name}" for name, kind, _ in columns]
    write_atomic(path, "\n".join([*head, "end_header", ""]).encode() + rows.tobytes())
