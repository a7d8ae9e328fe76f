"""Centerlines that go with a user's surfaces: named, or found next to the surface's file under its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.errors import InputError
from experiments.inputs.surfaces import MM_PER_UNIT, naming
from registration.geometry.shapes import (
    LINE_SHARE,
    Centerline,
    Polyline,
    Surface,
    diagonal_mm,
    points_of,
    principal_frame,
)
from registration.io.centerlines import read_centerline_table
from registration.io.patient_space import lps_from, stated_space
from registration.io.surfaces import read_centerline

# The value of the setting that keeps a centerline next to the surface's file from being taken.
NO_CENTERLINE = "none"
SUFFIXES = (".vtp", ".csv")
# A centerline lies inside its vessel; one that is farther out than this share of the vessel's size is another's.
NEAR_SHARE = 0.1
# So many points of a line are enough to see whether it belongs to a surface.
PROBES = 200


@dataclass(frozen=True)
class CenterlineSource:
    """Surface that a centerline belongs to, as it was read.

    Parameters
    ----------
    name : str
        Side of the registration: moving or fixed.
    path : Path
        File of the surface.
    surface : Surface
        Surface or points in mm in LPS.
    unit : str or None
        Length unit of the file, as the user stated it; None where not stated.
    space : str
        Axes that the file was taken to have.
    """

    name: str
    path: Path
    surface: Surface
    unit: str | None
    space: str


def centerline_of(source: CenterlineSource, named: str | None) -> tuple[Centerline | None, Path | None]:
    """Read a surface's centerline: the named one, or one that lies next to the surface, or none.

    A centerline has the unit of its surface and, unless its own header says otherwise, its axes. One found
    next to the surface that does not fit is ignored.

    Parameters
    ----------
    source : CenterlineSource
        Surface.
    named : str or None
        File of the centerline; "none" for no centerline; None for one next to the surface.

    Returns
    -------
    tuple[Centerline or None, Path or None]
        Centerline in mm in LPS and its file, or None for both.

    Raises
    ------
    InputError
        If a named centerline cannot be read or lies elsewhere.
    """
    if named == NO_CENTERLINE:
        return None, None
    if named is not None:
        line = _line_mm(Path(named), source)
        if not _fits(line, source.surface):
            raise InputError(
                f"{source.name}_centerline: expected the centerline of {source.path}, "
                f"received one that lies elsewhere in {named}"
            )
        return line, Path(named)
    for candidate in centerline_candidates(source.path):
        line = _line_mm(candidate, source)
        if _fits(line, source.surface):
            return line, candidate
    return None, None


def centerline_candidates(path: Path) -> list[Path]:
    """Find the files that hold a surface's centerline by their names.

    ``centerline`` stands in place of ``surface`` or ``cloud``, or is added: ``aorta-surface.stl`` is paired
    with ``aorta-centerline.vtp``, ``surface.ply`` and ``cloud.ply`` with ``centerline.csv``, ``iliac.ply``
    with ``iliac-centerline.csv``.

    Parameters
    ----------
    path : Path
        File of the surface.

    Returns
    -------
    list of Path
        Existing files.
    """
    if not path.name:  # the current folder or the root, which are no surfaces
        return []
    stems = [path.stem.replace(word, "centerline") for word in ("surface", "cloud") if word in path.stem]
    stems.append(f"{path.stem}-centerline")
    named = [path.with_name(stem + suffix) for stem in stems for suffix in SUFFIXES]
    return [candidate for candidate in named if candidate.is_file()]


def bends(points_mm: np.ndarray) -> bool:
    """Tell whether a centerline leaves its straight line by more than rounding does.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points of the centerline in mm.

    Returns
    -------
    bool
        True for a bent centerline.
    """
    spread_mm = principal_frame(points_mm).spread_mm
    return bool(spread_mm[1] > LINE_SHARE * spread_mm[0])


def _line_mm(path: Path, source: CenterlineSource) -> Centerline:
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{source.name}_centerline: {path}: expected a centerline as .vtp or .csv, received {path.suffix or 'none'}"
        )
    with naming(f"{source.name}_centerline"):
        line = read_centerline_table(path) if path.suffix.lower() == ".csv" else read_centerline(path)
        space = (stated_space(path) if path.suffix.lower() == ".vtp" else None) or source.space
    scale = MM_PER_UNIT[source.unit or "mm"]
    return Centerline(
        tuple(
            Polyline(scale * lps_from(part.points_mm, space), scale * part.radius_mm) for part in line.lines
        )
    )


def _fits(line: Centerline, surface: Surface) -> bool:
    """Whether the line lies within the surface's bounding box, or out of it by no more than a share of its size."""
    points_mm, vertices_mm = line.even_points(max(PROBES, 2 * len(line.lines))), points_of(surface)
    reach_mm = NEAR_SHARE * diagonal_mm(vertices_mm)
    low_mm, high_mm = vertices_mm.min(axis=0) - reach_mm, vertices_mm.max(axis=0) + reach_mm
    return bool(np.all((points_mm >= low_mm) & (points_mm <= high_mm)))
