"""What is reported of a reconstructed sweep: its record, tables, metrics, sentences and page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.reconstruction_faults import (
    mask_record,
    numbers,
    sentences,
    steps_along,
    surface_record,
)
from experiments.inputs.paths import describe_dropped
from experiments.reporting.labels import counted
from experiments.reporting.scene import CloudLayer, Layer, LineLayer, Scene, SurfaceLayer
from registration.geometry.mesh_quality import mesh_quality
from registration.metrics.surface_distance import SurfaceDistance
from registration.sweep import count_frames

if TYPE_CHECKING:
    import pandas as pd

    from registration.pipeline import Reconstructed
    from registration.sweep import PosedFrames, TrackedSweep

# Places on the surface that are asked for a measured point nearby, always the same ones.
SAMPLES = 20_000
# A surface that fewer points are near has left a part of what was seen out.
MAX_POINTS_NEAR = 0.95


def record(found: Reconstructed, posed: PosedFrames, sweep: TrackedSweep, near_mm: float) -> dict[str, Any]:
    """Make the content of ``reconstruction.json``: counts, what was left out, coverage, seconds, quality.

    Parameters
    ----------
    found : Reconstructed
        Reconstruction.
    posed : PosedFrames
        Frames with a pose.
    sweep : TrackedSweep
        Tracked sweep.
    near_mm : float
        Distance in mm of a measured point within which the surface counts as measured.

    Returns
    -------
    dict
        Content, ready for JSON; lengths in mm, times in s.
    """
    contours = found.contours
    return {
        "units": {"length": "mm", "time": "s"},
        "space": "world of the sweep, written as LPS",
        "frames": {
            "recorded": len(sweep.images) + sweep.frames_dropped,
            "with_pose": len(posed.kept),
            "dropped": dict(posed.dropped),
            "with_vessel": len(np.unique(contours.frame_index)),
        },
        "mask_check": mask_record(found, posed.kept),
        "contours": {
            "contours": len(np.unique(contours.contour_index)),
            "open_contours": len(np.unique(contours.contour_index[contours.is_open])),
            "points": len(contours),
        },
        "removed_points": dict(found.removed),
        "points": len(found.cloud),
        "coverage": _coverage(found, near_mm),
        "surface": surface_record(found, posed.kept),
        "quality": asdict(mesh_quality(found.surface)),
        "smoothing": {
            "volume_change": found.smoothed.volume_change,
            "moved_max_mm": found.smoothed.moved_max_mm,
        },
        "centerline": _centerline(found),
        "seconds": {**found.seconds, "total": sum(found.seconds.values())},
    }


def _coverage(found: Reconstructed, near_mm: float) -> dict[str, float]:
    """How much of the sweep shows the vessel, how wide its gaps are, and how much of the surface was measured."""
    steps_mm = steps_along(found)[1]
    samples_mm = found.surface.sample(SAMPLES, np.random.default_rng(0))
    apart_mm = SurfaceDistance(found.cloud.points_mm)(samples_mm)
    fit_mm = SurfaceDistance(found.surface)(found.cloud.points_mm)
    shown = len(np.unique(found.contours.frame_index))
    return {
        "frames_share": shown / len(found.contours.world_A_pixel),
        "frame_step_mm_median": float(np.median(steps_mm)) if len(steps_mm) else 0.0,
        "frame_step_mm_max": float(steps_mm.max(initial=0.0)),
        "near_mm": near_mm,
        "surface_near_points": float((apart_mm <= near_mm).mean()),
        "points_near_surface": float((fit_mm <= near_mm).mean()),
        "points_to_surface_mm_median": float(np.median(fit_mm)),
        "points_to_surface_mm_p95": float(np.percentile(fit_mm, 95)),
    }


def _centerline(found: Reconstructed) -> dict[str, Any]:
    if found.centerline is None:
        return {"refused": found.refusal}
    radius_mm = np.concatenate([line.radius_mm for line in found.centerline.lines])
    return {
        "lines": len(found.centerline.lines),
        "lengths_mm": [line.length_mm for line in found.centerline.lines],
        "radius_min_mm": float(radius_mm.min()),
        "radius_median_mm": float(np.median(radius_mm)),
        "radius_max_mm": float(radius_mm.max()),
    }


def cases(found: Reconstructed, posed: PosedFrames, sweep: TrackedSweep) -> pd.DataFrame:
    """Tabulate the frames with a pose.

    Parameters
    ----------
    found : Reconstructed
        Reconstruction.
    posed : PosedFrames
        Frames with a pose.
    sweep : TrackedSweep
        Tracked sweep.

    Returns
    -------
    pandas.DataFrame
        One row per frame: why its mask was rejected (empty: it was not), by what factor it exceeded its limit
        (``excess``), its contours, and its points before and after the filters.
    """
    import pandas as pd

    count = len(posed.kept)
    first = np.unique(found.contours.contour_index, return_index=True)[1]
    return pd.DataFrame(
        {
            "frame": posed.kept,
            "time_s": sweep.image_times_s[posed.kept],
            "rejected": found.checked.reason,
            "excess": found.checked.excess,
            "speck_removed": found.checked.specks > 0,
            "contours": np.bincount(found.contours.frame_index[first], minlength=count),
            "points": np.bincount(found.contours.frame_index, minlength=count),
            "points_left": np.bincount(found.cloud.frame_index, minlength=count),
        }
    )


def metrics(report: Mapping[str, Any]) -> dict[str, float]:
    """Compute the scalars for the tracker.

    Parameters
    ----------
    report : Mapping[str, Any]
        Content that ``record`` returns.

    Returns
    -------
    dict
        Scalars by name; those of a missing centerline are NaN.
    """
    frames, line, quality = report["frames"], report["centerline"], report["quality"]
    refused = "refused" in line
    return {
        "frames_with_pose": float(frames["with_pose"]),
        "frames_with_vessel": float(frames["with_vessel"]),
        "frames_dropped": float(count_frames(frames["dropped"])),
        **numbers(report["mask_check"], report["surface"]),
        "points": float(report["points"]),
        **{f"removed_{name}": float(count) for name, count in report["removed_points"].items()},
        **{
            name: float(report["coverage"][name])
            for name in ("frames_share", "surface_near_points", "points_near_surface")
        },
        **{name: float(quality[name]) for name in ("triangles", "open_ends", "holes", "volume_mm3")},
        **{name: float(quality[name]) for name in ("watertight", "manifold", "oriented")},
        "volume_change": report["smoothing"]["volume_change"],
        "centerline_lines": float("nan") if refused else float(line["lines"]),
        "centerline_length_mm": float("nan") if refused else float(sum(line["lengths_mm"])),
        **{f"{stage}_s": seconds for stage, seconds in report["seconds"].items()},
    }


def table(report: Mapping[str, Any]) -> pd.DataFrame:
    """Summarise the reconstruction in a few lines.

    Parameters
    ----------
    report : Mapping[str, Any]
        Content that ``record`` returns.

    Returns
    -------
    pandas.DataFrame
        Columns ``what`` and ``value``.
    """
    import pandas as pd

    frames, contours, quality, line = (report[key] for key in ("frames", "contours", "quality", "centerline"))
    removed = ", ".join(f"{count} by {name}" for name, count in report["removed_points"].items()) or "none"
    volume = f"{quality['volume_mm3']:.1f} mm3, changed by {report['smoothing']['volume_change']:+.2%} in smoothing"
    ends = f"{counted(quality['open_ends'], 'open end')}, {counted(quality['holes'], 'hole')}"
    triangles, pieces = counted(quality["triangles"], "triangle"), counted(quality["pieces"], "piece")
    lines = [
        ("frames", f"{frames['with_vessel']} with the vessel of {frames['with_pose']} with a pose"),
        ("frames dropped", describe_dropped(frames["dropped"])),
        ("masks left out", _left_out(report["mask_check"])),
        (
            "contours",
            f"{contours['contours']}, {contours['open_contours']} of them cut by the picture's edge",
        ),
        ("points", f"{report['points']} of {contours['points']}; left out: {removed}"),
        ("surface", f"{triangles} in {pieces}, {ends}"),
        (
            "left out",
            f"{report['surface']['area_share_left_out']:.1%} of the area in "
            f"{counted(report['surface']['pieces_left_out'], 'piece')}; "
            f"{counted(len(report['surface']['gaps']), 'gap')}, {report['surface']['gap_share']:.1%} of the way",
        ),
        ("volume", volume),
    ]
    if "refused" not in line:
        lengths = ", ".join(f"{length:.1f}" for length in line["lengths_mm"])
        lines.append(("centerline", f"{counted(line['lines'], 'line')} of {lengths} mm"))
    seconds = ", ".join(f"{stage} {value:.2f} s" for stage, value in report["seconds"].items())
    return pd.DataFrame([*lines, ("time", seconds)], columns=["what", "value"])


def _left_out(masks: Mapping[str, Any]) -> str:
    found = ", ".join(
        f"{count} by {reason}" for reason, count in masks["rejected_by_reason"].items() if count
    )
    return f"{found or 'none'}; {len(masks['empty_between_others'])} empty between others"


def remarks(found: Reconstructed, report: Mapping[str, Any]) -> tuple[str, ...]:
    """State what a user has to know of the reconstruction.

    Parameters
    ----------
    found : Reconstructed
        Reconstruction.
    report : Mapping[str, Any]
        Content that ``record`` returns.

    Returns
    -------
    tuple of str
        Sentences.
    """
    frames, quality, coverage = (report[key] for key in ("frames", "quality", "coverage"))
    findings = [
        f"{frames['with_vessel']} of {frames['with_pose']} frames with a pose show the vessel; the surface has "
        f"{quality['triangles']} triangles and a measured point within {coverage['near_mm']:g} mm on "
        f"{coverage['surface_near_points']:.1%} of its area."
    ]
    if coverage["points_near_surface"] < MAX_POINTS_NEAR:
        findings.append(
            f"{1 - coverage['points_near_surface']:.1%} of the points lie farther than {coverage['near_mm']:g} mm from "
            f"the surface: they belong to pieces that were left out, or to none."
        )
    findings += sentences(report["mask_check"], report["surface"])
    if quality["holes"]:
        findings.append(f"The surface has {counted(quality['holes'], 'hole')} in its wall.")
    if not (quality["manifold"] and quality["oriented"]):
        findings.append("The surface crosses or doubles itself: what lies inside is not certain everywhere.")
    if found.centerline is None:
        findings.append(f"There is no centerline: {found.refusal}.")
    return tuple(findings)


def scene(found: Reconstructed, report: Mapping[str, Any], name: str) -> Scene:
    """Make the page: cloud, surface and centerline in the sweep's world frame.

    Parameters
    ----------
    found : Reconstructed
        Reconstruction.
    report : Mapping[str, Any]
        Content that ``record`` returns.
    name : str
        Name of the sweep in the title.

    Returns
    -------
    Scene
        The scene.
    """
    layers: list[Layer] = [
        SurfaceLayer("surface", found.surface),
        CloudLayer("points", found.cloud.points_mm, shown=False),
    ]
    if found.centerline is not None:
        layers.append(LineLayer.of("centerline", found.centerline))
    return Scene(layers, f"Reconstruction of {name}", remarks(found, report), space="world")
