"""Registering two files: the pose, the keys, the moved surface, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK
from scipy.spatial.transform import Rotation
from tubes import tube
from vessels import bent_tube

from experiments import registry
from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies.register import study as register
from registration import transforms
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import write_centerline
from registration.io.patient_space import write_model
from registration.io.surfaces import read_surface, write_surface
from registration.io.transforms import write_transform
from registration.perturbation.perturbation import Piece
from registration.rigid.comparators import SingleStartICP
from registration.rigid.multi_start import MultiStartICP

TUBE = bent_tube()
POSE = transforms.from_rotation(Rotation.from_rotvec([2.4, -0.9, 1.0]), np.array([-60.0, 200, 15]))
MOVED = Mesh(transforms.apply(transforms.invert_rigid(POSE), TUBE.vertices_mm), TUBE.triangles)
KEYS = {
    "moving",
    "fixed",
    "rigid",
    "units",
    "space",
    "moving_space",
    "fixed_space",
    "fixed_T_moving",
    "rmse_mm",
    "rmse_trimmed_mm",
    "rmse_bidirectional_mm",
    "msd_mm",
    "hd95_mm",
    "inlier_share",
    "coverage",
    "distances_to",
    "iterations",
    "converged",
    "verdict",
    "reason",
    "ambiguity_gap",
    "weak_directions",
    "rival_fixed_T_moving",
    "overlap_share",
    "wall_offset_mm",
    "predicted_tre_mm",
    "measured_tre_mm",
    "deformation",
    "probability_right_vessel",
    "initial",
    "centerlines",
    "landmarks",
    "deformable",
    "candidates",
    "runtime_s",
}
FILES = ["Data", "fixed_T_moving.h5", "moved.ply", "registration.json", "scene.html", "scene.mrml"]
# What a user may give besides the files and the method, in the order of the configuration.
GIVEN = (
    "moving",
    "fixed",
    "rigid",
    "deformable",
    "model_side",
    "landmark_deviation_mm",
    "carry",
    "initial",
    "search_cone_deg",
    "search_radius_mm",
    "truth",
    "moving_landmarks",
    "fixed_landmarks",
    "moving_centerline",
    "fixed_centerline",
    "moving_unit",
    "fixed_unit",
    "moving_space",
    "fixed_space",
    "slicer",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_surface(tmp_path / "moving.ply", MOVED)
    write_surface(tmp_path / "fixed.ply", TUBE)
    (tmp_path / "out").mkdir()
    return tmp_path


def settings(folder: Path, **change: Any) -> dict[str, Any]:
    return {
        "moving": str(folder / "moving.ply"),
        "fixed": str(folder / "fixed.ply"),
        "rigid": {"multistart": MultiStartICP()},
        "deformable": {"none": None},
        **dict.fromkeys(GIVEN[4:]),
        "carry": [],
        "slicer": "scene",
        "moving_points": 1200,
        "fixed_points": 2500,
        "inlier_mm": 1.0,
        "keep": 0.9,
        "seed": 0,
        "workspace": folder / "out",
        "progress": Silent(),
    } | change


def run(folder: Path, **change: Any) -> tuple[Outcome, dict[str, Any]]:
    outcome = register.run(**settings(folder, **change))
    return outcome, json.loads((folder / "out" / "registration.json").read_text())


def check(folder: Path, **change: Any) -> None:
    given = settings(folder, **change)
    register.check(**{name: given[name] for name in GIVEN})


def write_landmarks(path: Path, points_mm: np.ndarray) -> None:
    control = [{"label": f"F-{row}", "position": point} for row, point in enumerate(points_mm.tolist())]
    path.write_text(json.dumps({"markups": [{"coordinateSystem": "LPS", "controlPoints": control}]}))


def apart_mm(matrix: list[list[float]], expected: np.ndarray = POSE, surface: Mesh = MOVED) -> float:
    found = transforms.apply(np.array(matrix), surface.vertices_mm)
    return float(np.linalg.norm(found - transforms.apply(expected, surface.vertices_mm), axis=1).max())


def test_two_meshes_of_one_vessel_meet(folder: Path) -> None:
    outcome, record = run(folder)
    assert apart_mm(record["fixed_T_moving"]) < 0.2
    assert set(record) == KEYS
    assert record["rmse_trimmed_mm"] <= record["rmse_mm"] < 0.1
    assert record["hd95_mm"] < 0.2
    assert (record["inlier_share"], record["coverage"], record["converged"]) == (1, 1, True)
    assert (record["rigid"], record["distances_to"]) == ("multistart", "triangles")
    assert record["candidates"][0]["fixed_T_moving"] == record["fixed_T_moving"]
    assert outcome.metrics["rmse_mm"] == record["rmse_mm"]
    assert sorted(path.name for path in (folder / "out").iterdir()) == FILES
    assert [data.name for data in outcome.inputs] == ["moving.ply", "fixed.ply"]


def test_the_moved_surface_has_every_vertex_and_triangle(folder: Path) -> None:
    _, record = run(folder)
    moved = read_surface(folder / "out" / "moved.ply")
    assert isinstance(moved, Mesh)
    np.testing.assert_array_equal(moved.triangles, MOVED.triangles)
    expected = transforms.apply(np.array(record["fixed_T_moving"]), MOVED.vertices_mm)
    np.testing.assert_allclose(moved.vertices_mm, expected, atol=1e-9)


def test_a_piece_as_a_cloud_onto_a_cloud(folder: Path) -> None:
    piece = TUBE.vertices_mm[Piece(0.6, "start").contains(TUBE.vertices_mm, TUBE)]
    own = transforms.apply(transforms.invert_rigid(POSE), piece)
    write_surface(folder / "piece.xyz", own)
    write_surface(folder / "cloud.ply", TUBE.sample(4000, np.random.default_rng(1)))
    _, record = run(folder, moving=str(folder / "piece.xyz"), fixed=str(folder / "cloud.ply"))
    assert apart_mm(record["fixed_T_moving"]) < 1.0
    assert record["distances_to"] == "points"
    assert record["coverage"] < 0.85 < record["inlier_share"]
    np.testing.assert_allclose(
        read_surface(folder / "out" / "moved.ply"),
        transforms.apply(np.array(record["fixed_T_moving"]), own),
        atol=1e-6,
    )


def test_metres_are_refused_with_a_hint_and_converted_when_said(folder: Path) -> None:
    write_surface(folder / "metres.ply", Mesh(MOVED.vertices_mm / 1000, MOVED.triangles))
    for name, given in (("moving", {"moving": "metres.ply"}), ("fixed", {"fixed": "metres.ply"})):
        change = {key: str(folder / value) for key, value in given.items()}
        with pytest.raises(InputError, match=f"{name}: expected millimetres.*pass {name}_unit=m") as refusal:
            check(folder, **change)
        assert "\n" not in str(refusal.value)
    _, record = run(folder, moving=str(folder / "metres.ply"), moving_unit="m")
    assert apart_mm(record["fixed_T_moving"]) < 0.2
    moved = read_surface(folder / "out" / "moved.ply")
    assert isinstance(moved, Mesh)
    assert np.ptp(moved.vertices_mm, axis=0).max() > 30


def test_a_tiny_vessel_is_taken_as_it_is_when_said(folder: Path) -> None:
    write_surface(folder / "tiny.ply", Mesh(MOVED.vertices_mm / 1000, MOVED.triangles))
    check(folder, moving=str(folder / "tiny.ply"), moving_unit="mm")


def test_a_known_pose_is_where_the_search_begins(folder: Path) -> None:
    near = transforms.compose(transforms.translation((1.0, 1.0, -1.0)), POSE)
    (folder / "near.json").write_text(json.dumps({"fixed_T_moving": near.tolist()}))
    single = {"single_icp": SingleStartICP()}
    _, without = run(folder, rigid=single)
    _, record = run(folder, rigid=single, initial=str(folder / "near.json"))
    assert apart_mm(record["fixed_T_moving"]) < 1 < apart_mm(without["fixed_T_moving"])


def test_a_method_that_stops_early_says_so(folder: Path) -> None:
    outcome, record = run(folder, rigid={"single_icp": SingleStartICP(max_iterations=1)})
    assert record["converged"] is False
    assert any("before it converged" in sentence for sentence in outcome.findings)


def test_it_is_deterministic(folder: Path) -> None:
    _, one = run(folder)
    _, two = run(folder)
    assert one["fixed_T_moving"] == two["fixed_T_moving"]
    assert one["rmse_bidirectional_mm"] == two["rmse_bidirectional_mm"]


@pytest.mark.parametrize(
    "change, message",
    [
        ({"moving": None}, "moving: expected the file of the cloud or mesh to move, received none"),
        ({"fixed": ""}, "fixed: expected the file of the cloud or mesh to register to, received none"),
        ({"moving": "missing.ply"}, "moving: missing.ply: expected a file, received nothing there"),
        ({"initial": "missing.json"}, "initial: missing.json: expected a file, received nothing there"),
        ({"moving_space": "ijk"}, "moving_space: expected lps, ras or null, received 'ijk'"),
        (
            {"search_cone_deg": 20.0},
            "search_cone_deg: expected an initial pose or landmarks to search around",
        ),
        ({"moving_landmarks": "a.fcsv"}, "moving_landmarks: a.fcsv: expected a file, received nothing there"),
        (
            {"fixed_landmarks": "a.fcsv"},
            "moving_landmarks: expected a file next to fixed_landmarks, received none",
        ),
        ({"moving_centerline": "a.vtp"}, "moving_centerline: a.vtp: expected a file, received nothing there"),
        ({"moving_unit": "inch"}, "moving_unit: expected mm, cm, m or null, received 'inch'"),
        ({"rigid": {"a": None, "b": None}}, "rigid: expected exactly one method, received a, b"),
        ({"rigid": None}, "rigid: expected exactly one method, received None"),
    ],
)
def test_wrong_input_is_refused_and_leaves_nothing(
    folder: Path, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        check(folder, **change)
    with pytest.raises(InputError, match=message):
        run(folder, **change)
    assert not list((folder / "out").iterdir())


def test_an_empty_cloud_is_refused_by_name(folder: Path) -> None:
    (folder / "empty.xyz").write_text("")
    with pytest.raises(InputError, match=r"moving: .*empty\.xyz: expected a readable XYZ file with points"):
        check(folder, moving=str(folder / "empty.xyz"))


def test_a_mirrored_initial_pose_is_refused(folder: Path) -> None:
    (folder / "mirror.json").write_text(json.dumps({"fixed_T_moving": np.diag([1, 1, -1, 1]).tolist()}))
    with pytest.raises(InputError, match=r"initial: .*expected a right-handed rotation"):
        check(folder, initial=str(folder / "mirror.json"))


def test_itk_reads_the_pose_in_its_own_direction(folder: Path) -> None:
    """An ITK transform maps fixed to moving points; inverted, as 3D Slicer does, it brings the model over."""
    _, record = run(folder)
    transform = SimpleITK.ReadTransform(str(folder / "out" / "fixed_T_moving.h5"))
    for moving_point in MOVED.vertices_mm[::500]:
        fixed_point = transforms.apply(np.array(record["fixed_T_moving"]), moving_point)
        np.testing.assert_allclose(transform.TransformPoint(fixed_point.tolist()), moving_point, atol=1e-6)


@pytest.mark.parametrize("suffix", [".json", ".tfm", ".h5"])
def test_what_it_wrote_is_a_known_pose_for_the_next_call(folder: Path, suffix: str) -> None:
    if suffix == ".json":
        (folder / "near.json").write_text(json.dumps({"fixed_T_moving": POSE.tolist()}))
    else:
        write_transform(folder / f"near{suffix}", POSE)
    single = {"single_icp": SingleStartICP(max_iterations=3)}
    _, record = run(folder, rigid=single, initial=str(folder / f"near{suffix}"), search_cone_deg=15.0)
    assert apart_mm(record["fixed_T_moving"]) < 0.5
    assert record["initial"]["source"] == "file"
    assert (record["initial"]["search_cone_deg"], record["initial"]["search_radius_mm"]) == (15.0, 20.0)
    assert record["verdict"] == "not judged"


def test_the_search_keeps_to_the_cone(folder: Path) -> None:
    """The known pose is wrong by 60 mm, and the result may be 5 mm from it: it is not the right one, and says so."""
    wrong = transforms.compose(transforms.translation((0.0, 60.0, 0.0)), POSE)
    write_transform(folder / "wrong.tfm", wrong)
    single = {"single_icp": SingleStartICP()}
    outcome, record = run(folder, rigid=single, initial=str(folder / "wrong.tfm"), search_radius_mm=5.0)
    assert record["verdict"] == "failed"
    assert any("Verdict: failed, the method ended" in sentence for sentence in outcome.findings)
    assert outcome.tags["verdict"] == "failed"


def test_landmarks_are_where_the_search_begins_and_are_always_reported(folder: Path) -> None:
    fixed_mm = TUBE.vertices_mm[[0, 700, 1500, 2500]]
    moving_mm = transforms.apply(transforms.invert_rigid(POSE), fixed_mm)
    # Set by hand, a millimetre off in places of their own.
    moving_mm = moving_mm + np.random.default_rng(0).normal(size=moving_mm.shape)
    write_landmarks(folder / "moving.mrk.json", moving_mm)
    write_landmarks(folder / "fixed.mrk.json", fixed_mm)
    given = {
        name: str(folder / f"{name.partition('_')[0]}.mrk.json")
        for name in ("moving_landmarks", "fixed_landmarks")
    }
    single = {"single_icp": SingleStartICP()}
    _, without = run(folder, rigid=single)
    assert without["landmarks"] is None
    outcome, record = run(folder, rigid=single, **given)
    assert apart_mm(record["fixed_T_moving"]) < 1 < apart_mm(without["fixed_T_moving"])
    assert record["initial"]["source"] == "landmarks"
    expected = np.linalg.norm(
        transforms.apply(np.array(record["fixed_T_moving"]), moving_mm) - fixed_mm, axis=1
    )
    assert list(record["landmarks"]["errors_mm"]) == ["F-0", "F-1", "F-2", "F-3"]
    np.testing.assert_allclose(list(record["landmarks"]["errors_mm"].values()), expected, atol=1e-5)
    assert record["landmarks"]["error_mm"] == pytest.approx(np.sqrt((expected**2).mean()), abs=1e-5)
    assert outcome.metrics["landmark_error_max_mm"] == pytest.approx(expected.max(), abs=1e-5)
    assert any("4 landmarks lie" in sentence for sentence in outcome.findings)


def test_axes_that_are_wrong_are_absorbed_by_the_search_and_shown_by_landmarks(folder: Path) -> None:
    """The same shape in RAS numbers, read as LPS, is turned by 180 degrees: the surfaces meet, the landmarks do not."""
    write_surface(folder / "ras.ply", Mesh(MOVED.vertices_mm * [-1.0, -1.0, 1.0], MOVED.triangles))
    fixed_mm = TUBE.vertices_mm[[0, 700, 1500, 2500]]
    write_landmarks(folder / "moving.mrk.json", transforms.apply(transforms.invert_rigid(POSE), fixed_mm))
    write_landmarks(folder / "fixed.mrk.json", fixed_mm)
    given = {
        name: str(folder / f"{name.partition('_')[0]}.mrk.json")
        for name in ("moving_landmarks", "fixed_landmarks")
    }
    # A pose is given, so that the landmarks do not lead the search to the pose that they speak for.
    turned = transforms.compose(POSE, np.diag([-1.0, -1.0, 1.0, 1.0]))
    write_transform(folder / "turned.tfm", turned)
    given |= {"moving": str(folder / "ras.ply"), "initial": str(folder / "turned.tfm")}
    with pytest.raises(
        InputError, match=r"moving_space: expected the axes of .*; pass moving_space=ras or lps"
    ):
        check(folder, **given)
    outcome, wrong = run(folder, **given, moving_space="lps")
    assert wrong["rmse_mm"] < 0.1
    assert wrong["landmarks"]["error_mm"] > 50
    assert any("they contradict the surfaces" in sentence for sentence in outcome.findings)
    outcome, right = run(folder, **(given | {"initial": None}), moving_space="ras")
    assert right["rmse_mm"] < 0.1
    assert right["landmarks"]["error_mm"] < 0.3
    assert right["moving_space"] == "ras"
    assert not any("they contradict the surfaces" in sentence for sentence in outcome.findings)
    assert apart_mm(right["fixed_T_moving"]) < 0.2


def test_the_header_of_a_mesh_names_its_axes(folder: Path) -> None:
    write_model(folder / "ras.stl", Mesh(MOVED.vertices_mm * [-1.0, -1.0, 1.0], MOVED.triangles), "ras")
    _, record = run(folder, moving=str(folder / "ras.stl"))
    assert (record["moving_space"], record["fixed_space"]) == ("ras", "lps")
    assert apart_mm(record["fixed_T_moving"]) < 0.2
    moved = read_surface(folder / "out" / "moved.ply")
    assert isinstance(moved, Mesh)
    assert np.abs(moved.vertices_mm.mean(axis=0) - TUBE.vertices_mm.mean(axis=0)).max() < 0.5


def test_the_page_holds_before_after_and_the_distances(folder: Path) -> None:
    run(folder)
    page = (folder / "out" / "scene.html").read_text(encoding="utf-8")
    for text in (
        "moving, before",
        "moving, after",
        "Distance to fixed (mm)",
        "moving.ply on fixed.ply by multistart",
    ):
        assert text in page
    assert "https://" not in page.partition("<script")[0]


def test_a_piece_needs_no_setting(folder: Path) -> None:
    """40 % of the vessel, from one end, drawn anew, as a mesh without triangles."""
    piece = TUBE.sample(4000, np.random.default_rng(2))
    piece = piece[Piece(0.4, "end").contains(piece, TUBE)]
    write_surface(folder / "piece.ply", transforms.apply(transforms.invert_rigid(POSE), piece))
    _, record = run(folder, moving=str(folder / "piece.ply"))
    assert apart_mm(record["fixed_T_moving"]) < 1.0
    assert record["inlier_share"] > 0.99
    assert 0.3 < record["coverage"] < 0.6


@pytest.mark.parametrize(
    "points, message",
    [
        ("1 2 3\n4 nan 6\n7 8 9\n1 1 0\n", "expected finite coordinates, received 1 points with NaN"),
        ("1 1 1\n2 2 2\n3 3 3\n4 4 4\n", "expected points that span a surface, received points on one line"),
        ("1 1 1\n1 1 1\n1 1 1\n", "expected points that span a surface, received 3 equal points"),
        (
            "0 0 5\n9 0 5\n0 9 5\n9 9 5\n4 4 5\n",
            "moving: expected points around a vessel, received points in one plane",
        ),
        (
            "0 0 0\n3 0 3\n0 4 0\n3 4 3\n",
            "moving: expected points around a vessel, received points in one plane",
        ),
        ("", "expected a readable XYZ file with points, received none"),
        ("1 2\n", "expected rows of x y z"),
        (
            "0 0 0\n.5 0 0\n0 .5 0\n0 0 .5\n",
            r"moving: expected millimetres.*pass moving_unit=m to convert it",
        ),
    ],
    ids=["nan", "collinear", "equal", "plane", "oblique plane", "empty", "cut short", "a hundredth"],
)
def test_a_cloud_that_is_none_is_refused_in_one_sentence(folder: Path, points: str, message: str) -> None:
    (folder / "cloud.xyz").write_text(points)
    with pytest.raises(InputError, match=message) as refusal:
        check(folder, moving=str(folder / "cloud.xyz"))
    assert str(refusal.value).startswith("moving: ")
    assert "\n" not in str(refusal.value)


def test_centerlines_beside_both_files_are_used_and_named(folder: Path) -> None:
    rings = TUBE.vertices_mm[: 80 * 32].reshape(80, 32, 3).mean(axis=1)
    line = Centerline((Polyline(rings, np.full(80, 4.0)),))
    own = Centerline((Polyline(transforms.apply(transforms.invert_rigid(POSE), rings), np.full(80, 4.0)),))
    write_centerline(folder / "fixed-centerline.csv", line)
    write_centerline(folder / "moving-centerline.vtp", own)
    _, record = run(folder)
    assert apart_mm(record["fixed_T_moving"]) < 0.3
    assert record["centerlines"] == {
        "moving": str(folder / "moving-centerline.vtp"),
        "fixed": str(folder / "fixed-centerline.csv"),
    }
    _, without = run(folder, moving_centerline="none", fixed_centerline="none")
    assert without["centerlines"] == {"moving": None, "fixed": None}
    assert without["iterations"] != record["iterations"]


def test_a_straight_tube_is_ambiguous_with_its_centerlines_too(folder: Path) -> None:
    middle = np.stack([np.zeros(60), np.zeros(60), np.linspace(0.0, 80.0, 60)], axis=1)
    straight = tube(middle, 4.0)
    for name in ("moving", "fixed"):
        write_surface(folder / f"{name}.ply", straight)
        write_centerline(folder / f"{name}-centerline.csv", Centerline((Polyline(middle, np.full(60, 4.0)),)))
    outcome, record = run(folder)
    assert record["rmse_mm"] < 0.3
    assert record["verdict"] == "ambiguous"
    assert np.linalg.det(np.array(record["rival_fixed_T_moving"])[:3, :3]) == pytest.approx(1.0)
    page = next(folder.rglob("scene.html")).read_text()
    assert "moving, rival pose" in page
    assert page.index("Verdict: ambiguous") < page.index("mm RMSE")
    assert "roll" in record["weak_directions"]
    assert record["reason"]
    assert any("The clouds leave open: " in sentence for sentence in outcome.findings)


def test_the_verdict_gap_and_predicted_error_are_those_of_the_method(folder: Path) -> None:
    outcome, record = run(folder)
    assert record["verdict"] == "accepted"
    assert record["ambiguity_gap"] > 3
    assert 0 <= record["predicted_tre_mm"]["low"] <= record["predicted_tre_mm"]["high"] < 1
    assert outcome.metrics["predicted_tre_high_mm"] == record["predicted_tre_mm"]["high"]
    assert {"start_fixed_T_moving", "inlier_share", "coverage", "stage"} <= set(record["candidates"][0])
    assert len(record["candidates"]) == outcome.metrics["candidates"] > 1
    assert abs(record["wall_offset_mm"]) < 0.1
    assert not any("the fixed one everywhere" in sentence for sentence in outcome.findings)


def test_a_wall_that_was_drawn_outside_the_other_is_said(folder: Path) -> None:
    moving = read_surface(folder / "moving.ply")
    faces = moving.vertices_mm[moving.triangles]
    outward = np.zeros_like(moving.vertices_mm)
    facing = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    for corner in range(3):
        np.add.at(outward, moving.triangles[:, corner], facing)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # A surface that is wound outwards encloses a positive volume.
    outward *= np.sign(np.einsum("nk,nk->", faces[:, 0] - faces[:, 0].mean(axis=0), facing))
    write_surface(folder / "wide.ply", Mesh(moving.vertices_mm + 0.5 * outward, moving.triangles))
    outcome, record = run(folder, moving=str(folder / "wide.ply"))
    assert record["wall_offset_mm"] == pytest.approx(0.5, abs=0.1)
    assert apart_mm(record["fixed_T_moving"]) < 0.5
    assert any("outside the fixed one everywhere" in sentence for sentence in outcome.findings)


def test_a_file_cut_short_is_refused(folder: Path) -> None:
    whole = (folder / "moving.ply").read_bytes()
    (folder / "cut.ply").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"fixed: .*cut\.ply: expected \d+ bytes after the header"):
        check(folder, fixed=str(folder / "cut.ply"))


@pytest.mark.parametrize("name", ["gicp", "fpfh_ransac", "fpfh_fgr", "single_icp_plane", "cpd_rigid"])
def test_every_comparator_registers_two_files_as_configured(folder: Path, name: str) -> None:
    near = transforms.compose(
        POSE, transforms.rotate_about(Rotation.from_rotvec([0.1, 0.2, 0]), MOVED.vertices_mm.mean(axis=0))
    )
    write_transform(folder / "near.h5", near)
    ((config, _),) = compose_sweep(["study=register", "moving=a", "fixed=b", f"rigid={name}"])
    _, record = run(folder, rigid=registry.build(config["rigid"], "rigid"), initial=str(folder / "near.h5"))
    assert apart_mm(record["fixed_T_moving"]) < 0.3
    assert record["rigid"] == name
    assert record["ambiguity_gap"] is record["wall_offset_mm"] is None
    assert record["predicted_tre_mm"]["high"] is None


def test_the_open_and_the_closed_aorta(real_data: Path, folder: Path) -> None:
    vmtk = real_data / "vmtk"
    _, record = run(
        folder,
        moving=str(vmtk / "aorta-surface-open-ends.stl"),
        fixed=str(vmtk / "aorta-surface.stl"),
        fixed_points=5000,
    )
    opened = read_surface(vmtk / "aorta-surface-open-ends.stl")
    assert isinstance(opened, Mesh)
    assert apart_mm(record["fixed_T_moving"], np.eye(4), opened) < 0.1
    assert record["coverage"] < 0.95 < record["inlier_share"]


def test_where_the_truth_is_known_the_measured_error_stands_beside_the_predicted_one(folder: Path) -> None:
    """A truth that is 3 mm off along one axis: a good result lies so far from it at every target."""
    off = transforms.compose(transforms.translation((0.0, 0.0, 3.0)), POSE)
    truth = folder / "truth.json"
    truth.write_text(
        json.dumps({"fixed_T_moving": off.tolist(), "targets_mm": TUBE.vertices_mm[::50].tolist()})
    )
    outcome, record = run(folder, truth=str(truth))
    assert record["measured_tre_mm"] == pytest.approx(3.0, abs=0.2)
    assert outcome.metrics["tre_mm"] == record["measured_tre_mm"]
    assert any(
        sentence.startswith("Measured TRE ") and "truth.json" in sentence for sentence in outcome.findings
    )
    assert "Measured TRE" in (folder / "out" / "scene.html").read_text()
    _, without = run(folder)
    assert without["measured_tre_mm"] is None
    with pytest.raises(InputError, match=r"truth: .*nowhere\.json: expected a file, received nothing there"):
        check(folder, truth=str(folder / "nowhere.json"))
    truth.write_text(json.dumps({"fixed_T_moving": off.tolist(), "targets_mm": "none"}))
    with pytest.raises(InputError, match=r"truth: .*expected targets_mm as points"):
        check(folder, truth=str(truth))
