"""Cases in which neither side holds the other: each shows about two thirds of the vessel, in a style of its own.

Where the field of view ends is a height along the vessel. Both sides show the same share of it, so that the share of
either that the other shows too is the one that the kind names. The styles differ: size of voxels, threshold and
smoothing of the model; smoothing, thinning and a bias of the wall of the sweep.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.benchmark.scenarios import Kind
from registration.benchmark.sweep_simulation import (
    ContourStyle,
    Swept,
    between,
    seen,
    simulated,
    sweep_settings,
)
from registration.geometry.point_cloud import take
from registration.geometry.shapes import Centerline, Mesh
from registration.phantom.anatomy import anatomy_of
from registration.phantom.conditions import CtScan
from registration.phantom.ct import scan_volume, segment_volume
from registration.phantom.settings import RANDOM
from registration.reconstruction.taubin import TaubinSmoothing

# What a segmentation may be like: values of which one is drawn, and ranges.
VOXELS_MM, SLICES_MM, BLURS_MM, SMOOTHINGS = (0.7, 1.0, 1.4), (1.0, 1.5, 2.5), (0.6, 1.0), (0, 10)
THRESHOLDS = (0.4, 0.6)
CONTOUR_SMOOTHINGS_PX, CONTOUR_VOXELS_MM, WALL_BIAS_MM = (1.0, 2.5), (0.4, 0.8), (-0.4, 0.6)
# A coarse centerline has a point every so often, off by so much.
LINE_STEP_MM, LINE_NOISE_MM = 5.0, 0.7


@dataclass(frozen=True)
class Overlap:
    """A sweep and a model that share a part of the vessel.

    Parameters
    ----------
    found : Swept
        Sweep without what lies beyond its field of view, with the cut model.
    moving_centerline_mm, fixed_centerline_mm : ndarray, shapes (p, 3) and (q, 3)
        Coarse points on the centerline of what either side shows, both in the ct frame in mm.
    """

    found: Swept
    moving_centerline_mm: Float64[np.ndarray, "p 3"]
    fixed_centerline_mm: Float64[np.ndarray, "q 3"]


def overlapping(seed: int, number: int, common: float, rng: np.random.Generator) -> Overlap:
    """Simulate a sweep and a model of a random anatomy that overlap in part.

    Parameters
    ----------
    seed : int
        Seed of the anatomy.
    number : int
        Number of the sweep, from 0.
    common : float
        Share of either side that the other shows too, above 0 and below 1.
    rng : numpy.random.Generator
        Random stream of styles, sides and centerlines.

    Returns
    -------
    Overlap
        Both sides.
    """
    settings = sweep_settings(RANDOM, seed)
    sweep, lines = simulated(settings, number)
    style = ContourStyle(float(rng.choice(CONTOUR_SMOOTHINGS_PX)), float(rng.choice(CONTOUR_VOXELS_MM)))
    found = seen(sweep, lines, Kind("whole"), rng, style)
    z_mm, model_z_mm = found.cloud_mm[:, 2], sweep.model.vertices_mm[:, 2]
    low_mm, high_mm = max(z_mm.min(), model_z_mm.min()), min(z_mm.max(), model_z_mm.max())
    # Two sides of one length that hold the vessel together, and have ``common`` of it in common.
    length_mm = (high_mm - low_mm) / (2.0 - common)
    views = [(low_mm, low_mm + length_mm), (high_mm - length_mm, high_mm)]
    moving_view, fixed_view = views if rng.random() < 0.5 else views[::-1]
    bias_mm = float(rng.uniform(*WALL_BIAS_MM))
    model = _model(seed, fixed_view, rng)
    return Overlap(
        replace(_within(found, moving_view, bias_mm), sweep=replace(sweep, model=model)),
        _coarse(between(lines, *moving_view), rng),
        _coarse(between(lines, *fixed_view), rng),
    )


def _within(found: Swept, view_mm: tuple[float, float], bias_mm: float) -> Swept:
    """A sweep without the points beyond a field of view, and with its wall moved outwards."""
    z_mm = found.cloud_mm[:, 2]
    cloud = take(found.cloud, np.flatnonzero((z_mm >= view_mm[0]) & (z_mm <= view_mm[1])))
    cloud = replace(cloud, points_mm=cloud.points_mm + bias_mm * cloud.normals)
    return Swept(found.sweep, found.place, np.unique(cloud.frame_index), cloud, found.lines, None)


def _model(seed: int, view_mm: tuple[float, float], rng: np.random.Generator) -> Mesh:
    """The part of a model within a field of view, segmented in a style that is drawn."""
    scan = CtScan(
        voxel_mm=float(rng.choice(VOXELS_MM)),
        slice_mm=float(rng.choice(SLICES_MM)),
        blur_mm=float(rng.choice(BLURS_MM)),
    )
    level_hu = float(rng.uniform(*THRESHOLDS)) * scan.contrast_hu
    smoothing = TaubinSmoothing(iterations=int(rng.choice(SMOOTHINGS)), volume_tolerance=0.2)
    anatomy = anatomy_of(sweep_settings(RANDOM, seed))
    volume_hu, origin_mm, spacing_mm = scan_volume(anatomy, scan, rng)
    first, last = (round((z_mm - origin_mm[2]) / spacing_mm[2]) for z_mm in view_mm)
    slices = slice(max(first, 0), min(last + 1, volume_hu.shape[2]))
    return smoothing(segment_volume(volume_hu, origin_mm, spacing_mm, level_hu, slices)).mesh


def _coarse(lines: Centerline, rng: np.random.Generator) -> np.ndarray:
    points_mm = np.concatenate(
        [
            line.at(
                np.arange(rng.uniform(0.0, min(LINE_STEP_MM, line.length_mm)), line.length_mm, LINE_STEP_MM)
            )
            for line in lines.lines
        ]
    )
    return points_mm + LINE_NOISE_MM * rng.standard_normal(points_mm.shape)
