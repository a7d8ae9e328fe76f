"""Cases go to files and come back; what is missing or broken is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmark_cases import drawn_case

from registration.benchmark.case_files import (
    case_names,
    read_case,
    truth_file,
    write_case,
    written_digest,
)
from registration.benchmark.cases import digest
from registration.errors import InputError
from registration.io.surfaces import write_surface

CASE, TRUTH = drawn_case()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_case(tmp_path, CASE, TRUTH)
    return tmp_path


def test_a_case_comes_back_as_it_was(folder: Path) -> None:
    found = read_case(folder / CASE.name)
    assert (found.name, found.anatomy, found.kind) == (CASE.name, CASE.anatomy, CASE.kind)
    np.testing.assert_allclose(found.moving_mm, CASE.moving_mm, atol=1e-4)
    np.testing.assert_allclose(found.moving_normals, CASE.moving_normals, atol=1e-6)
    np.testing.assert_array_equal(found.moving_frame, CASE.moving_frame)
    np.testing.assert_allclose(found.fixed.vertices_mm, CASE.fixed.vertices_mm, atol=1e-6)
    np.testing.assert_array_equal(found.fixed.triangles, CASE.fixed.triangles)
    np.testing.assert_allclose(found.fixed_mm, CASE.fixed_mm, atol=1e-6)


def test_centerlines_and_a_known_pose_come_back_where_a_case_gives_them(folder: Path) -> None:
    bare = read_case(folder / CASE.name)
    assert bare.initial is None and bare.moving_centerline_mm is None and bare.fixed_centerline_mm is None
    rng = np.random.default_rng(0)
    given = replace(
        CASE,
        name="given",
        moving_centerline_mm=rng.normal(size=(5, 3)),
        fixed_centerline_mm=rng.normal(size=(7, 3)),
        initial=TRUTH.fixed_T_moving,
    )
    write_case(folder, given, replace(TRUTH, name="given"))
    found = read_case(folder / "given")
    for name in ("moving_centerline_mm", "fixed_centerline_mm", "initial"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    about = folder / "given" / "case.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"initial": [[1.0]]}))
    with pytest.raises(InputError, match=r"given/case.json: expected initial as numbers"):
        read_case(folder / "given")


def test_the_truth_lies_apart_and_names_are_those_of_the_cases(folder: Path) -> None:
    assert case_names(folder) == [CASE.name]
    assert truth_file(folder, CASE.name) == folder / "truth" / f"{CASE.name}.json"
    beside = "".join(path.read_text() for path in (folder / CASE.name).glob("*.json"))
    assert "fixed_T_moving" not in beside
    assert "angle_deg" not in beside


def test_the_digest_is_that_of_the_case_and_none_without_it(folder: Path) -> None:
    assert written_digest(folder, CASE.name) == digest(CASE, TRUTH)
    assert written_digest(folder, "another") is None
    truth_file(folder, CASE.name).unlink()
    assert written_digest(folder, CASE.name) is None


def test_broken_cases_are_named(folder: Path, tmp_path: Path) -> None:
    case = folder / CASE.name
    with pytest.raises(InputError, match=r"another/case.json: expected a file, received nothing there"):
        read_case(folder / "another")
    write_surface(case / "fixed.ply", CASE.fixed_mm)
    with pytest.raises(InputError, match=r"fixed.ply: expected a mesh, received points alone"):
        read_case(case)
    write_surface(case / "fixed.ply", CASE.fixed)
    write_surface(case / "fixed_points.ply", CASE.fixed)
    with pytest.raises(InputError, match=r"fixed_points.ply: expected points alone, received a mesh"):
        read_case(case)
    write_surface(case / "fixed_points.ply", CASE.fixed_mm)
    write_surface(case / "moving.ply", CASE.moving_mm)
    with pytest.raises(InputError, match=r"moving.ply: expected points with normals and frames"):
        read_case(case)
    (case / "case.json").write_text(json.dumps({"case": "x"}))
    with pytest.raises(InputError, match=r"case.json: expected anatomy, kind as text"):
        read_case(case)
