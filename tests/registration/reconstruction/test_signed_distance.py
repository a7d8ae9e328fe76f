"""A vessel that forks, from the contours of drawn frames."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.point_cloud import OrientedCloud, take
from registration.reconstruction.contours import ContourCloud, ContourExtractor
from registration.reconstruction.signed_distance import SignedDistanceSurface

ROWS, COLUMNS = np.mgrid[:120, :160].astype(float)
WORLD_T_SWEEP = transforms.from_rotation(
    Rotation.from_euler("xyz", [30, -50, 70], degrees=True), np.array([90.0, -20, 5])
)
PIXEL_MM = 0.2


def cone(kept: np.ndarray, step_mm: float = 0.5) -> ContourCloud:
    """Frames every half millimetre through a cone whose radius grows from 5 mm by 0.1 mm a mm."""
    masks, poses = [], []
    for place in kept:
        radius_px = (5 + 0.1 * place * step_mm) / PIXEL_MM
        distance_px = np.hypot(COLUMNS - 80, ROWS - 60) - radius_px
        masks.append(1 / (1 + np.exp(distance_px)))
        pose = transforms.translation((0, 0, place * step_mm)) @ np.diag([PIXEL_MM, PIXEL_MM, 1, 1])
        poses.append(WORLD_T_SWEEP @ pose)
    return ContourExtractor()(np.stack(masks), np.stack(poses))


def radial_error_mm(vertices_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    local_mm = transforms.apply(transforms.invert_rigid(WORLD_T_SWEEP), vertices_mm) - [
        80 * PIXEL_MM,
        60 * PIXEL_MM,
        0,
    ]
    return np.hypot(local_mm[:, 0], local_mm[:, 1]) - (5 + 0.1 * local_mm[:, 2]), local_mm[:, 2]


def test_a_cone_between_its_first_and_last_frame() -> None:
    mesh = SignedDistanceSurface(cell_mm=0.5, bridge_mm=3.0)(cone(np.arange(41)))
    error_mm, place_mm = radial_error_mm(mesh.vertices_mm)
    inner = (place_mm > 0.5) & (place_mm < 19.5)
    assert np.abs(error_mm[inner]).max() < 0.12
    assert place_mm.min() == pytest.approx(0, abs=0.4)
    assert place_mm.max() == pytest.approx(20, abs=0.4)
    quality = mesh_quality(mesh)
    assert (quality.open_ends, quality.holes, quality.pieces) == (2, 0, 1)
    assert quality.oriented and quality.volume_mm3 > 0
    assert quality.volume_mm3 == pytest.approx(np.pi * 20 * (25 + 35 + 49) / 3, rel=0.02)


def test_frames_the_other_way_round_give_the_same() -> None:
    kept = np.arange(21)
    one = SignedDistanceSurface(0.5, 3.0)(cone(kept))
    other = SignedDistanceSurface(0.5, 3.0)(cone(kept[::-1]))
    assert mesh_quality(other).volume_mm3 == pytest.approx(mesh_quality(one).volume_mm3, rel=0.01)


def test_missing_frames_are_bridged_and_wide_gaps_are_not() -> None:
    few = np.concatenate([np.arange(15), np.arange(19, 41)])
    assert mesh_quality(SignedDistanceSurface(0.5, 3.0)(cone(few))).pieces == 1
    wide = np.concatenate([np.arange(12), np.arange(25, 41)])
    assert mesh_quality(SignedDistanceSurface(0.5, 3.0, largest=False)(cone(wide))).pieces == 2


def test_what_cannot_be_reconstructed_is_refused() -> None:
    cloud = cone(np.arange(3))
    with pytest.raises(InputError, match="cloud: expected contours with their frames"):
        SignedDistanceSurface(0.5, 3.0)(OrientedCloud(cloud.points_mm, cloud.normals))
    flat = take(cloud, np.flatnonzero(cloud.frame_index == 1))
    with pytest.raises(InputError, match="cloud: expected contours of at least two frames, received 1"):
        SignedDistanceSurface(0.5, 3.0)(flat)
    with pytest.raises(InputError, match="cell_mm: expected at most"):
        SignedDistanceSurface(1e-3, 3.0)(cloud)
    for setting in ({"cell_mm": 0.0, "bridge_mm": 1.0}, {"cell_mm": 1.0, "bridge_mm": 0.0}):
        with pytest.raises(InputError, match="expected a number above 0"):
            SignedDistanceSurface(**setting)
