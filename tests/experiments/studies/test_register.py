"""Registering two files: the pose, the keys, the moved surface, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies import register
from registration import frames
from registration.comparators import SingleStartICP
from registration.geometry import Mesh
from registration.geometry_io import read_surface, write_surface
from registration.perturbation import Piece
from registration.rigid import MultiStartICP

TUBE = bent_tube()
POSE = frames.from_rotation(Rotation.from_rotvec([2.4, -0.9, 1.0]), np.array([-60.0, 200, 15]))
MOVED = Mesh(frames.apply(frames.invert_rigid(POSE), TUBE.vertices_mm), TUBE.triangles)
KEYS = {
    "moving",
    "fixed",
    "rigid",
    "units",
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
    "candidates",
    "runtime_s",
}


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
        "initial": None,
        "moving_unit": None,
        "fixed_unit": None,
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
    names = ("moving", "fixed", "rigid", "initial", "moving_unit", "fixed_unit")
    register.check(**{name: given[name] for name in names})


def apart_mm(matrix: list[list[float]], expected: np.ndarray = POSE, surface: Mesh = MOVED) -> float:
    found = frames.apply(np.array(matrix), surface.vertices_mm)
    return float(np.linalg.norm(found - frames.apply(expected, surface.vertices_mm), axis=1).max())


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
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["moved.ply", "registration.json"]
    assert [data.name for data in outcome.inputs] == ["moving.ply", "fixed.ply"]


def test_the_moved_surface_has_every_vertex_and_triangle(folder: Path) -> None:
    _, record = run(folder)
    moved = read_surface(folder / "out" / "moved.ply")
    assert isinstance(moved, Mesh)
    np.testing.assert_array_equal(moved.triangles, MOVED.triangles)
    expected = frames.apply(np.array(record["fixed_T_moving"]), MOVED.vertices_mm)
    np.testing.assert_allclose(moved.vertices_mm, expected, atol=1e-9)


def test_a_piece_as_a_cloud_onto_a_cloud(folder: Path) -> None:
    piece = TUBE.vertices_mm[Piece(0.6, "start").contains(TUBE.vertices_mm, TUBE)]
    own = frames.apply(frames.invert_rigid(POSE), piece)
    write_surface(folder / "piece.xyz", own)
    write_surface(folder / "cloud.ply", TUBE.sample(4000, np.random.default_rng(1)))
    _, record = run(folder, moving=str(folder / "piece.xyz"), fixed=str(folder / "cloud.ply"))
    assert apart_mm(record["fixed_T_moving"]) < 1.0
    assert record["distances_to"] == "points"
    assert record["coverage"] < 0.85 < record["inlier_share"]
    np.testing.assert_allclose(
        read_surface(folder / "out" / "moved.ply"),
        frames.apply(np.array(record["fixed_T_moving"]), own),
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
    near = frames.compose(frames.translation((1.0, 1.0, -1.0)), POSE)
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
        ({"initial": "missing.json"}, "initial: expected a JSON file with fixed_T_moving"),
        ({"moving_unit": "inch"}, "moving_unit: expected mm, m or null, received 'inch'"),
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
