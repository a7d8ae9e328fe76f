"""A registration in 3D Slicer: every file is there, is read, and lies where the registration says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slicer_scenes import read_scene
from vessels import bent_tube

from experiments.analysis.registration.slicer_result import (
    SlicerResult,
    require_slicer,
    write_slicer_result,
)
from experiments.errors import InputError
from registration import transforms
from registration.geometry.shapes import Centerline, Polyline, Surface, points_of, transformed
from registration.io.landmarks import Landmarks
from registration.io.surfaces import write_surface
from registration.io.transforms import write_transform

TUBE = bent_tube()
POSE = transforms.from_rotation(Rotation.from_rotvec([0.4, -0.9, 1.0]), np.array([-60.0, 20, 15]))
LINE = Centerline((Polyline(np.arange(12.0).reshape(4, 3) ** 1.5, np.linspace(2, 3, 4)),))
MARKS_MM = np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 6.0]])


def written(folder: Path, moving: Surface, slicer: str = "scene") -> SlicerResult:
    """What a study leaves, and the scene of it."""
    write_transform(folder / "fixed_T_moving.h5", POSE)
    write_surface(folder / "moved.ply", transformed(moving, POSE))
    result = SlicerResult(
        TUBE,
        moving,
        POSE,
        {"centerline, fixed": LINE, "centerline, moved": LINE.transformed(POSE)},
        {"landmarks, fixed": Landmarks(("a", "b"), MARKS_MM)},
        {"another": TUBE},
    )
    write_slicer_result(folder, result, slicer)
    return result


@pytest.mark.parametrize("of_points", [False, True])
def test_everything_lies_where_the_registration_says(tmp_path: Path, of_points: bool) -> None:
    own = transformed(TUBE, transforms.invert_rigid(POSE))
    written(tmp_path, points_of(own) if of_points else own)
    shown, moves = read_scene(tmp_path / "scene.mrml")
    assert list(shown) == [
        *("fixed", "moving, as given", "moved", "another"),
        *("centerline, fixed", "centerline, moved", "landmarks, fixed"),
    ]
    assert list(moves) == ["fixed_T_moving"]
    np.testing.assert_allclose(shown["fixed"].points_mm, TUBE.vertices_mm, atol=1e-4)
    np.testing.assert_allclose(shown["moved"].points_mm, TUBE.vertices_mm, atol=1e-4)
    # What moves lies in its own frame in the file, and on the fixed one under the transform.
    np.testing.assert_allclose(shown["moving, as given"].points_mm, points_of(own), atol=1e-4)
    np.testing.assert_allclose(shown["moving, as given"].placed_mm, TUBE.vertices_mm, atol=1e-4)
    np.testing.assert_allclose(
        shown["centerline, moved"].points_mm, transforms.apply(POSE, LINE.lines[0].points_mm), atol=1e-4
    )
    np.testing.assert_allclose(shown["landmarks, fixed"].points_mm, MARKS_MM)
    assert shown["centerline, fixed"].lines == 1
    # Points have a cell each, without which a viewer shows nothing.
    for name in ("moving, as given", "moved"):
        counts = (shown[name].polygons, shown[name].vertices)
        assert counts == ((0, len(TUBE.vertices_mm)) if of_points else (len(TUBE.triangles), 0))
    hidden = {name for name, each in shown.items() if each.display["visibility"] == "false"}
    assert hidden == {"moving, as given", "another"}


def test_a_mesh_that_lies_in_the_folder_is_not_written_twice(tmp_path: Path) -> None:
    written(tmp_path, transformed(TUBE, transforms.invert_rigid(POSE)))
    assert not (tmp_path / "Data" / "moved.vtp").exists()
    assert "moved.ply" in (tmp_path / "scene.mrml").read_text()


def test_a_bundle_stands_beside_its_scene_and_none_writes_nothing(tmp_path: Path) -> None:
    for name in ("bundle", "none"):
        (tmp_path / name).mkdir()
        written(tmp_path / name, TUBE, name)
    assert (tmp_path / "bundle" / "scene.mrml").is_file() and (tmp_path / "bundle" / "scene.mrb").is_file()
    assert {path.name for path in (tmp_path / "none").iterdir()} == {"fixed_T_moving.h5", "moved.ply"}


def test_another_word_is_refused() -> None:
    with pytest.raises(InputError, match="slicer: expected scene, bundle or none, received 'mrml'"):
        require_slicer("mrml")
