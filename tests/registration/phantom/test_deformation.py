"""Deformation fields: exact inverses, the sizes asked for, and a block that misses nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.phantom.deformation import SweepDeformation, View
from registration.phantom.displacement import Bend, Press, draw_bend

GUIDE_MM = np.column_stack([3 * np.sin(np.linspace(0, 3, 40)), np.zeros(40), np.linspace(-40, 40, 40)])
POSE = transforms.from_rotation(
    Rotation.from_euler("xyz", (85, 10, -5), degrees=True), np.array([2.0, -17.0, 5.0])
)
PRESS = Press(
    depth_mm=2.0, fade_mm=25.0, half_width_mm=20.0, squeeze=0.25, centre_mm=(1.0, 17.0), reach_mm=6.0
)


def bend(max_mm: float = 3.0) -> Bend:
    drawn = draw_bend(GUIDE_MM, max_mm, 22.0, np.random.default_rng(1))
    assert drawn is not None
    return drawn


@pytest.mark.parametrize("max_mm", [0.5, 3.0, 6.0])
def test_largest_displacement_along_the_vessel_is_as_asked(max_mm: float) -> None:
    moved_mm = np.linalg.norm(bend(max_mm)(GUIDE_MM) - GUIDE_MM, axis=1)
    assert moved_mm.max() == pytest.approx(max_mm, rel=0.02)
    assert draw_bend(GUIDE_MM, 0.0, 22.0, np.random.default_rng(1)) is None


def test_bend_holds_no_rigid_motion() -> None:
    field = bend()
    around_mm = (
        GUIDE_MM[:, None] + 15.0 * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    ).reshape(-1, 3)
    bent_mm = field(around_mm)
    np.testing.assert_allclose((bent_mm - around_mm).mean(axis=0), 0.0, atol=1e-6)
    rotation, _ = Rotation.align_vectors(around_mm - around_mm.mean(axis=0), bent_mm - bent_mm.mean(axis=0))
    assert np.rad2deg(rotation.magnitude()) < 1e-3


def test_view_and_its_inverse_agree() -> None:
    view = View(POSE, bend(), PRESS)
    rng = np.random.default_rng(0)
    local_mm = rng.uniform([-20, 0, -3], [20, 40, 3], (500, 3))
    np.testing.assert_allclose(view.to_image(view.to_tissue(local_mm)), local_mm, atol=2e-3)


def test_fields_do_not_fold_the_tissue() -> None:
    view = View(POSE, bend(5.0), PRESS)
    rng = np.random.default_rng(0)
    points_mm = transforms.apply(POSE, rng.uniform([-20, 0, -3], [20, 40, 3], (400, 3)))
    step = 1e-4
    columns = [
        (view.to_image(points_mm + step * axis) - view.to_image(points_mm - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    jacobian = np.linalg.det(np.stack(columns, axis=-1))
    assert jacobian.min() > 0.3


def test_press_moves_the_skin_fully_and_the_depth_hardly() -> None:
    plain = Press(2.0, 25.0, 20.0, 0.0, (0.0, 0.0), 1.0)
    # Before the push the skin lies 2 mm above the face.
    local_mm = np.array([[0.0, -2.0, 0.0], [0.0, 40.0, 0.0], [60.0, -2.0, 0.0]])
    moved_mm = plain(local_mm) - local_mm
    np.testing.assert_allclose(moved_mm[:, [0, 2]], 0.0)
    np.testing.assert_allclose(moved_mm[:, 1], [2.0, 2.0 * np.exp(-42 / 25), 0.0], atol=1e-3)


def test_squeeze_flattens_a_circle_by_its_share() -> None:
    press = Press(1e-9, 25.0, 20.0, 0.2, (3.0, 15.0), 50.0)
    angle = np.linspace(0, 2 * np.pi, 400)
    circle_mm = np.column_stack([3 + 4 * np.cos(angle), 15 + 4 * np.sin(angle), np.zeros(400)])
    flat_mm = press(circle_mm)
    assert np.ptp(flat_mm[:, 1]) == pytest.approx(8 * 0.8, rel=0.02)
    assert np.ptp(flat_mm[:, 0]) == pytest.approx(8 * 1.2, rel=0.02)


def test_block_holds_all_that_is_seen() -> None:
    low_mm, high_mm = np.array([-20.0, -1.0, -3.0]), np.array([20.0, 40.0, 3.0])
    view = View(POSE, bend(5.0), PRESS)
    block = view.slab(low_mm, high_mm)
    rng = np.random.default_rng(0)
    material_mm = view.to_tissue(rng.uniform(low_mm, high_mm, (4000, 3)))
    inside_mm = transforms.apply(transforms.invert_rigid(block.tissue_T_image), material_mm)
    assert (inside_mm > block.low_mm).all()
    assert (inside_mm < block.high_mm).all()
    assert (block.high_mm - block.low_mm)[2] < 16


def test_precision_of_the_input_is_kept_and_enough() -> None:
    view = View(POSE, bend(), PRESS)
    points_mm = transforms.apply(POSE, np.random.default_rng(0).uniform([-20, 0, -3], [20, 40, 3], (200, 3)))
    single = view.to_image(points_mm.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, view.to_image(points_mm), atol=1e-4)


def test_truth_takes_the_frame_that_passes_nearest() -> None:
    views = tuple(
        View(transforms.translation((0, 0, z)) @ POSE, None, Press(depth, 25.0, 20.0, 0.0, (0.0, 0.0), 1.0))
        for z, depth in ((-20.0, 1.0), (20.0, 2.0))
    )
    ct_T_bed = transforms.from_rotation(Rotation.from_euler("z", 40, degrees=True), np.array([5.0, 6.0, 7.0]))
    truth = SweepDeformation(views, ct_T_bed)
    in_plane_mm = transforms.apply(ct_T_bed @ views[1].tissue_T_image, np.array([[0.0, 5.0, 0.0]]))
    shown_mm = truth.as_swept(in_plane_mm)
    np.testing.assert_allclose(shown_mm, truth.displaced(in_plane_mm, 1))
    assert np.linalg.norm(shown_mm - in_plane_mm) == pytest.approx(2 * np.exp(-7 / 25), rel=1e-6)
    np.testing.assert_array_equal(truth.pressure_mm, [1.0, 2.0])


def test_what_was_swept_goes_back_to_its_place_in_the_tissue() -> None:
    poses = [POSE @ transforms.translation((0.0, 0.0, 0.5 * index)) for index in range(21)]
    ct_T_bed = transforms.from_rotation(
        Rotation.from_euler("xyz", (10, 20, 30), degrees=True), np.array([5.0, 0, 9])
    )
    field = bend()
    deformation = SweepDeformation(tuple(View(pose, field, PRESS) for pose in poses), ct_T_bed)
    local_mm = np.random.default_rng(0).uniform([-10, 5, -0.2], [10, 30, 0.2], (200, 3))
    seen_mm = transforms.apply(ct_T_bed @ poses[10], local_mm)
    material_mm = deformation.material(seen_mm)
    assert np.linalg.norm(material_mm - seen_mm, axis=1).mean() > 1.0
    np.testing.assert_allclose(deformation.displaced(material_mm, 10), seen_mm, atol=5e-3)
