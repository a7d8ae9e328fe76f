"""How near centerlines come to VMTK's lines on its aorta, with clean, noisy and holed surfaces.

    python scripts/bench_centerline.py [FOLDER] [--rows 6] [--quick]

FOLDER is as bench_reconstruction.py has it, which measures these rows too.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from quick_budget import data_folder, parsed
from scipy.spatial import cKDTree

from registration.centerline.end_extension import extend_to_closed_end, reversed_line
from registration.centerline.extractor import CenterlineExtractor
from registration.centerline.vessel_walls import Walls
from registration.geometry.mesh_topology import keep_triangles
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.surfaces import read_centerline, read_surface

NOISE_MM = 0.5
TARGETS = "mean 0.15  p95 0.4  radius 0.1  length 1.5 %"


@dataclass(frozen=True)
class Reference:
    """VMTK's two lines, from the trunk's end to the end of each branch, and the same carried on to the closed wall.

    VMTK's lines begin and end at the centres of small spheres in the domes that close the vessel, which touch the dome
    alone: 2.1 mm inside the plane of the opening on the trunk, 0.3 mm outside and 0.1 mm inside on the branches, and
    0.8 to 0.9 mm away from the middles of the openings. Where a dome's triangles put them is no property of the vessel.
    """

    lines: Centerline
    tip_to_tip: Centerline

    @classmethod
    def of(cls, folder: Path, closed: Mesh) -> Reference:
        """Read the lines and carry them on by the rule that ours end by."""
        lines, walls = read_centerline(folder / "aorta-centerline.vtp"), Walls(closed, closed)
        carried = [
            reversed_line(
                extend_to_closed_end(reversed_line(extend_to_closed_end(line, walls, 0.2)), walls, 0.2)
            )
            for line in lines.lines
        ]
        return cls(lines, Centerline(tuple(carried)))

    @property
    def ends_mm(self) -> np.ndarray:
        """The trunk's end, then those of the branches."""
        return np.stack(
            [self.lines.lines[0].points_mm[0], *(line.points_mm[-1] for line in self.lines.lines)]
        )

    def moved(self, move: Callable[[np.ndarray], np.ndarray]) -> Reference:
        """The same lines in another frame."""
        return Reference(*(_moved(lines, move) for lines in (self.lines, self.tip_to_tip)))


def main() -> None:
    """Print a row for each surface."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--rows", type=int, default=6, help="the first so many of the six")
    given = parsed(parser, {"rows": 2})
    folder = data_folder(given.folder, "vmtk")
    if folder is not None:
        centerlines_compared_with_vmtk(folder, given.rows)


def meshes(folder: Path) -> tuple[Mesh, Mesh]:
    """The aorta with closed ends and with open ones."""
    return mesh_of(folder / "aorta-surface.stl"), mesh_of(folder / "aorta-surface-open-ends.stl")


def mesh_of(path: Path) -> Mesh:
    """A file's surface with triangles."""
    surface = read_surface(path)
    if not isinstance(surface, Mesh):
        raise SystemExit(f"{path}: expected a mesh, received points alone")
    return surface


def centerlines_compared_with_vmtk(folder: Path, rows: int = 6) -> None:
    """The aorta's centerline: ends given and found, noise on the vertices, and a hole in the wall."""
    closed, opened = meshes(folder)
    reference = Reference.of(folder, closed)
    heading()
    surfaces = (
        ("closed, ends given", closed, reference.ends_mm),
        ("open ends, found", opened, None),
        ("closed, ends found", closed, None),
        (f"open, {NOISE_MM} mm noise", noisy(opened), None),
        (f"closed, {NOISE_MM} mm noise", noisy(closed), None),
        ("open, hole of a fifth", holed(opened, reference), None),
    )
    for name, surface, ends_mm in surfaces[:rows]:
        row(name, surface, reference, ends_mm)


def heading() -> None:
    """What the columns are."""
    print(f"aorta's centerline compared with VMTK's (mm), where both run; to be met: {TARGETS}")
    print(
        "  length: whole as VMTK's lines end, then between our ends with VMTK's carried on to the wall, then where"
    )
    print("  both run; ends: how far ours are from VMTK's")


def row(name: str, surface: Mesh, reference: Reference, ends_mm: np.ndarray | None = None) -> None:
    """Find the centerline of a surface, and compare it with each of VMTK's lines."""
    begin_s = time.perf_counter()
    found = CenterlineExtractor()(surface, ends_mm)
    seconds = time.perf_counter() - begin_s
    for number, (theirs, carried) in enumerate(
        zip(reference.lines.lines, reference.tip_to_tip.lines, strict=True)
    ):
        compared = _compared(found, theirs, carried)
        print(f"  {name:24s} line {number} of {len(found.lines)}: {compared}  {seconds:.2f} s for all")


def noisy(mesh: Mesh) -> Mesh:
    """The mesh with noise on each coordinate of each vertex."""
    shift_mm = np.random.default_rng(0).normal(0, NOISE_MM, mesh.vertices_mm.shape)
    return Mesh(mesh.vertices_mm + shift_mm, mesh.triangles)


def holed(mesh: Mesh, reference: Reference) -> Mesh:
    """The mesh without a round patch as wide as a fifth of the circumference, halfway along the trunk."""
    line = reference.lines.lines[0]
    place = len(line.points_mm) // 4
    middle_mm = mesh.corners_mm.mean(axis=1)
    centre_mm = middle_mm[np.linalg.norm(middle_mm - line.points_mm[place], axis=1).argmin()]
    reach_mm = 0.2 * np.pi * line.radius_mm[place]
    return keep_triangles(mesh, np.linalg.norm(middle_mm - centre_mm, axis=1) > reach_mm)


def line_distances_mm(found: Centerline, reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    """Distances from all our lines to VMTK's, carried on, and from VMTK's to ours, whichever end they start from."""
    ours, carried, theirs = (
        np.concatenate([line.at(np.arange(0.0, line.length_mm, 0.05)) for line in lines.lines])
        for lines in (found, reference.tip_to_tip, reference.lines)
    )
    return cKDTree(carried).query(ours)[0], cKDTree(ours).query(theirs)[0]


def _compared(found: Centerline, theirs: Polyline, carried: Polyline) -> str:
    ours = min(found.lines, key=lambda line: float(np.linalg.norm(line.points_mm[-1] - theirs.points_mm[-1])))
    place_mm, own_mm = np.arange(0.0, theirs.length_mm, 0.05), np.arange(0.0, ours.length_mm, 0.1)
    apart_mm, nearest = cKDTree(theirs.at(place_mm)).query(ours.at(own_mm))
    both = (nearest > 0) & (nearest < len(place_mm) - 1)
    radius_mm = np.interp(own_mm, ours.arc_mm, ours.radius_mm)
    radius_mm = np.abs(radius_mm - np.interp(place_mm, theirs.arc_mm, theirs.radius_mm)[nearest])
    whole = ours.length_mm / theirs.length_mm - 1
    between = ours.length_mm / _stretch_mm(carried, ours) - 1
    shared = _stretch_mm(ours, theirs) / _stretch_mm(theirs, ours) - 1
    ends_mm = np.linalg.norm(ours.points_mm[[0, -1]] - theirs.points_mm[[0, -1]], axis=1)
    return (
        f"mean {apart_mm[both].mean():.3f}  p95 {np.percentile(apart_mm[both], 95):.3f}  "
        f"radius {radius_mm[both].mean():.3f}  "
        f"length {100 * whole:+.2f} %, {100 * between:+.2f} %, {100 * shared:+.2f} %  "
        f"ends {ends_mm[0]:.2f} {ends_mm[1]:.2f}"
    )


def _stretch_mm(line: Polyline, other: Polyline) -> float:
    """The length of a line between the places nearest to the other's two ends."""
    arc_mm = np.arange(0.0, line.length_mm, 0.01)
    first, last = cKDTree(line.at(arc_mm)).query(other.points_mm[[0, -1]])[1]
    return float(arc_mm[last] - arc_mm[first])


def _moved(lines: Centerline, move: Callable[[np.ndarray], np.ndarray]) -> Centerline:
    return Centerline(tuple(Polyline(move(line.points_mm), line.radius_mm) for line in lines.lines))


if __name__ == "__main__":
    main()
