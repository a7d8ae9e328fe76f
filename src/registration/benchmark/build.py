"""Building the cases: points of a sweep and of the model from CT, and a random start for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.benchmark.blocks import BLOCKS, KIND_NAMES, CaseSpec
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.deformed_sweep import material_truth
from registration.benchmark.initial_offset import (
    DrawnPoints,
    Start,
    draw_points,
    draw_start,
    random_direction,
)
from registration.benchmark.sides import Sides, make_sides
from registration.errors import InputError

MOVING_POINTS, FIXED_POINTS = 3000, 5000
# A pose that is roughly known is turned by at most, and moved by so much.
START_DEG, START_MM = 12.0, (2.0, 6.0)


def build_case(spec: CaseSpec) -> tuple[BenchmarkCase, CaseTruth]:
    """Make one case and its truth in memory, in half a second to some seconds.

    Parameters
    ----------
    spec : CaseSpec
        Which case.

    Returns
    -------
    case : BenchmarkCase
        What a method is given.
    truth : CaseTruth
        Pose, targets and symmetry of the case.

    Raises
    ------
    InputError
        If the block or the kind is unknown.
    """
    if spec.block not in BLOCKS:
        raise InputError(f"block: expected one of {', '.join(BLOCKS)}, received {spec.block!r}")
    kinds = KIND_NAMES[spec.block]
    if spec.kind not in kinds:
        raise InputError(f"kind: expected one of {', '.join(kinds)}, received {spec.kind!r}")
    number = kinds.index(spec.kind)
    entropy = [spec.seed, 60 + BLOCKS.index(spec.block), number]
    rng = np.random.default_rng(entropy if spec.model_seed is None else [*entropy, spec.model_seed])
    sides = make_sides(spec, number, rng)
    drawn = draw_points(sides.found.cloud_mm, MOVING_POINTS, sides.outlier_share, rng)
    start = draw_start(drawn.points_mm, rng)
    case = _case(spec, sides, drawn, start, rng)
    truth = _truth(spec, sides, drawn, start)
    if sides.started:
        case = replace(case, initial=_rough(truth.fixed_T_moving, case.moving_mm, rng))
    return case, truth


def _case(
    spec: CaseSpec, sides: Sides, drawn: DrawnPoints, start: Start, rng: np.random.Generator
) -> BenchmarkCase:
    found, model = sides.found, sides.found.sweep.model
    moving_T_world = transforms.compose(start.moved_T_true, found.sweep.ct_T_world)
    line_mm = sides.moving_centerline_mm
    return BenchmarkCase(
        name=spec.name,
        anatomy=spec.anatomy,
        kind=spec.kind,
        moving_mm=_noisy(transforms.apply(start.moved_T_true, drawn.points_mm), sides.moving_noise_mm, rng),
        moving_normals=found.cloud.normals[drawn.index] @ moving_T_world[:3, :3].T,
        moving_frame=found.cloud.frame_index[drawn.index],
        fixed=model,
        fixed_mm=_noisy(model.sample(FIXED_POINTS, rng), sides.fixed_noise_mm, rng),
        moving_centerline_mm=None if line_mm is None else transforms.apply(start.moved_T_true, line_mm),
        fixed_centerline_mm=sides.fixed_centerline_mm,
    )


def _truth(spec: CaseSpec, sides: Sides, drawn: DrawnPoints, start: Start) -> CaseTruth:
    found, displacement_mm = sides.found, None
    fixed_T_moving = transforms.invert_rigid(start.moved_T_true)
    if found.deformed:
        fixed_T_swept, displacement_mm = material_truth(found)
        fixed_T_moving = transforms.compose(fixed_T_swept, fixed_T_moving)
    return CaseTruth(
        name=spec.name,
        anatomy=spec.anatomy,
        kind=spec.kind,
        place=found.place,
        fixed_T_moving=fixed_T_moving if sides.same_vessel else np.full((4, 4), np.nan),
        targets_mm=found.targets_mm,
        covered=found.covered if sides.same_vessel else np.zeros(len(found.targets_mm), dtype=bool),
        outlier=drawn.outlier,
        angle_deg=start.angle_deg,
        translation_mm=start.translation_mm,
        symmetry=found.symmetry,
        block=spec.block,
        displacement_mm=displacement_mm,
        same_vessel=sides.same_vessel,
    )


def _noisy(points_mm: np.ndarray, noise_mm: float, rng: np.random.Generator) -> np.ndarray:
    """The points with noise; without any nothing is drawn, and the cases without noise stay what they are."""
    return points_mm + noise_mm * rng.standard_normal(points_mm.shape) if noise_mm else points_mm


def _rough(
    fixed_T_moving: Float64[np.ndarray, "4 4"], moving_mm: np.ndarray, rng: np.random.Generator
) -> Float64[np.ndarray, "4 4"]:
    """The true pose, turned about the cloud's centre and moved."""
    turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(0.0, START_DEG)) * random_direction(rng))
    centre_mm = transforms.apply(fixed_T_moving, moving_mm).mean(axis=0)
    shift_mm = rng.uniform(*START_MM) * random_direction(rng)
    return transforms.compose(
        transforms.translation(shift_mm), transforms.rotate_about(turn, centre_mm), fixed_T_moving
    )
