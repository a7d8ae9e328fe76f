"""Tubes of known axis from files of several kinds, axes and units; ends given by landmarks; refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hollow_bodies import hollow, ring
from tubes import straight, tube

from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.running import jobs
from experiments.studies.centerline import study as centerline
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Mesh
from registration.io.centerlines import read_centerline_table
from registration.io.patient_space import write_model
from registration.io.surfaces import read_centerline, read_surface, write_surface

AXIS_MM = straight()
RADIUS_MM = 4.0
TUBE = tube(AXIS_MM, RADIUS_MM)
FILES = {"centerline.vtp", "centerline.csv", "centerline.mrk.json", "centerline.json", "scene.html"}
MIRRORED = np.array([-1.0, -1.0, 1.0])


def run(workspace: Path, mesh: Path, **changes: Any) -> Outcome:
    ((config, _),) = compose_sweep(["study=centerline", f"mesh='{mesh}'"])
    workspace.mkdir()
    settings = jobs.arguments(config) | changes
    asked = {name: settings[name] for name in ("mesh", "ends", "space", "units")}
    centerline.check(**asked)
    return centerline.run(**settings, workspace=workspace, progress=Silent())


def markups(path: Path, points_mm: np.ndarray) -> str:
    points = [{"label": f"end {row}", "position": point} for row, point in enumerate(points_mm.tolist())]
    content = {"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points}]}
    path.write_text(json.dumps(content))
    return str(path)


def off_axis_mm(points_mm: np.ndarray) -> np.ndarray:
    along = (AXIS_MM[-1] - AXIS_MM[0]) / np.linalg.norm(AXIS_MM[-1] - AXIS_MM[0])
    away_mm = points_mm - AXIS_MM[0]
    return np.linalg.norm(away_mm - (away_mm @ along)[:, None] * along, axis=1)


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    write_model(tmp_path / "tube.stl", TUBE)
    return tmp_path / "tube.stl"


def test_the_axis_of_a_tube_in_every_file(tmp_path: Path, mesh: Path) -> None:
    out = tmp_path / "out"
    outcome = run(out, mesh)
    assert {path.name for path in out.iterdir()} == FILES
    (line,) = read_centerline_table(out / "centerline.csv").lines
    assert off_axis_mm(line.points_mm).max() < 0.02 * RADIUS_MM
    assert line.length_mm == pytest.approx(40.0, rel=0.01)
    # A tube of 32 sides is narrower at their middles.
    np.testing.assert_allclose(line.radius_mm, RADIUS_MM * np.cos(np.pi / 32), atol=0.03)
    np.testing.assert_allclose(
        read_centerline(out / "centerline.vtp").lines[0].points_mm, line.points_mm, atol=1e-3
    )
    (curve,) = json.loads((out / "centerline.mrk.json").read_text())["markups"]
    assert (curve["type"], curve["coordinateSystem"], curve["coordinateUnits"]) == ("Curve", "LPS", "mm")
    positions_mm = np.array([point["position"] for point in curve["controlPoints"]])
    np.testing.assert_allclose(positions_mm, line.points_mm, atol=1e-5)
    report = json.loads((out / "centerline.json").read_text())
    assert report["lines"][0]["length_mm"] == pytest.approx(line.length_mm, abs=1e-3)
    assert (report["ends"], report["input_space"], report["quality"]["open_ends"]) == ("found", "lps", 2)
    assert outcome.cases is not None
    assert len(outcome.cases) == len(line.points_mm)
    assert outcome.metrics["length_mm"] == pytest.approx(line.length_mm, abs=1e-3)


def test_a_header_in_ras_is_obeyed(tmp_path: Path) -> None:
    write_model(tmp_path / "tube.ply", Mesh(TUBE.vertices_mm * MIRRORED, TUBE.triangles), "ras")
    run(tmp_path / "out", tmp_path / "tube.ply")
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    assert off_axis_mm(line.points_mm).max() < 0.02 * RADIUS_MM
    with pytest.raises(InputError, match=r"space: expected ras, as the header of .* says, received lps"):
        centerline.check(mesh=str(tmp_path / "tube.ply"), ends=None, space="lps", units=None)


def test_given_ends_set_the_line_and_its_direction(tmp_path: Path, mesh: Path) -> None:
    ends_mm = np.stack([AXIS_MM[40], AXIS_MM[5]])
    run(tmp_path / "out", mesh, ends=markups(tmp_path / "ends.mrk.json", ends_mm))
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    np.testing.assert_allclose(line.points_mm[[0, -1]], ends_mm, atol=1e-4)
    outside = markups(tmp_path / "outside.mrk.json", ends_mm + 20.0)
    with pytest.raises(RegistrationInputError, match="ends_mm: expected at least two points inside"):
        run(tmp_path / "other", mesh, ends=outside)


def test_a_cloud_becomes_a_surface_first(tmp_path: Path) -> None:
    write_surface(tmp_path / "tube.xyz", TUBE.sample(6000, np.random.default_rng(0)))
    run(tmp_path / "out", tmp_path / "tube.xyz")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES | {"surface.ply"}
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    assert np.percentile(off_axis_mm(line.points_mm), 95) < 0.1
    assert line.length_mm == pytest.approx(40.0, rel=0.02)
    assert isinstance(read_surface(tmp_path / "out" / "surface.ply"), Mesh)


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_metres_are_suspected_and_converted_when_said(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "small.ply"
    small = Mesh(TUBE.vertices_mm / 1000, TUBE.triangles)
    write_surface(path, small if kind == "mesh" else small.sample(6000, np.random.default_rng(0)))
    with pytest.raises(
        (InputError, RegistrationInputError), match=r"expected a vessel in millimetres.*units=m "
    ):
        run(tmp_path / "refused", path)
    run(tmp_path / "out", path, units="m")
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    assert line.length_mm == pytest.approx(40.0, rel=0.02)


def test_unknown_settings_and_missing_files_are_refused(tmp_path: Path, mesh: Path) -> None:
    here: dict[str, Any] = {"mesh": str(mesh), "ends": None, "space": None, "units": None}
    refusals: dict[str, dict[str, Any]] = {
        "mesh: .*absent.stl: expected a file, received nothing there": {"mesh": "absent.stl"},
        "ends: .*absent.fcsv: expected a file": {"ends": "absent.fcsv"},
        "space: expected lps, ras or null, received 'lsp'": {"space": "lsp"},
        "units: expected mm, cm, m or null, received 'inch'": {"units": "inch"},
    }
    for message, change in refusals.items():
        with pytest.raises(InputError, match=message):
            centerline.check(**(here | change))


def test_a_printed_hollow_phantom_has_the_line_of_its_lumen(tmp_path: Path) -> None:
    write_model(tmp_path / "phantom.stl", hollow(AXIS_MM, 6.0, RADIUS_MM))
    outcome = run(tmp_path / "out", tmp_path / "phantom.stl")
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    assert off_axis_mm(line.points_mm).max() < 0.1 * RADIUS_MM
    assert line.length_mm == pytest.approx(40.0, rel=0.02)
    report = json.loads((tmp_path / "out" / "centerline.json").read_text())
    assert report["lumen"] == {"walls_joined": True, "genus": 1}
    assert outcome.findings[0] == (
        "The surface is a hollow body, its outer and inner wall joined to one surface of genus 1: the inner wall was "
        "taken, the lumen's."
    )
    assert outcome.findings[1] == f"1 line of {line.length_mm:.1f} mm from phantom.stl."


def test_a_vessel_that_closes_to_a_loop_is_refused(tmp_path: Path) -> None:
    write_model(tmp_path / "ring.stl", ring(20.0, 4.0))
    with pytest.raises(RegistrationInputError, match="closes to a loop"):
        run(tmp_path / "out", tmp_path / "ring.stl")
