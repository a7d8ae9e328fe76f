"""Frames: known answers, oblique and flipped axes, and every refusal."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError

QUARTER_ABOUT_Z = np.array([[0.0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]])


def oblique(seed: int = 0, count: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transforms.from_rotation(Rotation.random(count, rng=rng), rng.normal(scale=50, size=(count, 3)))


def test_apply_rotates_then_translates() -> None:
    moved = transforms.apply(QUARTER_ABOUT_Z, np.array([[1.0, 0, 0], [0, 2, 0]]))
    np.testing.assert_allclose(moved, [[10, 21, 30], [8, 20, 30]])
    np.testing.assert_allclose(transforms.apply(QUARTER_ABOUT_Z, np.array([1.0, 0, 0])), [10, 21, 30])


def test_compose_maps_through_the_rightmost_first() -> None:
    shift = transforms.translation((1.0, 0.0, 0.0))
    np.testing.assert_allclose(
        transforms.apply(transforms.compose(QUARTER_ABOUT_Z, shift), np.zeros(3)), [10, 21, 30]
    )
    np.testing.assert_allclose(
        transforms.apply(transforms.compose(shift, QUARTER_ABOUT_Z), np.zeros(3)), [11, 20, 30]
    )


def test_compose_broadcasts_a_stack_against_one() -> None:
    stack = oblique(count=4)
    chained = transforms.compose(QUARTER_ABOUT_Z, stack)
    for index in range(4):
        np.testing.assert_allclose(chained[index], QUARTER_ABOUT_Z @ stack[index])


def test_compose_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"^compose: expected at least one transform, received none$"):
        transforms.compose()


def test_invert_rigid_is_the_general_inverse() -> None:
    stack = oblique(1, 5)
    np.testing.assert_allclose(transforms.invert_rigid(stack), np.linalg.inv(stack), atol=1e-12)
    np.testing.assert_allclose(transforms.invert_rigid(QUARTER_ABOUT_Z)[:3, 3], [-20, 10, -30])


def test_invert_affine_undoes_shear_and_flip() -> None:
    affine = np.array([[-0.2, 0.01, 0, 5], [0, 0.3, 0.1, -7], [0, 0, 2, 9], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(transforms.invert_affine(affine) @ affine, np.eye(4), atol=1e-12)


def test_apply_each_pairs_the_ith_point_with_the_ith_transform() -> None:
    stack, points = oblique(2, 3), np.arange(9.0).reshape(3, 3)
    expected = [transforms.apply(matrix, point) for matrix, point in zip(stack, points, strict=True)]
    np.testing.assert_allclose(transforms.apply_each(stack, points), expected)


def test_rotate_about_leaves_its_centre_where_it_is() -> None:
    turn = transforms.rotate_about(Rotation.from_rotvec([0, 0, np.pi]), np.array([5.0, 1, 2]))
    np.testing.assert_allclose(
        transforms.apply(turn, np.array([[5.0, 1, 2], [6, 1, 2]])), [[5, 1, 2], [4, 1, 2]]
    )


def test_from_rotation_joins_one_rotation_with_many_translations() -> None:
    joined = transforms.from_rotation(
        Rotation.from_rotvec([0, 0, np.pi / 2]), np.array([[1.0, 2, 3], [4, 5, 6]])
    )
    assert joined.shape == (2, 4, 4)
    assert transforms.from_rotation(Rotation.random(3), np.zeros(3)).shape == (3, 4, 4)
    np.testing.assert_allclose(
        joined[1], [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]], atol=1e-15
    )


@pytest.mark.parametrize(
    "spoil, message",
    [
        (lambda m: m.__setitem__((0, 1), np.nan), "expected finite entries"),
        (lambda m: m.__setitem__((3, 0), 0.5), "expected last row 0 0 0 1"),
        (lambda m: m.__setitem__((slice(0, 3), 0), m[:3, 1]), "expected an invertible matrix"),
        (lambda m: m.__setitem__((slice(0, 3), 0), 0.0), "expected an invertible matrix"),
    ],
)
def test_require_affine_names_the_defect_and_the_matrix(spoil, message) -> None:
    single = oblique(3)[0]
    spoil(single)
    with pytest.raises(InputError, match=f"probe_A_pixel: {message}") as refusal:
        transforms.require_affine(single, "probe_A_pixel")
    assert "matrix" not in str(refusal.value).removeprefix("probe_A_pixel: expected an invertible matrix")
    stack = oblique(4, 5)
    spoil(stack[3])
    with pytest.raises(InputError, match=r"\(matrix 3\)"):
        transforms.require_affine(stack, "probe_A_pixel")


def test_require_affine_refuses_another_shape() -> None:
    with pytest.raises(InputError, match=r"m: expected shape \(..., 4, 4\), received \(3, 4\)"):
        inspect.unwrap(transforms.require_affine)(np.eye(4)[:3], "m")


def test_require_affine_takes_micrometre_pixels() -> None:
    pixels = np.diag([1e-5, 2e-5, 1e-5, 1.0])
    np.testing.assert_array_equal(transforms.require_affine(pixels, "m"), pixels)


def test_require_rigid_refuses_mirror_and_shear_by_name() -> None:
    mirrored = oblique(5)[0]
    mirrored[:3, 0] *= -1
    with pytest.raises(InputError, match="world_T_ee: expected a right-handed rotation"):
        transforms.require_rigid(mirrored, "world_T_ee")
    sheared = oblique(5, 3)
    sheared[1, 0, :3] += 0.01
    with pytest.raises(
        InputError, match=r"world_T_ee: expected orthonormal rotations within 0.001.*\(matrix 1\)"
    ):
        transforms.require_rigid(sheared, "world_T_ee")
    assert transforms.require_rigid(sheared, "world_T_ee", tolerance=0.1).shape == (3, 4, 4)


def test_nearest_rigid_undoes_a_stretch_and_never_mirrors() -> None:
    pose = oblique(6)[0]
    stretched = pose.copy()
    stretched[:3, :3] = pose[:3, :3] @ np.diag([1.01, 0.98, 1.03])
    np.testing.assert_allclose(transforms.nearest_rigid(stretched), pose, atol=1e-12)
    mirrored = oblique(7, 2)
    mirrored[:, :3, 2] *= -1
    np.testing.assert_allclose(np.linalg.det(transforms.nearest_rigid(mirrored)[:, :3, :3]), 1.0)


@pytest.mark.parametrize("angle_deg", [0.0, 1e-3, 37.0, 90.0, 179.9, 180.0])
def test_rotation_angle(angle_deg: float) -> None:
    axis = np.array([1.0, -2, 0.5]) / np.linalg.norm([1.0, -2, 0.5])
    pose = transforms.from_rotation(Rotation.from_rotvec(np.deg2rad(angle_deg) * axis), np.array([1.0, 2, 3]))
    assert float(transforms.rotation_angle_deg(pose)) == pytest.approx(angle_deg, abs=1e-5)
    assert transforms.rotation_angle_deg(np.stack([pose, pose])).shape == (2,)


def test_interpolate_halves_the_angle_and_the_way() -> None:
    ends = transforms.from_rotation(
        Rotation.from_rotvec([[0, 0, 0], [0, 0, np.pi / 2]]), np.array([[0.0, 0, 0], [4, 0, 2]])
    )
    between = transforms.interpolate(np.array([10.0, 10.5, 11.0]), np.array([10.0, 11.0]), ends)
    np.testing.assert_allclose(between[[0, 2]], ends, atol=1e-12)
    np.testing.assert_allclose(between[1, :3, 3], [2, 0, 1])
    np.testing.assert_allclose(between[1, :3, 0], [np.sqrt(0.5), np.sqrt(0.5), 0])


def test_interpolate_of_no_times_gives_no_poses() -> None:
    assert transforms.interpolate(np.empty(0), np.array([0.0, 1.0]), oblique(count=2)).shape == (0, 4, 4)


@pytest.mark.parametrize("times", [[-0.1], [0.5, 1.1], [np.nan]])
def test_interpolate_never_extrapolates(times: list[float]) -> None:
    with pytest.raises(InputError, match="times_s: expected times within 0 to 1 s"):
        transforms.interpolate(np.array(times), np.array([0.0, 1.0]), oblique(count=2))


NOT_INCREASING = "expected at least two strictly increasing times, received otherwise"


@pytest.mark.parametrize("known", [[0.0], [0.0, 0.0], [1.0, 0.0], [0.0, np.nan]])
def test_interpolate_refuses_times_that_do_not_increase(known: list[float]) -> None:
    with pytest.raises(InputError, match=f"^known_times_s: {NOT_INCREASING}$"):
        transforms.interpolate(np.array([0.0]), np.array(known), oblique(count=len(known)))


def test_interpolate_refuses_poses_that_are_not_rigid() -> None:
    poses = oblique(count=2)
    poses[1, 0, 0] += 0.1
    with pytest.raises(InputError, match="A_T_B: expected"):
        transforms.interpolate(np.array([0.5]), np.array([0.0, 1.0]), poses)


def test_mean_rigid_lies_between_opposite_turns() -> None:
    turns = Rotation.from_rotvec([[0, 0, 0.3], [0, 0, -0.3], [0, 0, 0.0]])
    mean = transforms.mean_rigid(
        transforms.from_rotation(turns, np.array([[1.0, 0, 0], [2, 0, 0], [6, 3, 0]]))
    )
    np.testing.assert_allclose(mean, transforms.translation((3.0, 1.0, 0.0)), atol=1e-12)


def test_mean_of_no_poses_is_refused() -> None:
    with pytest.raises(InputError, match=r"^A_T_B: expected at least one pose to average, received none$"):
        transforms.mean_rigid(np.empty((0, 4, 4)))


def test_what_is_affine() -> None:
    assert transforms.is_affine(np.diag([2.0, 3.0, -1.0, 1.0]))
    for broken in (np.zeros((4, 4)), np.full((4, 4), np.nan), np.diag([1.0, 1.0, 0.0, 1.0])):
        assert not transforms.is_affine(broken)


SHIFT = np.float32([[1, 0, 0, 0.25], [0, 1, 0, -0.5], [0, 0, 1, 2], [0, 0, 0, 1]])
POINT = np.float32([1, 2, 3])


@pytest.mark.parametrize(
    "made, expected",
    [
        (lambda: transforms.compose(SHIFT), SHIFT),
        (lambda: transforms.compose(SHIFT, SHIFT), transforms.translation((0.5, -1, 4))),
        (lambda: transforms.invert_rigid(SHIFT), transforms.translation((-0.25, 0.5, -2))),
        (lambda: transforms.invert_affine(SHIFT), transforms.translation((-0.25, 0.5, -2))),
        (lambda: transforms.apply(SHIFT, POINT), [1.25, 1.5, 5]),
        (lambda: transforms.apply_each(SHIFT[None], POINT[None]), [[1.25, 1.5, 5]]),
        (lambda: transforms.nearest_rigid(SHIFT), SHIFT),
        (lambda: transforms.require_rigid(SHIFT, "m"), SHIFT),
        (lambda: transforms.rotation_angle_deg(SHIFT[None]), [0]),
        (lambda: transforms.from_rotation(Rotation.identity(), SHIFT[:3, 3]), SHIFT),
        (lambda: transforms.rotate_about(Rotation.identity(), POINT), np.eye(4)),
    ],
)
def test_single_precision_becomes_double(made, expected) -> None:
    assert made().dtype == np.float64
    np.testing.assert_array_equal(made(), expected)


def test_rotation_about_a_centre_in_single_precision_is_computed_in_double() -> None:
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3])
    centre = np.float32([0.1, 0.2, 0.3])
    twice = [transforms.rotate_about(turn, each) for each in (centre, centre.astype(np.float64))]
    np.testing.assert_array_equal(*twice)


def test_times_in_single_precision_are_interpolated_in_double() -> None:
    ends = np.stack([np.eye(4), transforms.translation((3.0, 0.0, 0.0))])
    at = transforms.interpolate(np.float32([0.25]), np.float32([0.0, 1.0]), ends)
    np.testing.assert_allclose(at, transforms.translation((0.75, 0.0, 0.0))[None], atol=1e-15)


def test_interpolation_goes_from_the_first_to_the_last_of_many_poses() -> None:
    poses = np.stack([transforms.translation((x, -x, 0.0)) for x in (0.0, 1.0, 5.0)])
    between = transforms.interpolate(np.array([0.5, 1.5, 2.0]), np.arange(3.0), poses)
    np.testing.assert_allclose(between[:, :3, 3], [[0.5, -0.5, 0], [3, -3, 0], [5, -5, 0]])
    with pytest.raises(InputError, match=r"within 0 to 2 s, received 0 to 2\.5 s$"):
        transforms.interpolate(np.array([0.0, 2.5]), np.arange(3.0), poses)


def test_interpolation_wants_a_pose_for_each_time() -> None:
    with pytest.raises(InputError, match=r"^A_T_B: expected one pose for each of 3 times, received 2$"):
        inspect.unwrap(transforms.interpolate)(np.array([0.5]), np.arange(3.0), oblique(count=2))


def test_matrices_of_a_stack_are_checked_each_at_its_own_scale() -> None:
    """A pixel's size does not matter, nor where the image lies, nor what else is in the stack."""
    stack = np.stack([np.diag([1e-5, 1e-5, 1e-5, 1.0]), np.diag([1e5, 1e5, 1e5, 1.0])])
    stack[0, :3, 3] = 1e7
    np.testing.assert_array_equal(transforms.require_affine(stack, "m"), stack)


def test_a_matrix_of_a_stack_of_stacks_is_named_by_both_indices() -> None:
    stack = np.broadcast_to(np.eye(4), (2, 3, 4, 4)).copy()
    stack[1, 2, 0, 0] = np.nan
    with pytest.raises(InputError, match=r"infinity \(matrix 1, 2\)$"):
        transforms.require_affine(stack, "m")


def test_the_defect_of_a_single_matrix_has_no_number() -> None:
    with pytest.raises(InputError, match=r"^m: expected finite entries, received NaN or infinity$"):
        transforms.require_affine(np.full((4, 4), np.nan), "m")


def test_a_mirror_image_in_a_stack_is_named() -> None:
    stack = oblique(8, 3)
    stack[1, :3, 0] *= -1
    with pytest.raises(InputError, match=r"received a mirrored one \(matrix 1\)$"):
        transforms.require_rigid(stack, "m")


@pytest.mark.parametrize("call", [transforms.invert_affine, transforms.mean_rigid])
def test_the_argument_is_named(call) -> None:
    name = "A_A_B" if call is transforms.invert_affine else "A_T_B"
    with pytest.raises(InputError, match=f"^{name}: expected an invertible matrix"):
        call(np.diag([0.0, 1, 1, 1])[None])
    with pytest.raises(InputError, match=r"^ct_A_us: expected"):
        transforms.invert_affine(np.diag([0.0, 1, 1, 1]), "ct_A_us")


def test_what_is_not_rigid_is_refused_by_its_own_name() -> None:
    with pytest.raises(InputError, match=r"^world_T_ee: expected an invertible matrix"):
        transforms.require_rigid(np.diag([0.0, 1, 1, 1]), "world_T_ee")
