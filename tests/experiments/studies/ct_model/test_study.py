"""From a user's file to the CT side's model: every file it leaves, what it says, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tubes import straight, tube
from vessels import bent_tube
from volumes import OBLIQUE, nrrd_bytes, voxel_axes, voxelised, write_volume

import experiments.errors
import registration.errors
from experiments.outcome import Outcome, Silent
from experiments.studies.ct_model import study as ct_model
from registration.centerline.extractor import CenterlineExtractor
from registration.ct_model.label_map import LabelMap
from registration.ct_model.label_surface import LabelSurface
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import read_centerline_table
from registration.io.patient_space import stated_space, write_model
from registration.io.surfaces import read_centerline, read_surface
from registration.metrics.surface_distance import surface_residuals

REFUSED = (experiments.errors.InputError, registration.errors.InputError)
WAY = np.array([2.0, 3.0, 6.0]) / 7
START_MM = np.array([30.0, -20.0, 50.0])
FILES = [
    "centerline.csv",
    "centerline.mrk.json",
    "centerline.vtp",
    "ct_model.json",
    "scene.html",
    "surface.ply",
    "surface.stl",
]


def in_tube(points_mm: np.ndarray) -> np.ndarray:
    """A tube of radius 4 mm along an oblique line of 40 mm, its ends rounded."""
    along_mm = np.clip((points_mm - START_MM) @ WAY, 0, 40)
    return np.asarray(np.linalg.norm(points_mm - START_MM - along_mm[:, None] * WAY, axis=1) < 4)


class StraightLine:
    """In place of the centerline's method, where a test is not about it."""

    def __call__(self, mesh: Mesh) -> Centerline:
        return Centerline((Polyline(np.stack([START_MM, START_MM + 40 * WAY]), np.array([4.0, 4.0])),))


def tube_labels(spacing_mm: tuple[float, ...] = (0.8, 0.8, 1.2)) -> LabelMap:
    return voxelised(in_tube, START_MM - 4, START_MM + 40 * WAY + 4, spacing_mm, OBLIQUE, label=3)


def settings(folder: Path, name: str, **change: Any) -> dict[str, Any]:
    (folder / "out").mkdir(exist_ok=True)
    return {
        "input": str(folder / name),
        "label": None,
        "space": None,
        "units": None,
        "label_surface": LabelSurface(),
        "centerline": CenterlineExtractor(),
        "workspace": folder / "out",
        "progress": Silent(),
    } | change


def run(folder: Path, name: str, **change: Any) -> tuple[Outcome, dict[str, Any]]:
    outcome = ct_model.run(**settings(folder, name, **change))
    return outcome, json.loads((folder / "out" / "ct_model.json").read_text())


def check(folder: Path, name: str, **change: Any) -> None:
    given = settings(folder, name, **change)
    names = ("input", "label", "space", "units", "nifti_form")
    ct_model.check(**{key: given[key] for key in names if key in given})


def test_a_label_map_becomes_a_model(tmp_path: Path) -> None:
    write_volume(tmp_path / "tube.nii.gz", tube_labels())
    outcome, record = run(tmp_path, "tube.nii.gz", centerline=StraightLine())
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == FILES
    volume_mm3 = np.pi * 16 * 40 + 4 / 3 * np.pi * 64
    assert record["volume_mm3"] == pytest.approx(volume_mm3, rel=0.01)
    assert record["label"]["volume_mm3"] == pytest.approx(volume_mm3, rel=0.01)
    assert (record["label"]["value"], record["label"]["cut_sides"]) == (3, [])
    np.testing.assert_allclose(record["label"]["spacing_mm"], [0.8, 0.8, 1.2], rtol=1e-5)
    assert (record["kind"], record["space"], record["input_space"], record["input_units"]) == (
        "label_map", "LPS", "header", "mm",
    )  # fmt: skip
    assert record["quality"]["watertight"] and record["quality"]["manifold"] and record["quality"]["oriented"]
    surface = read_surface(out / "surface.ply")
    assert isinstance(surface, Mesh)
    np.testing.assert_allclose(record["low_mm"], surface.vertices_mm.min(axis=0), atol=1e-4)
    np.testing.assert_allclose(record["extent_mm"], np.ptp(surface.vertices_mm, axis=0), atol=1e-4)
    assert stated_space(out / "surface.ply") == stated_space(out / "surface.stl") == "lps"
    assert outcome.metrics["volume_mm3"] == record["volume_mm3"]
    assert set(record["timing"]) == {"surface_s", "centerline_s", "quality_s", "files_s", "total_s"}
    assert [data.name for data in outcome.inputs] == ["tube.nii.gz"]


def test_its_centerline_is_the_tubes_in_every_file(tmp_path: Path) -> None:
    write_volume(tmp_path / "tube.nrrd", tube_labels())
    _, record = run(tmp_path, "tube.nrrd")
    out = tmp_path / "out"
    (line,) = read_centerline(out / "centerline.vtp").lines
    offset_mm = line.points_mm - START_MM
    across_mm = np.linalg.norm(offset_mm - (offset_mm @ WAY)[:, None] * WAY, axis=1)
    assert across_mm.mean() < 0.15
    np.testing.assert_allclose(line.radius_mm[3:-3], 4, atol=0.3)
    assert record["centerline"]["lines"] == 1
    assert record["centerline"]["length_mm"] == pytest.approx(line.length_mm)
    # From tip to tip: a half sphere of 4 mm ends the tube on either side.
    assert line.length_mm == pytest.approx(48, abs=0.8)
    (row,) = read_centerline_table(out / "centerline.csv").lines
    np.testing.assert_allclose(row.points_mm, line.points_mm, atol=1e-5)
    (curve,) = json.loads((out / "centerline.mrk.json").read_text())["markups"]
    assert (curve["coordinateSystem"], curve["coordinateUnits"]) == ("LPS", "mm")
    first_mm = curve["controlPoints"][0]["position"]
    np.testing.assert_allclose(first_mm, line.points_mm[0], atol=1e-5)
    page = (out / "scene.html").read_text(encoding="utf-8")
    assert '"name":"surface"' in page and '"name":"centerline"' in page


def test_a_mesh_and_the_label_map_of_one_vessel_agree(tmp_path: Path) -> None:
    write_volume(tmp_path / "tube.mha", tube_labels())
    run(tmp_path, "tube.mha", centerline=StraightLine())
    surface = read_surface(tmp_path / "out" / "surface.stl")
    assert isinstance(surface, Mesh)
    # The same model written in metres and RAS by another program.
    foreign = Mesh(surface.vertices_mm * [-0.001, -0.001, 0.001], surface.triangles[:, ::-1].copy())
    write_model(tmp_path / "foreign.stl", foreign, "ras")
    outcome, record = run(tmp_path, "foreign.stl", units="m", centerline=StraightLine())
    again = read_surface(tmp_path / "out" / "surface.ply")
    assert surface_residuals(again, surface, np.eye(4), inlier_mm=1.0, keep=1.0).hd95_mm < 1e-3
    assert (record["kind"], record["input_space"], record["input_units"]) == ("mesh", "ras", "m")
    assert record["repair"]["triangles_turned"] == len(surface.triangles)
    assert record["label"] is None
    assert any("wound the other way" in sentence for sentence in outcome.findings)


def test_a_label_that_the_scan_cut_is_told_and_left_open(tmp_path: Path) -> None:
    whole = tube_labels()
    middle = whole.labels.shape[2] // 2
    part = LabelMap(whole.labels[:, :, :middle].copy(), whole.ct_A_voxel, {})
    write_volume(tmp_path / "part.nrrd", part)
    outcome, record = run(tmp_path, "part.nrrd", centerline=StraightLine())
    assert record["label"]["cut_sides"] == ["last k"]
    assert (record["quality"]["open_ends"], record["quality"]["watertight"]) == (1, False)
    assert any("touches the border of the volume (last k)" in sentence for sentence in outcome.findings)


def test_a_segment_by_name_in_a_file_cropped_to_it_is_whole(tmp_path: Path) -> None:
    whole = tube_labels()
    used = [np.flatnonzero((whole.labels > 0).any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    first, last = np.array([axis[0] for axis in used]), np.array([axis[-1] for axis in used])
    cropped = whole.labels[tuple(slice(low, high + 1) for low, high in zip(first, last, strict=True))]
    at = whole.ct_A_voxel @ voxel_axes((1, 1, 1), np.eye(3), tuple(first))
    ras = np.diag([-1.0, -1.0, 1.0, 1.0]) @ whole.ct_A_voxel
    extent = [number for size in whole.labels.shape for number in (0, size - 1)]
    place = ";".join(f"{number:.17g}" for number in [*ras.reshape(-1), *extent])
    names = "Segment0_LabelValue:=3\nSegment0_Name:=aorta\n"
    more = f"{names}Segmentation_ConversionParameters:=Reference image geometry|{place};|text&\n"
    (tmp_path / "tube.seg.nrrd").write_bytes(nrrd_bytes(cropped, "LPS", at, more))
    _, record = run(tmp_path, "tube.seg.nrrd", label="aorta", centerline=StraightLine())
    assert (record["label"]["cut_sides"], record["label"]["name"]) == ([], "aorta")
    assert record["quality"]["watertight"]
    # The same voxels without their place in the scan: open on all sides, and told why.
    (tmp_path / "bare.seg.nrrd").write_bytes(nrrd_bytes(cropped, "LPS", at, names))
    outcome, record = run(tmp_path, "bare.seg.nrrd", label="aorta", centerline=StraightLine())
    assert len(record["label"]["cut_sides"]) == 6
    assert any("touches all six sides" in sentence for sentence in outcome.findings)


def test_units_against_the_header_are_told(tmp_path: Path) -> None:
    whole = tube_labels()
    at = np.diag([0.1, 0.1, 0.1, 1.0]) @ whole.ct_A_voxel
    (tmp_path / "tube.nrrd").write_bytes(nrrd_bytes(whole.labels, "LPS", at, 'space units: "mm" "mm" "mm"\n'))
    outcome, _ = run(tmp_path, "tube.nrrd", units="cm", centerline=StraightLine())
    assert "The header says that lengths are in mm: units=cm was taken instead." in outcome.findings


def test_pieces_and_cavities_are_told(tmp_path: Path) -> None:
    broken = tube_labels()
    inside = np.argwhere(broken.labels > 0)
    centre = inside[np.linalg.norm(inside - inside.mean(axis=0), axis=1).argmin()]
    broken.labels[tuple(centre)] = 0
    broken.labels[0, 0, 0] = 3
    write_volume(tmp_path / "broken.nrrd", broken)
    outcome, record = run(tmp_path, "broken.nrrd", centerline=StraightLine())
    label = record["label"]
    assert (label["pieces_dropped"], label["voxels_dropped"], label["voxels_filled"]) == (1, 1, 1)
    told = " ".join(outcome.findings)
    assert (
        "Label 3 lies in 2 pieces: only the largest was taken, 1 voxels of the others were left out." in told
    )
    assert "1 voxels in cavities of the label were filled." in told


def test_a_surface_without_a_centerline_is_kept_and_the_reason_told(tmp_path: Path) -> None:
    class NoCenterline:
        def __call__(self, mesh: Mesh) -> None:
            raise registration.errors.InputError("surface: expected a vessel with two ends, received none")

    write_volume(tmp_path / "tube.nrrd", tube_labels())
    outcome, record = run(tmp_path, "tube.nrrd", centerline=NoCenterline())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        name for name in FILES if not name.startswith("centerline")
    ]
    assert record["centerline"] == {"refused": "surface: expected a vessel with two ends, received none"}
    assert np.isnan(outcome.metrics["centerline_length_mm"])
    assert any("There is no centerline: surface: expected" in sentence for sentence in outcome.findings)


def test_one_of_several_labels(tmp_path: Path) -> None:
    both = tube_labels()
    both.labels[0, :2, 0] = 7
    write_volume(tmp_path / "both.nrrd", both)
    with pytest.raises(
        REFUSED, match=r"both\.nrrd: label: expected one of 3, 7, because there are 2, received none"
    ):
        run(tmp_path, "both.nrrd")
    _, record = run(tmp_path, "both.nrrd", label=3, centerline=StraightLine())
    assert record["label"]["value"] == 3


@pytest.mark.parametrize(
    "name, change, message",
    [
        ("none.nii", {}, r"none\.nii: expected a file, received nothing there"),
        ("tube.stl", {"space": "scanner"}, "space: expected lps or ras, received 'scanner'"),
        ("tube.stl", {"units": "feet"}, "units: expected one of mm, cm, m, received 'feet'"),
        ("tube.stl", {"label": 1}, r"label: expected none, because .*tube\.stl is a mesh, received 1"),
        (
            "tube.stl",
            {"label": 1.5},
            "label: expected a whole number other than 0, the background, or the name of a segment, received 1.5",
        ),
        (
            "tube.stl",
            {"label": "aorta"},
            r"label: expected none, because .*tube\.stl is a mesh, received aorta",
        ),
        (
            "tube.stl",
            {"nifti_form": "sform"},
            "nifti_form: expected qform or sform, and that for NIfTI files alone",
        ),
        ("tube.stl", {"label": 0}, "label: expected a whole number other than 0"),
        ("tube.stl", {"input": ""}, "input: expected the file of a label map or a mesh, received none"),
    ],
)
def test_wrong_input_is_refused_before_work_starts(
    tmp_path: Path, name: str, change: dict[str, Any], message: str
) -> None:
    write_model(tmp_path / "tube.stl", tube(straight(), 3.0))
    with pytest.raises(REFUSED, match=message):
        check(tmp_path, name, **change)
    with pytest.raises(REFUSED, match=message):
        run(tmp_path, name, **change)
    assert not list((tmp_path / "out").iterdir())


def test_good_input_passes_the_check(tmp_path: Path) -> None:
    write_model(tmp_path / "tube.stl", bent_tube())
    write_volume(
        tmp_path / "tube.nii",
        LabelMap(np.ones((2, 2, 2), np.uint8), voxel_axes((1, 1, 1), np.eye(3), (0, 0, 0)), {}),
    )
    check(tmp_path, "tube.stl", space="lps", units="mm")
    check(tmp_path, "tube.nii", label=3)


def test_the_real_aorta(real_data: Path, tmp_path: Path) -> None:
    aorta = real_data / "vmtk" / "aorta-surface.stl"
    with pytest.raises(
        REFUSED, match=r"space: expected lps or ras, because .*aorta-surface\.stl does not say"
    ):
        run(tmp_path, str(aorta))
    outcome, record = run(tmp_path, str(aorta), space="ras")
    assert record["volume_mm3"] == pytest.approx(13184, rel=1e-3)
    # In LPS its first two coordinates have turned over.
    np.testing.assert_allclose(record["low_mm"][:2], [-239.92, -181.63], atol=0.01)
    reference = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    assert record["centerline"]["lines"] == len(reference.lines)
    radius_mm = np.concatenate([line.radius_mm for line in reference.lines])
    assert record["centerline"]["radius_max_mm"] == pytest.approx(radius_mm.max(), abs=0.2)
    assert any("open scene.html" in sentence for sentence in outcome.findings)


@pytest.mark.parametrize("closed", [False, True])
def test_the_wall_of_a_hollow_phantom_gives_its_lumen(tmp_path: Path, closed: bool) -> None:
    def in_wall(points_mm: np.ndarray) -> np.ndarray:
        height_mm = (points_mm - START_MM) @ WAY
        apart_mm = np.linalg.norm(points_mm - START_MM - height_mm[:, None] * WAY, axis=1)
        cavity = (apart_mm < 4) & ((np.abs(height_mm - 20) < 18) | (not closed))
        return np.asarray((apart_mm < 7) & (np.abs(height_mm - 20) < 20) & ~cavity)

    labels = voxelised(in_wall, START_MM - 9, START_MM + 40 * WAY + 9, (0.8, 0.8, 1.0), np.eye(3), label=1)
    write_volume(tmp_path / "wall.nii.gz", labels)
    outcome, told = run(tmp_path, "wall.nii.gz")
    assert told["lumen"] == {"walls_joined": not closed, "genus": 0 if closed else 1}
    assert outcome.findings[0].startswith("The surface is a hollow body, its outer and inner wall")
    (line,) = read_centerline_table(tmp_path / "out" / "centerline.csv").lines
    height_mm = (line.points_mm - START_MM) @ WAY
    off_axis_mm = np.linalg.norm(line.points_mm - START_MM - height_mm[:, None] * WAY, axis=1)
    assert off_axis_mm[3:-3].max() < 0.3
    assert np.median(line.radius_mm) == pytest.approx(4.0, abs=0.2)
    assert line.length_mm == pytest.approx(36.0 if closed else 40.0, abs=2.0)
    assert told["typical_radius_mm"] == pytest.approx(4.0, abs=0.45)
