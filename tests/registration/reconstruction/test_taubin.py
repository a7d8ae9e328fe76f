"""Taubin's filter takes noise off a tube and neither its volume nor its length."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.errors import InputError
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.shapes import Mesh
from registration.reconstruction.taubin import TaubinSmoothing

LINE_MM = straight(40.0)
WHOLE = tube(LINE_MM, 4.0)


def radius_mm(mesh: Mesh) -> np.ndarray:
    way = (LINE_MM[-1] - LINE_MM[0]) / 40
    return np.linalg.norm(np.cross(mesh.vertices_mm - LINE_MM[0], way), axis=1)


def rough() -> Mesh:
    noise_mm = np.random.default_rng(0).normal(0, 0.1, WHOLE.vertices_mm.shape)
    return Mesh(WHOLE.vertices_mm + noise_mm, WHOLE.triangles)


def test_noise_goes_and_the_volume_stays() -> None:
    smooth = TaubinSmoothing(iterations=20)(rough())
    inner = slice(10 * 32, -10 * 32)
    assert radius_mm(rough())[inner].std() > 0.09
    assert radius_mm(smooth.mesh)[inner].std() < 0.05
    assert radius_mm(smooth.mesh)[inner].mean() == pytest.approx(4.0, abs=0.03)
    assert abs(smooth.volume_change) < 0.015
    before_mm3, after_mm3 = enclosed_volume_mm3(rough()), enclosed_volume_mm3(smooth.mesh)
    assert smooth.volume_change == pytest.approx(after_mm3 / before_mm3 - 1)
    moved_mm = np.linalg.norm(smooth.mesh.vertices_mm - rough().vertices_mm, axis=1)
    assert smooth.moved_max_mm == pytest.approx(moved_mm.max())


def test_open_ends_stay_where_they_are() -> None:
    smooth = TaubinSmoothing(iterations=50)(WHOLE)
    way = (LINE_MM[-1] - LINE_MM[0]) / 40
    place_mm = (smooth.mesh.vertices_mm - LINE_MM[0]) @ way
    np.testing.assert_allclose(place_mm[:32], 0, atol=1e-9)
    np.testing.assert_allclose(place_mm[-32:], 40, atol=1e-9)


def test_none_changes_nothing_and_too_much_change_is_an_error() -> None:
    np.testing.assert_array_equal(TaubinSmoothing(iterations=0)(WHOLE).mesh.vertices_mm, WHOLE.vertices_mm)
    with pytest.raises(InputError, match="expected smoothing to keep the volume within"):
        TaubinSmoothing(iterations=20, volume_tolerance=0.001)(rough())


def test_bad_settings_and_an_empty_mesh() -> None:
    for setting in (
        {"iterations": -1},
        {"shrink": 0.0},
        {"pass_band": 0.0},
        {"pass_band": 2.0},
        {"volume_tolerance": 0.0},
    ):
        with pytest.raises(InputError, match=next(iter(setting))):
            TaubinSmoothing(**setting)
    with pytest.raises(InputError, match="mesh: expected triangles to smooth"):
        TaubinSmoothing()(Mesh(np.eye(3), np.empty((0, 3), dtype=np.int64)))
