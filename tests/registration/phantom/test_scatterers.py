"""Scatterers of a block: all of them, the same ones from every view, evenly spread."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.phantom.scatterers import Slab, cells_in, place

PITCH_MM = 0.5


def block(angles_deg: tuple, centre_mm: tuple = (3.0, -7.0, 12.0)) -> Slab:
    pose = transforms.from_rotation(Rotation.from_euler("xyz", angles_deg, degrees=True), np.array(centre_mm))
    return Slab(pose, np.array([-6.0, -1.0, -1.5]), np.array([6.0, 9.0, 1.5]))


def inside(slab: Slab, positions_mm: np.ndarray) -> np.ndarray:
    local_mm = transforms.apply(transforms.invert_rigid(slab.tissue_T_image), positions_mm)
    return ((local_mm > slab.low_mm) & (local_mm < slab.high_mm)).all(axis=1)


@pytest.mark.parametrize("angles_deg", [(0, 0, 0), (90, 0, 0), (40, 30, 20), (-45, 45, 80), (54.7, 45, 0)])
def test_no_scatterer_of_the_block_is_missed(angles_deg: tuple) -> None:
    slab = block(angles_deg)
    cells = cells_in(slab, PITCH_MM)
    assert len(np.unique(cells, axis=0)) == len(cells)
    found_mm, _, _ = place(cells, PITCH_MM, seed=1)
    everything = np.stack(np.meshgrid(*[np.arange(-40, 60)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    all_mm, _, _ = place(everything, PITCH_MM, seed=1)
    expected_mm = all_mm[inside(slab, all_mm)]
    got_mm = found_mm[inside(slab, found_mm)]
    assert len(got_mm) == len(expected_mm) > 2000
    np.testing.assert_array_equal(np.unique(got_mm, axis=0), np.unique(expected_mm, axis=0))


def test_visited_cells_stay_in_proportion_to_the_block() -> None:
    volume_cells = 12 * 10 * 3 / PITCH_MM**3
    for angles_deg in [(0, 0, 0), (40, 30, 20), (54.7, 45, 0)]:
        assert len(cells_in(block(angles_deg), PITCH_MM)) < 6 * volume_cells


def test_strength_has_zero_mean_and_unit_rms_and_places_fill_their_cell() -> None:
    cells = np.stack(np.meshgrid(*[np.arange(-20, 20)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    positions_mm, strength, _ = place(cells, PITCH_MM, seed=0)
    within = positions_mm / PITCH_MM - cells
    assert within.min() > 0
    assert within.max() < 1
    np.testing.assert_allclose(within.mean(axis=0), 0.5, atol=0.01)
    np.testing.assert_allclose(np.corrcoef(within.T), np.eye(3), atol=0.02)
    assert abs(strength.mean()) < 0.01
    assert strength.var() == pytest.approx(1.0, rel=0.01)
