"""Clouds as other programs read them, with what is known of each point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tube_sweeps import tube_sweep

from registration.errors import InputError
from registration.geometry.point_cloud import OrientedCloud
from registration.io.patient_space import stated_space
from registration.io.point_clouds import write_cloud
from registration.io.surfaces import read_surface
from registration.reconstruction.contours import ContourExtractor
from registration.synchronisation import synchronise


def test_points_normals_and_frames_come_back(tmp_path: Path) -> None:
    import open3d
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOPLY import vtkPLYReader

    tube = tube_sweep(count=3)
    cloud = ContourExtractor()(tube.probability, synchronise(tube.sweep, 0.1).world_A_pixel)
    path = tmp_path / "cloud.ply"
    write_cloud(path, cloud)
    np.testing.assert_allclose(np.asarray(read_surface(path)), cloud.points_mm, atol=1e-4)
    read = open3d.io.read_point_cloud(str(path))
    np.testing.assert_allclose(np.asarray(read.normals), cloud.normals, atol=1e-6)
    every = open3d.t.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(every.point["frame"].numpy().ravel(), cloud.frame_index)
    np.testing.assert_allclose(every.point["confidence"].numpy().ravel(), cloud.confidence, atol=1e-6)
    reader = vtkPLYReader()
    reader.SetFileName(str(path))
    reader.Update()
    places_mm = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
    np.testing.assert_allclose(places_mm, cloud.points_mm, atol=1e-4)
    assert stated_space(path) == "lps"


def test_plain_clouds_are_written_and_other_kinds_refused(tmp_path: Path) -> None:
    points_mm = np.random.default_rng(0).normal(size=(20, 3))
    cloud = OrientedCloud(points_mm, np.tile([0.0, 0, 1], (20, 1)))
    write_cloud(tmp_path / "cloud.ply", cloud, "RAS")
    np.testing.assert_allclose(np.asarray(read_surface(tmp_path / "cloud.ply")), points_mm, atol=1e-6)
    with pytest.raises(InputError, match=r"expected \.ply to write, received \.xyz"):
        write_cloud(tmp_path / "cloud.xyz", cloud)
    with pytest.raises(InputError, match="space: expected LPS or RAS, received 'world'"):
        write_cloud(tmp_path / "cloud.ply", cloud, "world")
