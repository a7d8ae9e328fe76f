"""A second pose is found where there is one by construction, and not where every pose differs."""

from __future__ import annotations

import numpy as np
import pytest
from benchmark_cases import drawn_case
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.benchmark.alternative_pose import second_pose
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.symmetric_shapes import HALF_LENGTH_MM
from registration.geometry.shapes import Mesh


def tube(low_mm: float, high_mm: float, around: int = 64) -> Mesh:
    """An open straight tube of 4 mm radius along z."""
    z_mm = np.linspace(low_mm, high_mm, 40)
    angle = 2 * np.pi * np.arange(around) / around
    rim = 4.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points_mm = np.concatenate([np.column_stack([rim, np.full(around, z)]) for z in z_mm])
    row, column = np.meshgrid(np.arange(39), np.arange(around), indexing="ij")
    a, b = row * around + column, row * around + (column + 1) % around
    quads = [np.stack([a, b, b + around], axis=-1), np.stack([a, b + around, a + around], axis=-1)]
    return Mesh(points_mm, np.concatenate(quads).reshape(-1, 3).astype(np.int64))


def straight(noise_mm: float = 0.1) -> tuple[BenchmarkCase, CaseTruth]:
    """The middle 40 mm of a straight tube."""
    case, truth = drawn_case()
    rng = np.random.default_rng(5)
    moving_mm = tube(-20.0, 20.0).sample(300, rng) + noise_mm * rng.normal(size=(300, 3))
    fixed = tube(-HALF_LENGTH_MM, HALF_LENGTH_MM)
    own = {
        "moving_mm": moving_mm, "fixed": fixed, "fixed_mm": fixed.sample(500, rng),
        "moving_frame": (np.argsort(np.argsort(moving_mm[:, 2])) // 10).astype(np.int64),
    }  # fmt: skip
    targets_mm = np.outer(np.linspace(-40, 40, 80), [0.0, 0.0, 1.0])
    told = vars(truth) | {"fixed_T_moving": np.eye(4), "targets_mm": targets_mm}
    return BenchmarkCase(**(vars(case) | own)), CaseTruth(**told)


def test_a_straight_tube_hides_other_poses() -> None:
    found = second_pose(*straight())
    assert found is not None
    assert found.hidden


def test_a_bent_tube_with_a_bulge_hides_none() -> None:
    case, truth = drawn_case()
    rng = np.random.default_rng(3)
    noisy = BenchmarkCase(**(vars(case) | {"moving_mm": case.moving_mm + 0.1 * rng.normal(size=(300, 3))}))
    found = second_pose(noisy, truth)
    assert found is None or (not found.hidden and found.gap > 3)


def test_a_candidate_of_the_method_is_tried_too() -> None:
    """A slide beyond those that are tried by themselves is found when the method names it."""
    case, truth = straight()
    turned = transforms.compose(
        transforms.translation((0.0, 0.0, 17.0)),
        transforms.rotate_about(Rotation.from_rotvec([0.0, np.pi, 0.0]), np.zeros(3)),
    )
    found = second_pose(case, truth, [turned])
    assert found is not None
    assert found.gap <= second_pose(case, truth).gap  # type: ignore[union-attr]


def test_its_error_is_that_at_the_targets() -> None:
    case, truth = straight(noise_mm=0.02)
    found = second_pose(case, truth)
    assert found is not None
    apart_mm = np.linalg.norm(
        transforms.apply(found.fixed_T_moving, truth.targets_mm) - truth.targets_mm, axis=1
    )
    assert found.tre_mm == pytest.approx(np.sqrt((apart_mm**2).mean()))
