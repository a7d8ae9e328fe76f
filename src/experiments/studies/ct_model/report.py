"""What is reported of a model made from a label map or a mesh: its record, table and metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from registration.ct_model.loader import ModelInput
from registration.geometry.mesh_quality import MeshQuality
from registration.geometry.shapes import Centerline
from registration.io.units import typical_radius_mm

if TYPE_CHECKING:
    import pandas as pd

SIDES = tuple(f"{side} {axis}" for axis in "ijk" for side in ("first", "last"))


@dataclass(frozen=True)
class CtModel:
    """Finished model and what was measured on it.

    Parameters
    ----------
    path : Path
        File that was read.
    source : ModelInput
        Surface in mm in LPS and what it was made of.
    centerline : Centerline or None
        Centerline in mm in LPS; None where there is none.
    refusal : str
        Why there is no centerline; empty otherwise.
    quality : MeshQuality
        Quality of the surface.
    timing : Mapping[str, float]
        Duration in s by stage.
    """

    path: Path
    source: ModelInput
    centerline: Centerline | None
    refusal: str
    quality: MeshQuality
    timing: Mapping[str, float]

    @property
    def cut_sides(self) -> tuple[str, ...]:
        """The sides of the volume that the vessel runs out of."""
        mask = self.source.mask
        if mask is None:
            return ()
        return tuple(side for side, cut in zip(SIDES, mask.cut.reshape(-1), strict=True) if cut)


def record(model: CtModel) -> dict[str, Any]:
    """Make the content of ``ct_model.json``.

    Parameters
    ----------
    model : CtModel
        Finished model.

    Returns
    -------
    dict
        Content, ready for JSON; lengths in mm, times in s.
    """
    low_mm, high_mm = model.source.mesh.vertices_mm.min(axis=0), model.source.mesh.vertices_mm.max(axis=0)
    return {
        "input": str(model.path),
        "kind": "mesh" if model.source.mask is None else "label_map",
        "input_units": model.source.units,
        "input_space": model.source.space,
        "units": {"length": "mm", "time": "s"},
        "space": "LPS",
        "volume_mm3": model.quality.volume_mm3,
        "typical_radius_mm": typical_radius_mm(model.source.mesh),
        "extent_mm": (high_mm - low_mm).tolist(),
        "low_mm": low_mm.tolist(),
        "high_mm": high_mm.tolist(),
        "quality": asdict(model.quality),
        "lumen": None if model.source.lumen is None else model.source.lumen.record(),
        "label": _label(model),
        "repair": _repair(model),
        "centerline": _centerline(model),
        "timing": {**model.timing, "total_s": sum(model.timing.values())},
    }


def metrics(model: CtModel) -> dict[str, float]:
    """Compute the scalars for the tracker.

    Parameters
    ----------
    model : CtModel
        Finished model.

    Returns
    -------
    dict
        Scalars by name; those of a missing centerline are NaN.
    """
    found = _centerline(model)
    numbers = {
        "vertices": float(model.quality.vertices),
        "triangles": float(model.quality.triangles),
        "volume_mm3": model.quality.volume_mm3,
        "area_mm2": model.quality.area_mm2,
        "typical_radius_mm": typical_radius_mm(model.source.mesh),
        "open_ends": float(model.quality.open_ends),
        "holes": float(model.quality.holes),
        "runtime_s": sum(model.timing.values()),
    }
    for name in ("lines", "length_mm", "radius_median_mm"):
        numbers[f"centerline_{name}"] = float(found[name]) if "refused" not in found else float("nan")
    return numbers


def table(model: CtModel) -> pd.DataFrame:
    """Summarise the model in a few lines.

    Parameters
    ----------
    model : CtModel
        Finished model.

    Returns
    -------
    pandas.DataFrame
        Columns ``what`` and ``value``.
    """
    import pandas as pd

    extent_mm = np.ptp(model.source.mesh.vertices_mm, axis=0)
    quality, found = model.quality, _centerline(model)
    lines = [
        ("surface", f"{quality.triangles} triangles, {quality.open_ends} open ends, {quality.holes} holes"),
        ("extent", " x ".join(f"{side:.1f}" for side in extent_mm) + " mm (LPS)"),
        ("volume", f"{quality.volume_mm3:.1f} mm3"),
        ("typical radius", f"{typical_radius_mm(model.source.mesh):.2f} mm"),
    ]
    if "refused" not in found:
        lines.append(("centerline", f"{found['lines']} lines, {found['length_mm']:.1f} mm"))
    lines.append(("time", ", ".join(f"{name[:-2]} {value:.2f} s" for name, value in model.timing.items())))
    return pd.DataFrame(lines, columns=["what", "value"])


def _label(model: CtModel) -> dict[str, Any] | None:
    mask = model.source.mask
    if mask is None:
        return None
    return {
        "value": mask.label,
        "name": model.source.label_name,
        "spacing_mm": mask.spacing_mm.tolist(),
        "voxels": int(mask.inside.sum()),
        "volume_mm3": mask.volume_mm3,
        "pieces_dropped": mask.pieces_dropped,
        "voxels_dropped": mask.voxels_dropped,
        "voxels_filled": mask.voxels_filled,
        "cut_sides": list(model.cut_sides),
        "lost_mm": model.source.lost_mm,
    }


def _repair(model: CtModel) -> dict[str, Any] | None:
    done = model.source.repaired
    if done is None:
        return None
    return {
        "vertices_merged": done.vertices_merged,
        "triangles_dropped": done.triangles_dropped,
        "triangles_turned": done.triangles_turned,
        "pieces_dropped": done.pieces_dropped,
        "area_dropped_mm2": done.area_dropped_mm2,
    }


def _centerline(model: CtModel) -> dict[str, Any]:
    if model.centerline is None:
        return {"refused": model.refusal}
    lines = model.centerline.lines
    radius_mm = np.concatenate([line.radius_mm for line in lines])
    return {
        "lines": len(lines),
        "points": len(radius_mm),
        "length_mm": model.centerline.length_mm,
        "lengths_mm": [line.length_mm for line in lines],
        "radius_min_mm": float(radius_mm.min()),
        "radius_median_mm": float(np.median(radius_mm)),
        "radius_max_mm": float(radius_mm.max()),
    }
