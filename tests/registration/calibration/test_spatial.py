"""N-wire calibration: an exact phantom cut by known image planes, outliers, and the data sets of PLUS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.calibration.probe import complete_right_handed, corner_displacement_mm
from registration.calibration.spatial import (
    NWireCalibration,
    mean_of_best_mm,
    middle_errors_mm,
    middle_points_mm,
    middle_points_probe_mm,
    phantom_registration,
)
from registration.errors import InputError
from registration.readers.plus.config import read_device_set
from registration.readers.plus.results import WireFrames, read_wire_calibration

WIRES_MM = np.array(
    [
        [[30, 0, 20], [30, 40, 20]], [[55, 0, 20], [35, 40, 20]], [[60, 0, 20], [60, 40, 20]],
        [[30, 0, 10], [30, 40, 10]], [[35, 0, 10], [55, 40, 10]], [[60, 0, 10], [60, 40, 10]],
        [[35, 0, 0], [35, 40, 0]], [[55, 0, 0], [40, 40, 0]], [[60, 0, 0], [60, 40, 0]],
    ],
    dtype=np.float64,
)  # fmt: skip
TRUE = complete_right_handed(
    np.array([0.08, 0.001, 0.0]), np.array([0.002, 0.0, 0.075]), np.array([-25.0, 3.0, 5.0])
)


def cut(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Where the image plane of a hand-held probe cuts each wire, in px, and ``probe_T_phantom``; all exact."""
    rng = np.random.default_rng(seed)
    base = Rotation.from_euler("x", 180, degrees=True)
    points, poses = np.zeros((count, 9, 2)), np.zeros((count, 4, 4))
    for index in range(count):
        turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(-12, 12, 3)))
        phantom_T_probe = transforms.from_rotation(
            turn * base, np.array([40.0, 20.0, 45.0]) + rng.uniform(-3, 3, 3)
        )
        phantom_A_pixel = phantom_T_probe @ TRUE
        for wire, (front, back) in enumerate(WIRES_MM):
            # column * u + row * v + origin = front + s * (back - front)
            system = np.stack([phantom_A_pixel[:3, 0], phantom_A_pixel[:3, 1], front - back], axis=1)
            points[index, wire] = np.linalg.solve(system, front - phantom_A_pixel[:3, 3])[:2]
        poses[index] = transforms.invert_rigid(phantom_T_probe)
    return points, poses


def test_middle_point_from_ratios() -> None:
    # The image cuts the first N at y = 10: the middle wire lies a quarter of its way from x = 55 to 35.
    points = np.array([[[100, 0], [100 + 10 * 20, 0], [100 + 10 * 30, 0]]], dtype=np.float64)
    np.testing.assert_allclose(middle_points_mm(points, WIRES_MM[:3]), [[[50, 10, 20]]])


def test_exact_data_give_the_exact_calibration() -> None:
    points, poses = cut(12)
    result = NWireCalibration()(points, WIRES_MM, poses)
    np.testing.assert_allclose(result.probe_A_pixel, TRUE, atol=1e-9)
    assert not result.outliers.any()
    assert result.residuals_mm.max() < 1e-9


def test_noise_averages_out_and_wrong_points_are_left_out() -> None:
    points, poses = cut(150, seed=1)
    points += np.random.default_rng(2).normal(0, 1.0, points.shape)
    points[[5, 17, 40], 4] += [0, 90]
    result = NWireCalibration()(points, WIRES_MM, poses)
    assert result.outliers[[5, 17, 40], 1].all()
    assert corner_displacement_mm(result.probe_A_pixel, TRUE, 600, 800).max() < 0.4
    kept_all = NWireCalibration(outlier_sigma=1e6)(points, WIRES_MM, poses)
    worse = corner_displacement_mm(kept_all.probe_A_pixel, TRUE, 600, 800).max()
    assert worse > 1.5 * corner_displacement_mm(result.probe_A_pixel, TRUE, 600, 800).max()


def test_mean_of_the_best() -> None:
    assert mean_of_best_mm(np.array([[4.0, 1.0], [2.0, 100.0]]), share=0.75) == pytest.approx(7 / 3)
    with pytest.raises(InputError, match="at least one error"):
        mean_of_best_mm(np.zeros((0, 3)))


def test_phantom_registration_of_known_points() -> None:
    truth = transforms.from_rotation(
        Rotation.from_euler("xyz", [100, 20, -60], degrees=True), np.array([9.0, -80.0, 30.0])
    )
    points = WIRES_MM.reshape(-1, 3)
    np.testing.assert_allclose(
        phantom_registration(points, transforms.apply(truth, points)), truth, atol=1e-9
    )
    # Points in a plane leave a mirror image as good: the answer must still be right-handed.
    flat = WIRES_MM[:3].reshape(-1, 3)
    np.testing.assert_allclose(phantom_registration(flat, transforms.apply(truth, flat)), truth, atol=1e-9)
    with pytest.raises(InputError, match="not on a line"):
        phantom_registration(points[:2], points[:2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, w, t: (p[:5], w, t[:5]), "at least 10 frames, received 5"),
        (lambda p, w, t: (p[:, :8], w, t), "a point for each of 9 wires, three a pattern, received 8"),
        (lambda p, w, t: (p * [1, 0] + [0, 50], w, t), "span the image plane, received points on a line"),
        (lambda p, w, t: (p * 0.0, w, t), "points on a line|outer wires of a pattern apart"),
        (lambda p, w, t: (p, np.repeat(w[:1], 9, axis=0), t), "middle wires aslant"),
    ],
)
def test_data_that_leave_the_calibration_open_are_refused(change: object, message: str) -> None:
    points, poses = cut(12)
    with pytest.raises(InputError, match=message):
        NWireCalibration()(*change(points, WIRES_MM, poses))  # type: ignore[operator]


@pytest.mark.parametrize("settings", [{"outlier_sigma": 0.0}, {"min_frames": 1}])
def test_settings_are_checked(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        NWireCalibration(**settings)  # type: ignore[arg-type]


def errors_mm(
    data: WireFrames, wires_mm: np.ndarray, reference_T_phantom: np.ndarray, matrix: np.ndarray
) -> np.ndarray:
    target = middle_points_probe_mm(data.points_px, wires_mm, data.probe_T_reference @ reference_T_phantom)
    return middle_errors_mm(matrix, data.points_px[:, 1::3], target)


def test_calibration_of_the_fcal_2_phantom(real_data: Path) -> None:
    plus = real_data / "plus"
    data = read_wire_calibration(plus / "FreehandCalibration3NWires_fCal2.0.results.xml")
    device_set = read_device_set(plus / "PlusDeviceSet_fCal_Sim_SpatialCalibration_2.0.xml")
    registered = device_set.transforms.chain("Phantom", "Reference")
    points, poses = data.calibration.points_px, data.calibration.probe_T_reference @ registered
    assert data.calibration.middle_probe_mm is not None
    found_mm = middle_points_probe_mm(points, device_set.wires_mm, poses)
    np.testing.assert_allclose(found_mm, data.calibration.middle_probe_mm, atol=3e-4)
    result = NWireCalibration()(points, device_set.wires_mm, poses)
    np.testing.assert_allclose(result.probe_A_pixel[:3, 3], [11.2137, 48.4162, -0.398993], atol=1e-3)
    corners = corner_displacement_mm(result.probe_A_pixel, data.probe_A_pixel, data.height_px, data.width_px)
    assert corners.max() < 0.1
    np.testing.assert_allclose(result.probe_A_pixel, data.probe_A_pixel, atol=1e-4)
    assert mean_of_best_mm(result.residuals_mm) == pytest.approx(0.479, abs=5e-4)
    validation = errors_mm(data.validation, device_set.wires_mm, registered, result.probe_A_pixel)
    assert mean_of_best_mm(validation) == pytest.approx(0.540, abs=5e-4)


def test_calibration_of_the_older_phantom(real_data: Path) -> None:
    data = read_wire_calibration(real_data / "plus" / "FreehandCalibration3NWires.results.xml")
    # The wires are named after the holes they go through: E to K are 5 mm apart from x = 20 mm, rows 2 to 4 lie at
    # z = 10, 5 and 0 mm. Its registration is not recorded, but follows from the middle points that are.
    holes = {letter: 20.0 + 5 * index for index, letter in enumerate("EFGHIJK")}
    names = ["E2e2", "I2f2", "J2j2", "E3e3", "F3j3", "K3k3", "E4e4", "J4f4", "K4k4"]
    wires_mm = np.array(
        [
            [[holes[n[0]], 0.0, 5.0 * (4 - int(n[1]))], [holes[n[2].upper()], 40.0, 5.0 * (4 - int(n[3]))]]
            for n in names
        ]
    )
    calibration = data.calibration
    assert calibration.middle_probe_mm is not None
    reference_T_probe = transforms.invert_rigid(transforms.nearest_rigid(calibration.probe_T_reference))
    in_reference = np.concatenate(
        [
            transforms.apply(pose, points)
            for pose, points in zip(reference_T_probe, calibration.middle_probe_mm, strict=True)
        ]
    )
    in_phantom = middle_points_mm(calibration.points_px, wires_mm).reshape(-1, 3)
    registered = phantom_registration(in_phantom, in_reference)
    assert np.linalg.norm(transforms.apply(registered, in_phantom) - in_reference, axis=1).max() < 2e-3
    result = NWireCalibration()(calibration.points_px, wires_mm, calibration.probe_T_reference @ registered)
    assert corner_displacement_mm(result.probe_A_pixel, data.probe_A_pixel, 616, 820).max() < 0.1
    assert mean_of_best_mm(result.residuals_mm) == pytest.approx(1.155, abs=5e-4)
    validation = errors_mm(data.validation, wires_mm, registered, result.probe_A_pixel)
    assert mean_of_best_mm(validation) == pytest.approx(1.247, abs=5e-4)
