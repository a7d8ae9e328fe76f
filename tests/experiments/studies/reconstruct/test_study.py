"""A drawn tube comes back from its masks: axis, radius, volume, counts and files; what does not fit is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tube_sweeps import RADIUS_MM, TubeSweep, tube_sweep

from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.running import jobs
from experiments.studies.reconstruct import study as reconstruct
from models.predictor import Predictor
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Mesh
from registration.io.centerlines import read_centerline_table
from registration.io.surfaces import read_centerline, read_surface
from registration.readers.folder import FolderReader, write_folder
from registration.reconstruction.surface import PoissonSurface

FILES = {
    "cloud.ply", "surface.ply", "surface.stl", "centerline.vtp", "centerline.csv", "centerline.mrk.json",
    "reconstruction.json", "scene.html",
}  # fmt: skip


def recorded(folder: Path, tube: TubeSweep, values: np.ndarray | None = None) -> tuple[Path, Path]:
    """The sweep as a plain folder and its masks as pictures of the same names."""
    sweep, masks = folder / "a sweep", folder / "masks"
    write_folder(sweep, tube.sweep)
    masks.mkdir()
    for index, mask in enumerate(tube.masks.astype(np.uint8) * 255 if values is None else values):
        Image.fromarray(mask).save(masks / f"{index:06d}.png")
    return sweep, masks


def run(workspace: Path, sweep: Path, masks: Path | None, **changes: Any) -> Outcome:
    ((config, _),) = compose_sweep(["study=reconstruct", "sweep=given"])
    settings = jobs.arguments(config) | {"sweep": str(sweep), "masks": None if masks is None else str(masks)}
    workspace.mkdir()
    return reconstruct.run(**(settings | changes), workspace=workspace, progress=Silent())


def volume_mm3(length_mm: float) -> float:
    return np.pi * RADIUS_MM**2 * length_mm


def test_a_tube_comes_back_from_masks(tmp_path: Path) -> None:
    tube = tube_sweep()
    sweep, masks = recorded(tmp_path, tube)
    outcome = run(tmp_path / "out", sweep, masks)

    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == FILES
    (line,) = read_centerline_table(out / "centerline.csv").lines
    assert tube.off_axis_mm(line.points_mm).max() < 0.05
    assert line.length_mm == pytest.approx(20.0, rel=0.02)
    # The largest sphere inside is as narrow as the narrowest place around it.
    np.testing.assert_allclose(line.radius_mm, RADIUS_MM, atol=0.12)
    assert line.radius_mm.mean() == pytest.approx(RADIUS_MM, abs=0.05)
    assert read_centerline(out / "centerline.vtp").lines[0].length_mm == pytest.approx(
        line.length_mm, rel=1e-4
    )
    for name in ("surface.ply", "surface.stl"):
        surface = read_surface(out / name)
        assert isinstance(surface, Mesh)
        np.testing.assert_allclose(tube.off_axis_mm(surface.vertices_mm), RADIUS_MM, atol=0.15)
    report = json.loads((out / "reconstruction.json").read_text())
    assert report["frames"] == {"recorded": 41, "with_pose": 41, "dropped": {}, "with_vessel": 41}
    assert report["contours"]["contours"] == 41
    assert report["contours"]["open_contours"] == 0
    assert report["points"] + sum(report["removed_points"].values()) == report["contours"]["points"]
    assert set(report["removed_points"]) == {"voxel", "statistical", "radius"}
    quality = report["quality"]
    assert quality["volume_mm3"] == pytest.approx(volume_mm3(20.0), rel=0.03)
    assert (quality["open_ends"], quality["holes"], quality["manifold"], quality["oriented"]) == (
        2,
        0,
        True,
        True,
    )
    assert report["coverage"]["frames_share"] == 1.0
    assert report["coverage"]["frame_step_mm_max"] == pytest.approx(0.5, abs=1e-6)
    assert report["coverage"]["surface_near_points"] > 0.99
    assert report["coverage"]["points_near_surface"] > 0.99
    assert {"contours", "filters", "surface", "smoothing", "centerline", "total"} == set(report["seconds"])
    assert outcome.metrics["centerline_length_mm"] == pytest.approx(line.length_mm)
    assert outcome.cases is not None
    assert (outcome.cases["contours"] == 1).all()
    assert outcome.cases["points_left"].sum() == report["points"]


def test_probabilities_give_the_wall_below_a_pixel(tmp_path: Path) -> None:
    tube = tube_sweep()
    sweep, _ = recorded(tmp_path, tube)
    np.save(tmp_path / "probability.npy", tube.probability)
    run(tmp_path / "out", sweep, tmp_path / "probability.npy")
    surface = read_surface(tmp_path / "out" / "surface.ply")
    assert isinstance(surface, Mesh)
    # Pixels measure 0.25 mm.
    assert np.abs(tube.off_axis_mm(surface.vertices_mm) - RADIUS_MM).mean() < 0.02


def test_a_network_takes_the_place_of_masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tube = tube_sweep()
    sweep, _ = recorded(tmp_path, tube)
    (tmp_path / "model.pt").write_bytes(b"weights")
    monkeypatch.setattr(
        Predictor,
        "load",
        lambda path, engine: SimpleNamespace(soft_masks=lambda images, spacing_mm: tube.probability),
    )
    outcome = run(tmp_path / "out", sweep, None, model_path=str(tmp_path / "model.pt"))
    assert outcome.metrics["frames_with_vessel"] == 41


def test_frames_without_a_pose_are_dropped_and_their_masks_with_them(tmp_path: Path) -> None:
    tube = tube_sweep()
    kept = np.r_[0:21, 25:41]
    # Without these poses four frames lie in a gap of a quarter of a second.
    late = replace(
        tube.sweep, world_T_ee=tube.sweep.world_T_ee[kept], pose_times_s=tube.sweep.pose_times_s[kept]
    )
    tube.masks[21:25] = False
    tube.masks[21:25, :5, :5] = True
    sweep, masks = recorded(tmp_path, replace(tube, sweep=late))
    run(tmp_path / "out", sweep, masks)
    report = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
    assert report["frames"]["with_pose"] == 37
    assert sum(report["frames"]["dropped"].values()) == 4
    assert report["coverage"]["frame_step_mm_max"] == pytest.approx(2.5, abs=1e-6)
    surface = read_surface(tmp_path / "out" / "surface.ply")
    assert isinstance(surface, Mesh)
    assert np.abs(tube.off_axis_mm(surface.vertices_mm) - RADIUS_MM).max() < 0.3


def test_a_surface_without_a_centerline_is_kept_and_the_reason_told(tmp_path: Path) -> None:
    tube = tube_sweep(count=5)
    sweep, masks = recorded(tmp_path, tube)

    def none(surface: Mesh) -> None:
        from registration.errors import InputError as Refusal

        raise Refusal("surface: expected a vessel longer than wide, received another")

    outcome = run(tmp_path / "out", sweep, masks, centerline=none)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        name for name in FILES if not name.startswith("centerline")
    }
    assert "There is no centerline: surface: expected a vessel longer than wide" in " ".join(outcome.findings)
    assert np.isnan(outcome.metrics["centerline_length_mm"])


def test_pieces_on_both_sides_of_a_gap_are_kept_and_the_gap_is_told(tmp_path: Path) -> None:
    tube = tube_sweep()
    # The vessel is lost for ten frames: two pieces of 15 and 16 frames are too far apart to be joined.
    tube.masks[15:25] = False
    sweep, masks = recorded(tmp_path, tube)
    outcome = run(tmp_path / "out", sweep, masks)
    report = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
    assert report["coverage"]["points_near_surface"] > 0.99
    assert report["coverage"]["frames_share"] == pytest.approx(31 / 41)
    assert report["quality"]["volume_mm3"] == pytest.approx(volume_mm3(7.0 + 7.5), rel=0.05)
    assert (report["quality"]["pieces"], report["quality"]["open_ends"]) == (2, 4)
    found = report["surface"]
    assert found["pieces"] == 2
    # Crumbs of the surface between the last frames before the gap.
    assert found["area_share_left_out"] < 0.03
    assert found["swept_mm"] == pytest.approx(20.0)
    assert found["gap_share"] == pytest.approx(5.5 / 20)
    assert found["gaps"] == [{"after_frame": 14, "before_frame": 25, "gap_mm": pytest.approx(5.5)}]
    assert report["mask_check"]["empty_between_others"] == list(range(15, 25))
    assert report["centerline"]["lines"] == 2
    assert sum(report["centerline"]["lengths_mm"]) == pytest.approx(14.5, rel=0.05)
    findings = " ".join(outcome.findings)
    assert "1 gaps between frames, up to 5.5 mm wide, are 27.5% of the way" in findings
    assert "10 masks between others that show the vessel show none (frames 15, 16," in findings
    assert outcome.metrics["pieces"] == 2
    assert outcome.metrics["gap_share"] == pytest.approx(0.275)


def test_only_the_largest_piece_where_that_is_asked_for(tmp_path: Path) -> None:
    tube = tube_sweep()
    tube.masks[15:25] = False
    sweep, masks = recorded(tmp_path, tube)
    outcome = run(tmp_path / "out", sweep, masks, surface=PoissonSurface(0.7, 3.0, largest=True))
    report = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
    assert report["coverage"]["points_near_surface"] == pytest.approx(16 / 31, abs=0.06)
    assert report["quality"]["volume_mm3"] == pytest.approx(volume_mm3(7.5), rel=0.08)
    assert "they belong to pieces that were left out, or to none" in " ".join(outcome.findings)


def test_wrong_masks_are_left_out_and_named(tmp_path: Path) -> None:
    tube = tube_sweep()
    row, column = np.mgrid[:56, :56]
    tube.masks[5] = np.roll(tube.masks[5], 10, axis=1)
    tube.masks[12] = np.hypot(row - 27.5, column - 27.5) < 1.5 * RADIUS_MM / 0.25
    tube.masks[20] = np.hypot(row - 9, column - 9) < 7
    tube.masks[30] = True
    tube.masks[33] = (np.abs(row - 27.5) < 4) & (np.abs(column - 27.5) < 25)
    (tmp_path / "faulty").mkdir()
    sweep, masks = recorded(tmp_path / "faulty", tube)
    outcome = run(tmp_path / "out", sweep, masks)
    report = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
    reasons = {entry["frame"]: entry["reason"] for entry in report["mask_check"]["rejected"]}
    assert reasons == {5: "position", 12: "size", 20: "position", 30: "size", 33: "shape"}
    assert report["mask_check"]["rejected_by_reason"] == {"position": 2, "size": 2, "shape": 1}
    assert all(entry["times_limit"] > 1 for entry in report["mask_check"]["rejected"])
    surface = read_surface(tmp_path / "out" / "surface.ply")
    assert isinstance(surface, Mesh)
    assert np.abs(tube.off_axis_mm(surface.vertices_mm) - RADIUS_MM).max() < 0.2
    assert report["centerline"]["lines"] == 1
    assert outcome.cases is not None
    assert outcome.cases.loc[outcome.cases["rejected"] != "", "frame"].tolist() == [5, 12, 20, 30, 33]
    assert outcome.metrics["frames_rejected"] == 5
    assert "5 masks disagree with those before and after them and were left out" in " ".join(outcome.findings)


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    tube = tube_sweep(count=5)
    sweep, masks = recorded(tmp_path, tube)
    here = {"sweep": str(sweep), "masks": str(masks), "model_path": None}
    with pytest.raises(InputError, match="sweep: expected a file or folder"):
        reconstruct.check(**(here | {"sweep": "absent"}))
    with pytest.raises(InputError, match="masks: expected a file or folder"):
        reconstruct.check(**(here | {"masks": "absent"}))
    with pytest.raises(InputError, match="masks and model_path: expected one of them, received neither"):
        reconstruct.check(**(here | {"masks": None}))
    with pytest.raises(InputError, match="masks and model_path: expected one of them, received both"):
        reconstruct.check(**(here | {"model_path": "model.pt"}))
    with pytest.raises(InputError, match="model_path: expected a model file"):
        reconstruct.check(**(here | {"masks": None, "model_path": "absent.pt"}))
    reconstruct.check(**here)
    (masks / "000004.png").unlink()
    with pytest.raises(InputError, match="masks: expected one for each of 5 frames, received 4"):
        run(tmp_path / "out", sweep, masks)


def test_a_vessel_only_in_frames_without_a_pose_is_refused(tmp_path: Path) -> None:
    tube = tube_sweep(count=9)
    tube.masks[:5] = False
    early = replace(
        tube.sweep, world_T_ee=tube.sweep.world_T_ee[:5], pose_times_s=tube.sweep.pose_times_s[:5]
    )
    sweep, masks = recorded(tmp_path, replace(tube, sweep=early))
    with pytest.raises(
        RegistrationInputError, match="masks: expected a vessel in some of them, received 5 without any"
    ):
        run(tmp_path / "out", sweep, masks)


def test_a_sweep_without_pictures_is_refused(tmp_path: Path) -> None:
    tube = tube_sweep(count=5)
    sweep, masks = recorded(tmp_path, tube)
    none = replace(tube.sweep, images=np.zeros((0, 0, 0), np.uint8), image_times_s=np.zeros(0))
    with pytest.raises(InputError, match=r"sweep: expected frames with a pose in .* received none"):
        run(tmp_path / "out", sweep, masks, acquisition=lambda path: none)


def test_what_contradicts_itself_in_the_recording_is_told(tmp_path: Path) -> None:
    sweep, masks = recorded(tmp_path, tube_sweep())
    remark = "Two calibrations differ by 12.0 mm."
    outcome = run(
        tmp_path / "out",
        sweep,
        masks,
        acquisition=lambda path: replace(FolderReader()(path), notes=(remark,)),
    )
    assert outcome.findings[0] == remark
    assert json.loads((tmp_path / "out" / "reconstruction.json").read_text())["notes"] == [remark]
