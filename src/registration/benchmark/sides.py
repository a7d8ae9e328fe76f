"""Both sides of a case, before a start is drawn: one way to make them for each block of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.benchmark.blocks import DEFORMING, NOISE, OVERLAP, SIZES_MM, WRONG_VESSEL, CaseSpec
from registration.benchmark.cases import UNDEFORMED
from registration.benchmark.deformed_sweep import deformed_sweep
from registration.benchmark.partial_overlap import overlapping
from registration.benchmark.scenarios import PLACES, Kind, kind_named
from registration.benchmark.sweep_simulation import Swept, seen, simulated, sweep_settings, swept
from registration.errors import InputError
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.phantom.anatomy import anatomy_of
from registration.phantom.scan import model_of
from registration.phantom.settings import RANDOM

NOISE_MM = 1.0
# Cases of one block and anatomy show the same sweep, of which each takes its part.
SWEEP = 0
COMMON = {"common40": 0.4, "common50": 0.5, "common60": 0.6}
STARTED = "_started"
MIRROR = np.array([-1.0, 1.0, 1.0])
VIEWS = {
    "whole": Kind("whole"),
    "piece40": Kind("piece40", 0.4, PLACES),
    "piece40_end": Kind("piece40_end", 0.4, ("start", "end")),
    "piece40_middle": Kind("piece40_middle", 0.4),
}


@dataclass(frozen=True)
class Sides:
    """Both sides of a case.

    Parameters
    ----------
    found : Swept
        Sweep, its points and the model.
    outlier_share : float, optional
        Share of the moving points that become outliers.
    moving_noise_mm, fixed_noise_mm : float, optional
        Standard deviation per coordinate in mm of the noise that is added to the points of either side.
    same_vessel : bool, optional
        Whether the model is that of the vessel that was swept.
    moving_centerline_mm, fixed_centerline_mm : ndarray, shapes (p, 3) and (q, 3), or None, optional
        Coarse centerlines of both sides in the ct frame in mm.
    started : bool, optional
        Whether the pose is roughly known.
    """

    found: Swept
    outlier_share: float = 0.0
    moving_noise_mm: float = 0.0
    fixed_noise_mm: float = 0.0
    same_vessel: bool = True
    moving_centerline_mm: Float64[np.ndarray, "p 3"] | None = None
    fixed_centerline_mm: Float64[np.ndarray, "q 3"] | None = None
    started: bool = False


def make_sides(spec: CaseSpec, number: int, rng: np.random.Generator) -> Sides:
    """Make both sides of a case.

    Parameters
    ----------
    spec : CaseSpec
        Which case; its block and kind are known ones.
    number : int
        Number of the sweep, from 0.
    rng : numpy.random.Generator
        Random stream of the case.

    Returns
    -------
    Sides
        Both sides.
    """
    return _MAKERS[spec.block](spec, number, rng)


def _undeformed(spec: CaseSpec, number: int, rng: np.random.Generator) -> Sides:
    kind = kind_named(spec.kind)
    return Sides(swept(spec.anatomy, spec.seed, number, kind, rng), kind.outlier_share)


def _deforming(spec: CaseSpec, number: int, rng: np.random.Generator) -> Sides:
    motion, size = spec.kind.split("_")
    return Sides(deformed_sweep(spec.anatomy, spec.seed, number, motion, SIZES_MM[size], rng))


def _wrong_vessel(spec: CaseSpec, _: int, rng: np.random.Generator) -> Sides:
    """A sweep with the model of another anatomy, with the mirror image of its own, or, as a control, with its own."""
    which, view = spec.kind.split("_", 1)
    sweep, lines = simulated(sweep_settings(RANDOM, spec.seed), SWEEP)
    found = seen(sweep, lines, VIEWS[view], rng)
    if which == "own":
        return Sides(found)
    if which == "mirror":
        model, lines = _mirrored(sweep.model, lines)
    else:
        if spec.model_seed is None:
            raise InputError(f"model_seed: expected the anatomy whose model {spec.name} has, received none")
        settings = sweep_settings(RANDOM, spec.model_seed)
        model, other = model_of(settings), anatomy_of(settings).centerline
        lines = lines if other is None else other
    return Sides(replace(found, sweep=replace(sweep, model=model), lines=lines), same_vessel=False)


def _mirrored(model: Mesh, lines: Centerline) -> tuple[Mesh, Centerline]:
    """The mirror image from left to right; its triangles are wound the other way, so that normals point outwards."""
    return Mesh(model.vertices_mm * MIRROR, model.triangles[:, ::-1].copy()), Centerline(
        tuple(Polyline(line.points_mm * MIRROR, line.radius_mm) for line in lines.lines)
    )


def _overlap(spec: CaseSpec, _: int, rng: np.random.Generator) -> Sides:
    made = overlapping(spec.seed, SWEEP, COMMON[spec.kind.removesuffix(STARTED)], rng)
    return Sides(
        made.found,
        moving_centerline_mm=made.moving_centerline_mm,
        fixed_centerline_mm=made.fixed_centerline_mm,
        started=spec.kind.endswith(STARTED),
    )


def _noise(spec: CaseSpec, _: int, rng: np.random.Generator) -> Sides:
    found = swept(spec.anatomy, spec.seed, SWEEP, VIEWS["whole"], rng)
    both = spec.kind == "both_noise"
    return Sides(found, moving_noise_mm=NOISE_MM, fixed_noise_mm=NOISE_MM if both else 0.0)


_MAKERS = {
    UNDEFORMED: _undeformed,
    DEFORMING: _deforming,
    WRONG_VESSEL: _wrong_vessel,
    OVERLAP: _overlap,
    NOISE: _noise,
}
