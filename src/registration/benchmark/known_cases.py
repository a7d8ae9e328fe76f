"""Cases with a known deformation: a sampling of the model's wall, and another of the wall as it was displaced."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.benchmark.cases import CaseTruth
from registration.benchmark.initial_offset import draw_start
from registration.benchmark.known_deformations import DEFORMATIONS, NONE, draw_known
from registration.benchmark.known_vessels import KnownVessel
from registration.geometry.rigid_fit import kabsch

COVERAGES = (0.6, 0.8, 1.0)
SIZES_MM = (1.5, 3.0, 5.0)
NOISE_MM = 0.3
MOVING_POINTS, FIXED_POINTS = 3000, 5000
# Points of the wall by which its rigid motion and the shares of it are told.
WALL_POINTS = 4000


@dataclass(frozen=True)
class KnownSpec:
    """Specification of a case; the same one always gives the same case.

    Parameters
    ----------
    vessel : str
        Name of the vessel.
    deformation : str
        Name of the deformation.
    size_mm : float
        Its size in mm.
    coverage : float
        Share of the wall that is swept, up to 1.
    number : int
        Number of the case, which is its seed.
    """

    vessel: str
    deformation: str
    size_mm: float
    coverage: float
    number: int


@dataclass(frozen=True)
class KnownCase:
    """Both clouds of a case and its truth.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Swept points in a frame of their own, with noise, in mm.
    fixed_mm : ndarray, shape (n, 3)
        Points of the model's wall in mm.
    truth : CaseTruth
        Pose, interior targets, which of them were swept, and where the material of each lies.
    largest_mm : float
        Largest displacement of the wall in mm, its rigid part taken out.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    fixed_mm: Float64[np.ndarray, "n 3"]
    truth: CaseTruth
    largest_mm: float


def known_specs(
    vessels: Sequence[str],
    deformations: Sequence[str] = DEFORMATIONS,
    coverages: Sequence[float] = COVERAGES,
) -> Iterator[KnownSpec]:
    """List cases: each vessel in each deformation and coverage; the sizes go round.

    Parameters
    ----------
    vessels, deformations : sequence of str
        Names.
    coverages : sequence of float
        Shares of the wall that are swept.

    Yields
    ------
    KnownSpec
        The cases, in a fixed order.
    """
    number = 0
    for place, vessel in enumerate(vessels):
        for row, deformation in enumerate(deformations):
            for column, coverage in enumerate(coverages):
                size_mm = 0.0 if deformation == NONE else SIZES_MM[(place + row + column) % len(SIZES_MM)]
                yield KnownSpec(vessel, deformation, size_mm, coverage, number)
                number += 1


def build_known(spec: KnownSpec, vessel: KnownVessel) -> KnownCase:
    """Make one case.

    The wall is displaced, cropped to a stretch along the vessel that holds the share of it that is swept, sampled apart
    from the model's own sampling, and moved to a random pose.

    Parameters
    ----------
    spec : KnownSpec
        Which case.
    vessel : KnownVessel
        Its vessel.

    Returns
    -------
    KnownCase
        The case.
    """
    rng = np.random.default_rng([spec.number, 90])
    wall_mm = vessel.surface.sample(WALL_POINTS, rng)
    main = vessel.centerline.lines[0]
    moved = draw_known(spec.deformation, main.points_mm, main.radius_mm, wall_mm, spec.size_mm, rng)
    window_mm = _window_mm(vessel.along_mm(wall_mm), spec.coverage, rng)
    # Enough for the share that is swept, and for the ends that are left out.
    material_mm = vessel.surface.sample(round(2 * MOVING_POINTS / spec.coverage), rng)
    seen = _within(vessel.along_mm(material_mm), window_mm) & vessel.beside_line(material_mm)
    swept_mm = moved(material_mm[seen][:MOVING_POINTS])
    swept_mm = swept_mm + NOISE_MM * rng.standard_normal(swept_mm.shape)
    start = draw_start(swept_mm, rng)
    fixed_T_swept = kabsch(moved(wall_mm), wall_mm)
    targets_mm = vessel.targets_mm(rng)
    truth = CaseTruth(
        name=f"{spec.vessel}_{spec.deformation}_{round(100 * spec.coverage)}",
        anatomy=spec.vessel,
        kind=spec.deformation,
        place="",
        fixed_T_moving=transforms.compose(fixed_T_swept, transforms.invert_rigid(start.moved_T_true)),
        targets_mm=targets_mm,
        covered=_within(vessel.along_mm(targets_mm), window_mm),
        outlier=np.zeros(len(swept_mm), dtype=bool),
        angle_deg=start.angle_deg,
        translation_mm=start.translation_mm,
        block="known",
        displacement_mm=transforms.apply(fixed_T_swept, moved(targets_mm)) - targets_mm,
    )
    left_mm = transforms.apply(fixed_T_swept, moved(wall_mm)) - wall_mm
    return KnownCase(
        moving_mm=transforms.apply(start.moved_T_true, swept_mm),
        fixed_mm=vessel.surface.sample(FIXED_POINTS, rng),
        truth=truth,
        largest_mm=float(np.linalg.norm(left_mm, axis=1).max()),
    )


def _window_mm(along_mm: np.ndarray, coverage: float, rng: np.random.Generator) -> tuple[float, float]:
    """A stretch along the vessel that holds a share of its wall; without bounds where all of it is swept."""
    if coverage >= 1.0:
        return -np.inf, np.inf
    first = rng.uniform(0.0, 1.0 - coverage)
    low_mm, high_mm = np.quantile(along_mm, [first, first + coverage])
    return float(low_mm), float(high_mm)


def _within(along_mm: np.ndarray, window_mm: tuple[float, float]) -> np.ndarray:
    return np.asarray((along_mm >= window_mm[0]) & (along_mm <= window_mm[1]))
