"""The steps of ICP held against scipy and results known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.rigid.icp.estimation import PointToPlane, PointToPoint, Symmetric, motion_jacobian
from registration.rigid.icp.pairs import Pairs


def pose(rotation_vector: list[float], translation_mm: list[float]) -> np.ndarray:
    return transforms.from_rotation(
        Rotation.from_rotvec(rotation_vector), np.array(translation_mm, dtype=float)
    )


def test_a_step_along_normals_is_newtons_on_a_box_corner() -> None:
    """Three planes at right angles, a pure translation: one step along the normals removes all of it."""
    grid = np.stack(np.meshgrid(np.arange(1.0, 9), np.arange(1.0, 9)), axis=-1).reshape(-1, 2)
    fixed = np.concatenate([np.insert(grid, axis, 0.0, axis=1) for axis in range(3)])
    normals = np.repeat(np.eye(3), len(grid), axis=0)[None]
    moved = (fixed + np.array([0.2, -0.1, 0.3]))[None]
    pairs = Pairs(moved, fixed[None], normals, normals)
    for estimation in (PointToPlane(), Symmetric()):
        stepped = transforms.apply(estimation.motion(pairs, np.ones((1, len(fixed))))[0], moved[0])
        np.testing.assert_allclose(stepped, fixed, atol=1e-6)
        np.testing.assert_allclose(estimation.residuals_mm(pairs)[0], np.repeat([-0.2, 0.1, -0.3], 64))


def flat() -> Pairs:
    grid = np.stack(np.meshgrid(np.arange(12.0), np.arange(9.0), [0.0]), axis=-1).reshape(-1, 3)
    moved = (grid + np.array([0.3, 0.2, 0.4]))[None]
    return Pairs(moved, grid[None], np.tile([0.0, 0, 1], (1, len(grid), 1)))


def test_a_step_along_normals_leaves_free_directions_alone() -> None:
    """On one plane nothing says where to slide or how to turn within it: only the distance goes."""
    pairs = flat()
    step = PointToPlane().motion(pairs, np.ones(pairs.gap_mm.shape))
    np.testing.assert_allclose(step[0], transforms.translation((0.0, 0.0, -0.4)), atol=1e-9)


def test_damping_shortens_a_step_and_leaves_its_way() -> None:
    pairs = flat()
    damped = PointToPlane(damping=1.0).motion(pairs, np.ones(pairs.gap_mm.shape))[0]
    assert -0.4 < damped[2, 3] < -0.1
    np.testing.assert_allclose(damped[:3, :3], np.eye(3), atol=1e-9)


def test_a_step_is_no_longer_than_half_the_clouds_radius() -> None:
    pairs = flat()
    far = Pairs(pairs.moved_mm + np.array([0.0, 0, 500]), pairs.fixed_mm, pairs.normals)
    radius = np.sqrt(pairs.moved_mm[0].var(axis=0).sum())
    step = PointToPlane().motion(far, np.ones(pairs.gap_mm.shape))[0]
    assert step[2, 3] == pytest.approx(-0.5 * radius)


def test_a_symmetric_step_agrees_the_signs_of_the_normals() -> None:
    pairs = flat()
    moved_normals = (
        np.where(np.arange(pairs.moved_mm.shape[1]) % 2 == 0, 1.0, -1.0)[None, :, None] * pairs.normals
    )
    mixed = Pairs(pairs.moved_mm, pairs.fixed_mm, pairs.normals, moved_normals)
    np.testing.assert_allclose(Symmetric().residuals_mm(mixed), -0.4)


def test_the_jacobian_is_what_small_motions_do() -> None:
    rng = np.random.default_rng(9)
    points, normals = rng.normal(size=(2, 8, 3))
    jacobian = motion_jacobian(points, normals)
    for axis in range(3):
        turned = Rotation.from_rotvec(1e-6 * np.eye(3)[axis]).apply(points) - points
        np.testing.assert_allclose(jacobian[:, axis], (turned * normals).sum(axis=1) / 1e-6, atol=1e-5)
    np.testing.assert_array_equal(jacobian[:, 3:], normals)


def test_steps_along_normals_need_them() -> None:
    bare = Pairs(flat().moved_mm, flat().fixed_mm)
    weights = np.ones(bare.gap_mm.shape)
    with pytest.raises(InputError, match="pairs: expected normals of the fixed cloud"):
        PointToPlane().motion(bare, weights)
    with pytest.raises(InputError, match="pairs: expected normals of both clouds"):
        Symmetric().residuals_mm(flat())
    np.testing.assert_allclose(PointToPoint().residuals_mm(bare), np.sqrt(0.29))


@pytest.mark.parametrize("method", [PointToPlane, Symmetric])
def test_negative_damping_is_refused(method: type) -> None:
    with pytest.raises(InputError, match="damping: expected a number of at least 0"):
        method(damping=-0.1)


def trumpet(count: int = 900) -> tuple[np.ndarray, np.ndarray]:
    """Points of a vessel that opens ever faster, from 3 to 9 mm in radius over 60 mm, and its outward normals.

    A cone, which opens evenly, would be the same cone further along once it is grown: its slide stays open.
    """
    rng = np.random.default_rng(8)
    along, angle = rng.uniform(0, 60, count), rng.uniform(0, 2 * np.pi, count)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    slope = along / 300
    normals = (rim - slope[:, None] * [0, 0, 1.0]) / np.hypot(1, slope)[:, None]
    return (3 + along**2 / 600)[:, None] * rim + np.outer(along, [0.0, 0, 1]), normals


@pytest.mark.parametrize("kind", [PointToPlane, Symmetric])
def test_an_offset_of_the_walls_is_no_slide(kind: type[PointToPlane | Symmetric]) -> None:
    """Grown by 0.1 mm along its normals and shifted across: only the shift is to be undone."""
    points, normals = trumpet()
    grown = points + 0.1 * normals + np.array([0.05, -0.02, 0.0])
    pairs = Pairs(grown[None], points[None], normals[None], normals[None])
    weights = np.ones((1, len(points)))
    with_offset, without = (kind(offset=offset).motion(pairs, weights)[0] for offset in (True, False))
    np.testing.assert_allclose(with_offset[:3, 3], [-0.05, 0.02, 0], atol=2e-3)
    # Without it the trumpet is pushed along its axis: its mean slope is 0.1.
    assert abs(without[2, 3]) > 0.5
    np.testing.assert_allclose(kind(offset=True).residuals_mm(pairs)[0], 0, atol=0.07)
    assert np.abs(kind().residuals_mm(pairs)[0]).min() > 0.03
