"""Scene files of 3D Slicer: what they name, how it looks and is referred to, bundles, and what is refused."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from slicer_scenes import read_scene
from vessels import bent_tube

from experiments.errors import InputError
from experiments.reporting.slicer_scene import (
    Model,
    Node,
    PointList,
    Transform,
    scene_files,
    write_slicer_bundle,
    write_slicer_scene,
)
from registration import transforms
from registration.io.landmarks import Landmarks, write_landmarks
from registration.io.patient_space import write_model
from registration.io.transforms import write_transform

TUBE = bent_tube()
POINTS_MM = np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 6.0]])
SHIFT = transforms.translation((5.0, -3.0, 2.0))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Data").mkdir()
    write_model(tmp_path / "Data" / "a vessel 50%.vtp", TUBE)
    write_model(tmp_path / "cloud.vtp", TUBE.vertices_mm, "ras")
    write_landmarks(tmp_path / "points.mrk.json", Landmarks(("a", "b"), POINTS_MM))
    write_transform(tmp_path / "pose.h5", SHIFT)
    return tmp_path


def nodes() -> list[Node]:
    return [
        Model("vessel <1> & Gefäß", "Data/a vessel 50%.vtp", "#ff8000", opacity=0.35, under="pose"),
        Model("cloud", "cloud.vtp", "#0000ff", shown=False, points=True),
        PointList("points", "points.mrk.json", "#00ff00"),
        Transform("pose", "pose.h5"),
    ]


def test_a_scene_names_its_files_and_shows_them_where_they_lie(folder: Path) -> None:
    write_slicer_scene(folder / "scene.mrml", nodes())
    shown, moves = read_scene(folder / "scene.mrml")
    assert list(shown) == ["vessel <1> & Gefäß", "cloud", "points"]
    vessel = shown["vessel <1> & Gefäß"]
    assert (vessel.polygons, vessel.vertices) == (len(TUBE.triangles), 0)
    np.testing.assert_allclose(vessel.points_mm, TUBE.vertices_mm, atol=1e-5)
    # Put under the transform, it moves as the pose does.
    np.testing.assert_allclose(vessel.placed_mm, TUBE.vertices_mm + np.array([5.0, -3.0, 2.0]), atol=1e-5)
    np.testing.assert_allclose(moves["pose"].TransformPoint((0.0, 0.0, 0.0)), (5.0, -3.0, 2.0))
    # The file says RAS, which counts more than the scene.
    np.testing.assert_allclose(shown["cloud"].points_mm, TUBE.vertices_mm * [-1, -1, 1], atol=1e-5)
    assert (shown["cloud"].polygons, shown["cloud"].vertices) == (0, len(TUBE.vertices_mm))
    np.testing.assert_allclose(shown["points"].points_mm, POINTS_MM)


def test_colours_opacity_and_visibility_are_as_slicer_has_them(folder: Path) -> None:
    write_slicer_scene(folder / "scene.mrml", nodes())
    shown, _ = read_scene(folder / "scene.mrml")
    vessel, cloud = (shown[name].display for name in ("vessel <1> & Gefäß", "cloud"))
    assert (vessel["color"], vessel["opacity"], vessel["visibility"]) == (
        "1.0000 0.5020 0.0000",
        "0.35",
        "true",
    )
    # 0 is vtkMRMLDisplayNode::PointsRepresentation, 2 SurfaceRepresentation.
    assert (vessel["representation"], cloud["representation"]) == ("2", "0")
    assert cloud["visibility"] == "false"
    assert shown["points"].display["selectedColor"] == "0.0000 1.0000 0.0000"


def test_models_are_in_lps_and_ids_do_not_meet_those_of_the_slice_views(folder: Path) -> None:
    write_slicer_scene(folder / "scene.mrml", nodes())
    root = ElementTree.parse(folder / "scene.mrml").getroot()
    assert root.tag == "MRML"
    # Without the attribute Slicer takes a scene for an old one, whose models were in RAS.
    assert {each.get("coordinateSystem") for each in root if each.tag == "ModelStorage"} == {"LPS"}
    models = [each.get("id") for each in root if each.tag == "Model"]
    assert models and not {"vtkMRMLModelNode1", "vtkMRMLModelNode2", "vtkMRMLModelNode3"} & set(models)
    assert (
        (folder / "scene.mrml")
        .read_text(encoding="utf-8")
        .startswith('<?xml version="1.0" encoding="UTF-8"?>')
    )


def test_a_bundle_is_one_folder_that_opens_like_the_scene(folder: Path, tmp_path: Path) -> None:
    write_slicer_scene(folder / "scene.mrml", nodes())
    named = scene_files(folder / "scene.mrml")
    assert named == ("Data/a vessel 50%.vtp", "cloud.vtp", "points.mrk.json", "pose.h5")
    write_slicer_bundle(folder / "scene.mrb", folder / "scene.mrml")
    with zipfile.ZipFile(folder / "scene.mrb") as archive:
        assert sorted(archive.namelist()) == sorted(f"scene/{name}" for name in ("scene.mrml", *named))
        archive.extractall(tmp_path / "opened")
    shown, moves = read_scene(tmp_path / "opened" / "scene" / "scene.mrml")
    assert list(shown) == ["vessel <1> & Gefäß", "cloud", "points"] and list(moves) == ["pose"]


@pytest.mark.parametrize(
    "wrong, message",
    [
        ([], "nodes: expected at least one, received none"),
        ([Model("a", "cloud.vtp", "#000000")] * 2, "nodes: expected names that differ, received a, a"),
        ([Model("a", "gone.vtp", "#000000")], "a: expected the file gone.vtp in .*, found none"),
        ([Model("a", "../scene.vtp", "#000000")], r"a: expected a file in .*, received \.\./scene\.vtp"),
        (
            [Model("a", "cloud.vtp", "#000000", under="pose")],
            "a: expected one of the transforms none, received pose",
        ),
        (
            [
                Transform("field", "pose.h5", is_displacement=True),
                Model("a", "cloud.vtp", "#000000", under="field"),
            ],
            "a: expected one of the transforms none, received field",
        ),
    ],
)
def test_what_slicer_could_not_open_is_refused(folder: Path, wrong: list[Node], message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_slicer_scene(folder / "scene.mrml", wrong)
    assert not (folder / "scene.mrml").exists()


def test_other_suffixes_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"expected a scene ending in \.mrml, received \.xml"):
        write_slicer_scene(folder / "scene.xml", nodes())
    write_slicer_scene(folder / "scene.mrml", nodes())
    with pytest.raises(InputError, match=r"expected a bundle ending in \.mrb, received \.zip"):
        write_slicer_bundle(folder / "scene.zip", folder / "scene.mrml")
