"""A family of vessels drawn at random: curvature, calibre, branches, flattening, stenosis."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from registration.phantom.shapes import VesselLine, spline_line

HALF_LENGTH_MM = 42.0
TEST_SEEDS_FROM = 1000


def draw_lines(seed: int) -> tuple[VesselLine, ...]:
    """Draw the vessel lines of one anatomy: a trunk with a taper and up to two branches.

    Radii of the trunk lie between 2.2 and 5 mm; one in two has a stenosis that takes 20 to 60 % of the
    diameter over some 8 mm.

    Parameters
    ----------
    seed : int
        Seed of the anatomy: below 1000 for development, from 1000 on for tests.

    Returns
    -------
    tuple of VesselLine
        The trunk, then its branches, in the ct frame.
    """
    rng = np.random.default_rng([seed, 40])
    radius_mm = rng.uniform(2.2, 5.0)
    widening = 1.0 + max(0.0, rng.normal(0.0, 0.25))
    trunk = _trunk(radius_mm, widening, rng)
    branches = [_branch(trunk, radius_mm, rng) for _ in range(rng.integers(0, 3))]
    if rng.random() < 0.5:
        trunk = _narrowed(trunk, rng)
    return trunk, *branches


def _trunk(radius_mm: float, widening: float, rng: np.random.Generator) -> VesselLine:
    z_mm = np.linspace(-HALF_LENGTH_MM, HALF_LENGTH_MM, 6)
    strength_mm = rng.uniform(1.5, 5.0)
    sideways_mm = strength_mm * rng.uniform(-1, 1, 6)
    deep_mm = np.clip(0.7 * strength_mm * rng.uniform(-1, 1, 6) + rng.uniform(-1, 6), -4.0, 9.0)
    taper = 1.0 + rng.uniform(-0.2, 0.2) * z_mm / HALF_LENGTH_MM
    return spline_line(np.column_stack([sideways_mm, deep_mm, z_mm]), radius_mm * taper, np.full(6, widening))


def _branch(trunk: VesselLine, radius_mm: float, rng: np.random.Generator) -> VesselLine:
    """A line that leaves the trunk in its middle third, up or down, and drifts to one side."""
    count = len(trunk.points_mm)
    root_mm = trunk.points_mm[int(rng.uniform(0.35, 0.65) * count)]
    upwards = 1.0 if rng.random() < 0.5 else -1.0
    run_mm = upwards * HALF_LENGTH_MM - root_mm[2]
    side_mm = rng.choice([-1.0, 1.0]) * rng.uniform(8.0, 13.0)
    depth_mm = rng.uniform(-4.0, 5.0)
    shares = np.array([0.0, 0.3, 0.65, 1.0])
    drift = np.array([0.0, 0.45, 0.85, 1.0])
    controls_mm: Float64[np.ndarray, "4 3"] = root_mm + np.column_stack(
        [side_mm * drift, np.clip(depth_mm * drift, -6.0 - root_mm[1], None), run_mm * shares]
    )
    return spline_line(controls_mm, radius_mm * rng.uniform(0.5, 0.8) * np.array([1.0, 1.0, 0.95, 0.85]))


def _narrowed(line: VesselLine, rng: np.random.Generator) -> VesselLine:
    z_mm = line.points_mm[:, 2]
    place_mm, share = rng.uniform(-0.6, 0.6) * HALF_LENGTH_MM, rng.uniform(0.2, 0.6)
    factor = 1.0 - share * np.exp(-0.5 * ((z_mm - place_mm) / 3.5) ** 2)
    return VesselLine(line.points_mm, line.radius_mm * factor, line.widening)
