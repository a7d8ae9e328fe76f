"""The fixed model: close to the anatomy, never the same, cut where the scan ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from registration.errors import InputError
from registration.phantom.anatomy import Anatomy, from_lines
from registration.phantom.conditions import CtScan
from registration.phantom.ct import fixed_model, scan_volume, segment_volume
from registration.phantom.shapes import signed_volume_mm3, spline_line


@pytest.fixture(scope="module")
def tube() -> Anatomy:
    line = spline_line(np.array([[20.0, 5, -30], [20, 5, 30]]), np.full(2, 4.0))
    return from_lines((line,), -20.0)


def test_model_is_the_anatomy_within_a_fraction_of_a_voxel(tube: Anatomy) -> None:
    model = fixed_model(tube, CtScan(), np.random.default_rng(0))
    middle = model.vertices_mm[np.abs(model.vertices_mm[:, 2]) < 25]
    radius_mm = np.hypot(middle[:, 0] - 20, middle[:, 1] - 5)
    assert radius_mm.mean() == pytest.approx(4.0, abs=0.1)
    assert 0.005 < radius_mm.std() < 0.2
    assert signed_volume_mm3(model) > 0


def test_crop_shortens_both_ends(tube: Anatomy) -> None:
    whole = fixed_model(tube, CtScan(crop_mm=0.0), np.random.default_rng(0)).vertices_mm[:, 2]
    cropped = fixed_model(tube, CtScan(crop_mm=8.0), np.random.default_rng(0)).vertices_mm[:, 2]
    assert whole.max() - whole.min() == pytest.approx(68, abs=2.5)
    assert cropped.max() - cropped.min() == pytest.approx(52, abs=2.5)


def test_blur_shrinks_nothing_flat_but_thins_small_vessels() -> None:
    line = spline_line(np.array([[0.0, 0, -15], [0, 0, 15]]), np.full(2, 1.7))
    thin = from_lines((line,), -20.0)
    sharp, blurred = (
        fixed_model(thin, replace(CtScan(noise_hu=0.0, crop_mm=0.0), blur_mm=blur), np.random.default_rng(0))
        for blur in (0.1, 1.0)
    )
    assert signed_volume_mm3(blurred) < 0.9 * signed_volume_mm3(sharp)


def test_volume_has_the_contrast_and_noise_asked_for(tube: Anatomy) -> None:
    volume_hu, origin_mm, spacing_mm = scan_volume(tube, CtScan(noise_hu=20.0), np.random.default_rng(0))
    centre = np.rint((np.array([20.0, 5.0, 0.0]) - origin_mm) / spacing_mm).astype(int)
    assert volume_hu[tuple(centre)] == pytest.approx(300, abs=80)
    assert volume_hu[:3, :3].std() == pytest.approx(20, rel=0.4)
    assert spacing_mm == (0.7, 0.7, 1.0)


def test_model_differs_with_the_seed(tube: Anatomy) -> None:
    first, second = (fixed_model(tube, CtScan(), np.random.default_rng(seed)) for seed in (0, 1))
    assert (
        first.vertices_mm.shape != second.vertices_mm.shape or (first.vertices_mm != second.vertices_mm).any()
    )


def test_a_crop_that_leaves_nothing_is_refused(tube: Anatomy) -> None:
    with pytest.raises(InputError, match="crop_mm"):
        fixed_model(tube, CtScan(crop_mm=40.0), np.random.default_rng(0))


def test_a_part_of_the_slices_gives_that_part_of_the_surface(tube: Anatomy) -> None:
    scan = CtScan()
    volume_hu, origin_mm, spacing_mm = scan_volume(tube, scan, np.random.default_rng(0))
    whole = fixed_model(tube, scan, np.random.default_rng(0))
    again = segment_volume(volume_hu, origin_mm, spacing_mm, 0.5 * scan.contrast_hu)
    np.testing.assert_array_equal(again.vertices_mm, whole.vertices_mm)
    part = segment_volume(volume_hu, origin_mm, spacing_mm, 0.5 * scan.contrast_hu, slice(20, 41)).vertices_mm
    low_mm, high_mm = (origin_mm[2] + number * spacing_mm[2] for number in (20, 40))
    assert low_mm - 1 <= part[:, 2].min() < low_mm and high_mm < part[:, 2].max() <= high_mm + 1
    inner = part[(part[:, 2] > low_mm) & (part[:, 2] < high_mm)]
    assert cKDTree(whole.vertices_mm).query(inner)[0].max() < 1e-4
    wide = segment_volume(volume_hu, origin_mm, spacing_mm, 0.2 * scan.contrast_hu)
    assert signed_volume_mm3(wide) > signed_volume_mm3(whole)
