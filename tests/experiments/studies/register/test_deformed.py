"""The deformable stage of ``study=register``: both directions, its files, its record and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK
from scipy.spatial.transform import Rotation
from slicer_scenes import read_scene
from vessels import bent_tube

from experiments import registry
from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.inputs.surfaces import one_method
from experiments.outcome import Outcome, Silent
from experiments.studies.register import study as register
from experiments.studies.register.carried import CENTERLINES, read_carried
from experiments.studies.register.deformed import require_constraints, require_side
from experiments.studies.register.pair import SideFiles, read_pair
from registration import transforms
from registration.cpd import CoherentPointDrift
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import read_centerline_table, write_centerline
from registration.io.landmarks import Landmarks, read_landmarks, write_landmarks
from registration.io.surfaces import read_surface, write_surface
from registration.io.transforms import write_transform
from registration.metrics.surface_distance import SurfaceDistance, rms
from registration.rigid.comparators import SingleStartICP
from registration.rigid.multi_start import MultiStartICP

TUBE = bent_tube()
MIDDLE_MM = TUBE.vertices_mm.mean(axis=0)
AXIS = np.linalg.svd(TUBE.vertices_mm - MIDDLE_MM, full_matrices=False)[2]
POSE = transforms.from_rotation(Rotation.from_rotvec([0.1, -0.05, 0.08]), np.array([3.0, -2.0, 1.0]))
FILES = {
    "Data",
    "displacement.h5",
    "displacement.npz",
    "displacement.nrrd",
    "fixed_T_moving.h5",
    "model_deformed.ply",
    "moved.ply",
    "moved_deformed.ply",
    "registration.json",
    "scene.html",
    "scene.mrml",
}


def bend(points_mm: np.ndarray) -> np.ndarray:
    along = (points_mm - MIDDLE_MM) @ AXIS[0] / 35.0
    return 2.0 * np.outer(np.cos(np.pi * along), AXIS[1])


BENT = Mesh(TUBE.vertices_mm + bend(TUBE.vertices_mm), TUBE.triangles)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    swept = Mesh(transforms.apply(transforms.invert_rigid(POSE), BENT.vertices_mm), BENT.triangles)
    model = Mesh(transforms.apply(transforms.invert_rigid(POSE), TUBE.vertices_mm), TUBE.triangles)
    for name, mesh in (("swept", swept), ("model_moving", model), ("model", TUBE), ("bent", BENT)):
        write_surface(tmp_path / f"{name}.ply", mesh)
    write_transform(tmp_path / "near.h5", POSE)
    (tmp_path / "out").mkdir()
    return tmp_path


def run(folder: Path, moving: str, fixed: str, **change: Any) -> tuple[Outcome, dict[str, Any]]:
    nothing = (
        "landmark_deviation_mm",
        "search_cone_deg",
        "search_radius_mm",
        "truth",
        "moving_landmarks",
        "fixed_landmarks",
    )
    nothing += (
        "moving_centerline",
        "fixed_centerline",
        "moving_unit",
        "fixed_unit",
        "moving_space",
        "fixed_space",
    )
    given = {
        "moving": str(folder / f"{moving}.ply"),
        "fixed": str(folder / f"{fixed}.ply"),
        "rigid": {"single_icp": SingleStartICP()},
        "deformable": {"cpd": CoherentPointDrift()},
        "model_side": "fixed",
        "carry": [],
        "slicer": "scene",
        "initial": str(folder / "near.h5"),
        **dict.fromkeys(nothing),
        "moving_points": 2500,
        "fixed_points": 4000,
        "inlier_mm": 1.0,
        "keep": 0.9,
        "seed": 0,
        "workspace": folder / "out",
        "progress": Silent(),
    } | change
    outcome = register.run(**given)
    return outcome, json.loads((folder / "out" / "registration.json").read_text())


@pytest.mark.parametrize("side", ["fixed", "moving"])
def test_either_side_is_the_model(folder: Path, side: str) -> None:
    moving, fixed = ("swept", "model") if side == "fixed" else ("model_moving", "bent")
    outcome, told = run(folder, moving, fixed, model_side=side)
    block = told["deformable"]
    assert {path.name for path in (folder / "out").iterdir()} == FILES
    assert (block["method"], block["model_side"], block["verdict"]) == ("cpd", side, "deformed")
    assert block["rmse_mm"] < 0.5 * told["rmse_mm"]
    assert block["jacobian_min"] > 0 and 0 < block["strain_p95"] < 0.3
    assert 0 < block["predicted_tre_mm"]["low"] < block["predicted_tre_mm"]["high"] < 2.0
    assert outcome.metrics["deformed_rmse_mm"] == block["rmse_mm"]
    assert any("Deformable registration (cpd)" in sentence for sentence in outcome.findings)
    moved = read_surface(folder / "out" / "moved_deformed.ply")
    rigid = read_surface(folder / "out" / "moved.ply")
    to_fixed = SurfaceDistance(read_surface(folder / f"{fixed}.ply"))
    assert rms(to_fixed(moved.vertices_mm)) < 0.5 * rms(to_fixed(rigid.vertices_mm))
    model = read_surface(folder / "out" / "model_deformed.ply")
    # The sweep in the rigid pose; the ends of a tube may slide, for nothing along the wall holds them.
    swept = rigid if side == "fixed" else read_surface(folder / "bent.ply")
    assert np.median(SurfaceDistance(swept)(model.vertices_mm)) < 0.1
    before = TUBE if side == "fixed" else rigid
    material_mm = [
        rms(np.linalg.norm(one.vertices_mm - swept.vertices_mm, axis=1)) for one in (before, model)
    ]
    assert material_mm[1] < material_mm[0]


def test_the_files_of_the_displacement_agree(folder: Path) -> None:
    run(folder, "swept", "model")
    stored = np.load(folder / "out" / "displacement.npz")
    image = SimpleITK.ReadImage(str(folder / "out" / "displacement.nrrd"), SimpleITK.sitkVectorFloat64)
    field = SimpleITK.DisplacementFieldTransform(image)
    read = SimpleITK.ReadTransform(str(folder / "out" / "displacement.h5"))
    for point_mm, shift_mm in zip(stored["points_mm"][::200], stored["displacement_mm"][::200], strict=True):
        for transform in (field, read):
            np.testing.assert_allclose(transform.TransformPoint(point_mm), point_mm + shift_mm, atol=0.05)
    model = read_surface(folder / "out" / "model_deformed.ply")
    np.testing.assert_allclose(model.vertices_mm, stored["points_mm"] + stored["displacement_mm"], atol=1e-4)


def test_where_nothing_deforms_both_stages_are_one(folder: Path) -> None:
    outcome, told = run(folder, "model_moving", "model")
    assert told["deformable"]["verdict"] == "rigid stands"
    moved, deformed = (read_surface(folder / "out" / f"{name}.ply") for name in ("moved", "moved_deformed"))
    np.testing.assert_allclose(deformed.vertices_mm, moved.vertices_mm, atol=1e-4)
    assert any("the clouds show no deformation" in sentence for sentence in outcome.findings)


def test_without_it_there_is_no_block_and_no_file(folder: Path) -> None:
    outcome, told = run(folder, "swept", "model", deformable={"none": None})
    assert told["deformable"] is None
    assert not (folder / "out" / "moved_deformed.ply").exists()
    assert not any(name.startswith("deformed") for name in outcome.metrics)


def test_what_the_stage_refuses_leaves_the_rigid_result(folder: Path) -> None:
    few = TUBE.vertices_mm[:: len(TUBE.vertices_mm) // 30]
    write_surface(folder / "few.ply", transforms.apply(transforms.invert_rigid(POSE), few))
    outcome, told = run(folder, "few", "model")
    assert told["deformable"] is None and told["fixed_T_moving"] is not None
    assert any(
        sentence.startswith("No deformable registration followed: moving: expected at least 50 points")
        for sentence in outcome.findings
    )
    assert not (folder / "out" / "moved_deformed.ply").exists()


def test_no_stage_follows_a_rigid_one_that_failed(folder: Path) -> None:
    rng = np.random.default_rng(0)
    write_surface(folder / "blob.ply", rng.uniform(-40.0, 40.0, (1500, 3)))
    outcome, told = run(folder, "blob", "model", rigid={"multistart": MultiStartICP()}, initial=None)
    assert told["verdict"] == "failed" and told["deformable"] is None
    assert "No deformable registration followed: the rigid registration failed." in outcome.findings


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match="model_side: expected fixed, moving or null, received 'left'"):
        require_side("left")
    with pytest.raises(InputError, match="deformable: expected exactly one method"):
        one_method({"cpd": CoherentPointDrift(), "none": None}, "deformable")


@pytest.mark.parametrize("option", ["none", "cpd", "cpd_point"])
def test_the_options_build(option: str) -> None:
    ((job, _),) = compose_sweep(["study=register", "moving=a.ply", "fixed=b.ply", f"deformable={option}"])
    name, method = one_method(registry.build(job["deformable"], "deformable"), "deformable")
    assert name == option
    assert (method is None) == (option == "none")
    if option == "cpd":
        assert method == CoherentPointDrift()
    if option == "cpd_point":
        assert method == CoherentPointDrift("point")


def marked(folder: Path, moving_of_model: bool) -> dict[str, Any]:
    """Landmarks on the axis of the tube, as both sides have them, and a centerline of the model next to it."""
    own_mm = MIDDLE_MM + np.linspace(-25, 25, 5)[:, None] * AXIS[0] + np.array([[0, 0, 0], [0, 3, 0]] * 3)[:5]
    there_mm = own_mm + bend(own_mm)
    world_mm = transforms.apply(transforms.invert_rigid(POSE), own_mm if moving_of_model else there_mm)
    names = tuple("abcde")
    write_landmarks(folder / "moving.mrk.json", Landmarks(names, world_mm))
    write_landmarks(folder / "fixed.mrk.json", Landmarks(names, there_mm if moving_of_model else own_mm))
    line_mm = transforms.apply(transforms.invert_rigid(POSE), own_mm) if moving_of_model else own_mm
    model = "model_moving" if moving_of_model else "model"
    write_centerline(folder / f"{model}_line.csv", Centerline((Polyline(line_mm, np.ones(5)),)))
    write_surface(folder / "plaque.ply", line_mm + 0.5)
    side = "moving" if moving_of_model else "fixed"
    return {
        "moving_landmarks": str(folder / "moving.mrk.json"),
        "fixed_landmarks": str(folder / "fixed.mrk.json"),
        f"{side}_centerline": str(folder / f"{model}_line.csv"),
        "carry": [str(folder / "plaque.ply")],
    }


def in_slicer(out: Path, model_side: str) -> None:
    """The scene for 3D Slicer shows all of it; under the displacement the model lies where the sweep has seen it."""
    shown, moves = read_scene(out / "scene.mrml")
    ends = ("fixed", "moved")
    expected = {"fixed", "moving, as given", "moved", "moved, deformed", "model, deformed", "plaque_carried"}
    expected |= {f"centerline, {'fixed' if model_side == 'fixed' else 'moved'}", "centerline_deformed"}
    assert set(shown) == expected | {f"landmarks, {end}" for end in ends} | {"landmarks_deformed"}
    model = shown["fixed" if model_side == "fixed" else "moved"].points_mm.astype(np.float64)
    there = [moves["displacement of the model"].TransformPoint(point.tolist()) for point in model]
    np.testing.assert_allclose(there, shown["model, deformed"].points_mm, atol=0.1)
    assert np.abs(model - shown["model, deformed"].points_mm).max() > 0.5
    names = ("landmarks, fixed", "landmarks, moved")
    apart_mm = np.linalg.norm(shown[names[0]].points_mm - shown[names[1]].points_mm, axis=1)
    assert len(apart_mm) == 5 and apart_mm.max() < 5.0


@pytest.mark.parametrize("side", ["fixed", "moving"])
def test_centerline_landmarks_and_other_surfaces_are_carried_along(folder: Path, side: str) -> None:
    moving, fixed = ("swept", "model") if side == "fixed" else ("model_moving", "bent")
    outcome, told = run(folder, moving, fixed, model_side=side, **marked(folder, side == "moving"))
    block = told["deformable"]
    carried = [*CENTERLINES, "landmarks_deformed.mrk.json", "plaque_carried.ply"]
    assert block["carried"] == carried
    assert FILES | set(carried) == {path.name for path in (folder / "out").iterdir()}
    # Not used as constraints they measure the error, which the deformable stage lowers.
    assert block["landmarks"]["constraints"] is False
    assert block["landmarks"]["error_mm"] < 0.9 * told["landmarks"]["error_mm"]
    assert outcome.metrics["deformed_landmark_error_mm"] == pytest.approx(block["landmarks"]["error_mm"])
    in_slicer(folder / "out", model_side=side)
    # All three lie where the landmarks of the sweep do, by one field.
    marks = read_landmarks(folder / "out" / "landmarks_deformed.mrk.json")
    assert marks.names == tuple("abcde")
    (line,) = read_centerline_table(folder / "out" / "centerline_deformed.csv").lines
    np.testing.assert_allclose(line.points_mm, marks.points_mm, atol=1e-4)
    plaque_mm = np.asarray(read_surface(folder / "out" / "plaque_carried.ply"))
    np.testing.assert_allclose(
        np.linalg.norm(plaque_mm - marks.points_mm, axis=1), 0.5 * np.sqrt(3), atol=0.1
    )
    pose = np.array(told["fixed_T_moving"])
    sweep = read_landmarks(folder / ("moving.mrk.json" if side == "fixed" else "fixed.mrk.json")).points_mm
    there_mm = transforms.apply(pose, sweep) if side == "fixed" else sweep
    assert rms(np.linalg.norm(marks.points_mm - there_mm, axis=1)) == pytest.approx(
        block["landmarks"]["error_mm"]
    )


def test_landmarks_that_pull_are_no_error_any_more(folder: Path) -> None:
    given = marked(folder, False)
    _, free = run(folder, "swept", "model", **given)
    outcome, told = run(folder, "swept", "model", **given, landmark_deviation_mm=0.1)
    block = told["deformable"]["landmarks"]
    assert block["constraints"] is True and block["deviation_mm"] == 0.1
    assert block["error_mm"] < free["deformable"]["landmarks"]["error_mm"]
    assert any("this is a residual and no error" in finding for finding in outcome.findings)


def test_constraints_and_carried_surfaces_that_are_none_are_refused(folder: Path) -> None:
    pair = read_pair(
        SideFiles("moving", str(folder / "swept.ply")), SideFiles("fixed", str(folder / "model.ply"))
    )
    with pytest.raises(
        InputError, match="landmark_deviation_mm: expected moving_landmarks and fixed_landmarks"
    ):
        require_constraints(0.5, pair)
    with pytest.raises(RegistrationInputError, match="landmark_deviation_mm"):
        require_constraints(-1.0, pair)
    model = SideFiles("fixed", str(folder / "model.ply"))
    plaque = str(folder / "bent.ply")
    with pytest.raises(InputError, match="carry: expected files of different names, received bent twice"):
        read_carried([plaque, plaque], model)
    with pytest.raises(InputError, match="carry: expected a list of files"):
        read_carried(plaque, model)
    with pytest.raises(InputError, match=r"nothing\.ply"):
        read_carried([str(folder / "nothing.ply")], model)
