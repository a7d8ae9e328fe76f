"""Surfaces of the user's in their unit and axes, poses, and the one method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from vessels import bent_tube

from experiments.errors import InputError
from experiments.inputs.surfaces import (
    one_method,
    read_frames,
    read_mm,
    read_pose,
    refuse_metres,
    require_path,
    require_solid,
)
from registration import transforms
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Mesh, points_of
from registration.io.patient_space import write_model
from registration.io.point_clouds import write_cloud
from registration.io.surfaces import write_surface
from registration.io.transforms import write_transform
from registration.reconstruction.contours import ContourCloud

TUBE = bent_tube(along=20, around=8)
TURNED = Mesh(TUBE.vertices_mm * [-1.0, -1.0, 1.0], TUBE.triangles)


@pytest.mark.parametrize(
    "unit, space, factor",
    [
        (None, "lps", [1, 1, 1]),
        ("mm", None, [1, 1, 1]),
        ("m", "lps", [1e3, 1e3, 1e3]),
        ("m", "ras", [-1e3, -1e3, 1e3]),
    ],
)
def test_units_and_axes_are_converted_in_the_reader(
    tmp_path: Path, unit: str | None, space: str | None, factor: list[float]
) -> None:
    write_surface(tmp_path / "tube.ply", TUBE)
    write_surface(tmp_path / "tube.xyz", TUBE.vertices_mm)
    for name in ("tube.ply", "tube.xyz"):
        found = points_of(read_mm(tmp_path / name, "moving", unit, space))
        np.testing.assert_allclose(found, TUBE.vertices_mm * factor, rtol=1e-8)


def test_a_header_counts_where_the_user_says_nothing(tmp_path: Path) -> None:
    write_model(tmp_path / "ras.ply", TURNED, "ras")
    told = points_of(read_mm(tmp_path / "ras.ply", "moving", None, None))
    np.testing.assert_allclose(told, TUBE.vertices_mm, atol=1e-4)
    forced = points_of(read_mm(tmp_path / "ras.ply", "moving", None, "lps"))
    np.testing.assert_allclose(forced, TURNED.vertices_mm, atol=1e-4)


def test_a_unit_or_axes_of_another_name_are_refused(tmp_path: Path) -> None:
    write_surface(tmp_path / "tube.ply", TUBE)
    with pytest.raises(InputError, match="moving_unit: expected mm, cm, m or null, received 'inch'"):
        read_mm(tmp_path / "tube.ply", "moving", "inch")
    with pytest.raises(InputError, match="fixed_space: expected lps, ras or null, received 'LPS'"):
        read_mm(tmp_path / "tube.ply", "fixed", None, "LPS")


@pytest.mark.parametrize(
    "own_scale, other_scale, refused",
    [
        (1.0, 1.0, False),
        (0.3, 1.0, False),
        (0.012, 1.0, False),
        (0.009, 1.0, True),
        (1.0, 150.0, True),
        (1e-3, 1e-3, True),
    ],
)
def test_metres_and_a_hundredfold_are_refused_unless_the_unit_is_said(
    own_scale: float, other_scale: float, refused: bool
) -> None:
    own, other = own_scale * TUBE.vertices_mm, other_scale * TUBE.vertices_mm
    if refused:
        with pytest.raises(InputError, match=r"moving: expected millimetres.*looks like metres; convert it"):
            refuse_metres(own, other, "moving", None, "convert it")
    else:
        refuse_metres(own, other, "moving", None, "convert it")
    refuse_metres(own, other, "moving", "mm", "convert it")


def test_a_plane_is_no_vessel() -> None:
    require_solid(TUBE, "fixed")
    flat = np.random.default_rng(0).normal(size=(100, 3)) @ np.array([[1.0, 2, 3], [0, 1, -1], [0, 0, 0]])
    with pytest.raises(
        InputError, match="fixed: expected points around a vessel, received points in one plane"
    ):
        require_solid(flat, "fixed")
    # A vertex that no triangle uses does not make a plane a vessel.
    square = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0], [4, 4, 30]])
    with pytest.raises(InputError, match="received points in one plane"):
        require_solid(Mesh(square, np.array([[0, 1, 2], [1, 3, 2]])), "fixed")


def test_poses_are_read_from_every_format_under_the_name_of_their_setting(tmp_path: Path) -> None:
    pose = transforms.translation((3.0, -2.0, 1.0))
    write_transform(tmp_path / "pose.tfm", pose)
    np.testing.assert_allclose(read_pose(tmp_path / "pose.tfm", "initial"), pose)
    np.savetxt(tmp_path / "pose.txt", pose)
    np.testing.assert_allclose(read_pose(tmp_path / "pose.txt", "initial"), pose)
    with pytest.raises(InputError, match=r"^initial: .*none\.h5: expected a file"):
        read_pose(tmp_path / "none.h5", "initial")


def test_a_sweeps_cloud_says_which_frame_each_point_was_seen_in(tmp_path: Path) -> None:
    count = len(TUBE.vertices_mm)
    seen = np.sort(np.random.default_rng(0).integers(0, 9, count))
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    plain = OrientedCloud(TUBE.vertices_mm, normals)
    cloud = ContourCloud(
        TUBE.vertices_mm,
        normals,
        frame_index=seen,
        contour_index=np.zeros(count, dtype=np.int64),
        is_open=np.zeros(count, dtype=bool),
        confidence=np.ones(count),
        world_A_pixel=np.tile(np.eye(4), (9, 1, 1)),
    )
    for name, written in (("seen.ply", cloud), ("plain.ply", plain)):
        write_cloud(tmp_path / name, written)
    write_surface(tmp_path / "mesh.ply", TUBE)
    write_surface(tmp_path / "plain.xyz", TUBE.vertices_mm)
    found = {
        name: read_frames(tmp_path / name, read_mm(tmp_path / name, "moving", None))
        for name in ("seen.ply", "plain.ply", "mesh.ply", "plain.xyz")
    }
    np.testing.assert_array_equal(found.pop("seen.ply"), seen)
    assert set(found.values()) == {None}


def test_exactly_one_method() -> None:
    assert one_method({"a": 1}) == ("a", 1)
    for given, received in (({}, "none"), ({"a": 1, "b": 2}, "a, b"), (None, "None"), ("a", "'a'")):
        with pytest.raises(InputError, match=f"rigid: expected exactly one method, received {received}"):
            one_method(given)


def test_a_path_is_needed() -> None:
    assert require_path("a.ply", "moving", "a file") == Path("a.ply")
    for empty in (None, ""):
        with pytest.raises(InputError, match="moving: expected a file, received none"):
            require_path(empty, "moving", "a file")
