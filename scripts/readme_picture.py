"""The picture of the README, from simulated data alone: a sweep on its CT model before and after registration.

``python scripts/readme_picture.py --out docs/registered.png`` simulates an artery, reconstructs its sweep and registers
it by the commands of the README, then draws what these left. ``--work`` keeps their files and takes them again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from experiments.cli import main as ctus
from experiments.errors import InputError
from experiments.reporting.figure_files import save_figure
from experiments.reporting.rendered_surfaces import Panel, rendered
from registration.geometry.shapes import Mesh, transformed
from registration.io.surfaces import read_surface
from registration.metrics.surface_distance import SurfaceDistance

MAX_MM = 3.0


def main() -> None:
    """Make the files that are missing, and the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/registered.png"))
    parser.add_argument("--work", type=Path, default=Path("outputs/readme_picture"))
    asked = parser.parse_args()
    work = asked.work
    steps = {
        "simulated": ["study=simulate", "phantom=artery"],
        "reconstructed": [
            "study=reconstruct",
            f"sweep={work / 'simulated/sweep'}",
            f"masks={work / 'simulated/masks'}",
        ],
        "registered": [
            "study=register",
            f"moving={work / 'reconstructed/cloud.ply'}",
            f"fixed={work / 'simulated/model.ply'}",
            "deformable=cpd",
            f"truth={work / 'simulated/truth.json'}",
        ],
    }
    for name, words in steps.items():
        if not (work / name).is_dir() and ctus([*words, f"out={work / name}"]):
            raise SystemExit(f"{name}: expected files, and the call failed")
    save_figure(rendered(panels(work), MAX_MM), asked.out.with_suffix(""), ("png",), dpi=110)
    print(f"Picture: {asked.out}")


def panels(work: Path) -> list[Panel]:
    """The sweep's surface with its centre on that of the model, after the rigid and after the deformable stage.

    Parameters
    ----------
    work : pathlib.Path
        Folder of the three calls.

    Returns
    -------
    list of Panel
        Three views in the model's frame.
    """
    model, deformed = mesh(work / "simulated/model.ply"), mesh(work / "registered/model_deformed.ply")
    swept = mesh(work / "reconstructed/surface.ply")
    record = json.loads((work / "registered/registration.json").read_text(encoding="utf-8"))
    before = np.eye(4)
    before[:3, 3] = model.vertices_mm.mean(axis=0) - swept.vertices_mm.mean(axis=0)
    after = np.array(record["fixed_T_moving"])
    rows = (
        ("centres laid on each other", before, model),
        ("rigid: multi-start", after, model),
        ("deformable: model displaced", after, deformed),
    )
    found = []
    for title, pose, fixed in rows:
        placed = transformed(swept, pose)
        assert isinstance(placed, Mesh)
        found.append(Panel(title, placed, SurfaceDistance(fixed)(placed.vertices_mm), fixed))
    return found


def mesh(path: Path) -> Mesh:
    """The triangles of a file.

    Parameters
    ----------
    path : pathlib.Path
        File with triangles.

    Returns
    -------
    Mesh
        The mesh, mm.
    """
    surface = read_surface(path)
    if not isinstance(surface, Mesh):
        raise InputError(f"{path}: expected triangles, received points")
    return surface


if __name__ == "__main__":
    main()
