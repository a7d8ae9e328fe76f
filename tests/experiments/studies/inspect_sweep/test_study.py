"""The page of a sweep holds every frame asked for, the planes where they are, and why frames were dropped."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plotly_pages import figure_of, numbers
from sweeps import known_sweep

from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies.inspect_sweep import study as inspect_sweep
from registration import transforms
from registration.sweep import TrackedSweep
from registration.synchronisation import synchronise


def looked_at(
    tmp_path: Path, sweep: TrackedSweep, name: str = "a sweep", shown_frames: int = 10
) -> tuple[Outcome, str]:
    source, workspace = tmp_path / name, tmp_path / "out"
    source.mkdir()
    workspace.mkdir()
    outcome = inspect_sweep.run(
        sweep=str(source),
        acquisition=lambda path: sweep,
        max_gap_s=0.05,
        offset_s=0.0,
        shown_frames=shown_frames,
        shown_px=64,
        workspace=workspace,
        progress=Silent(),
    )
    return outcome, (workspace / "sweep.html").read_text(encoding="utf-8")


def script_value(html: str, name: str) -> object:
    matched = re.search(rf"^const {name} = (.*);$", html, re.MULTILINE)
    assert matched is not None
    return json.loads(matched[1])


def with_late_frames() -> TrackedSweep:
    """Two of the six frames lie after the last pose, and the reader left three out."""
    sweep = known_sweep()
    times_s = sweep.image_times_s + 0.3
    return TrackedSweep(
        sweep.images,
        times_s,
        sweep.world_T_ee,
        sweep.pose_times_s,
        sweep.calibration,
        {"ImageStatus INVALID": 3},
    )


def test_remarks_of_the_reader_are_findings(tmp_path: Path) -> None:
    outcome, _ = looked_at(tmp_path, replace(known_sweep(), notes=("Two calibrations differ by 12.0 mm.",)))
    assert outcome.findings[1:] == ("Two calibrations differ by 12.0 mm.",)


def test_a_sweep_that_hardly_moves_is_asked_for_its_unit(tmp_path: Path) -> None:
    sweep = known_sweep()
    (tmp_path / "mm").mkdir()
    (tmp_path / "m").mkdir()
    outcome, _ = looked_at(tmp_path / "mm", sweep)
    assert len(outcome.findings) == 1
    poses = sweep.world_T_ee.copy()
    poses[:, :3, 3] /= 1000.0
    outcome, _ = looked_at(tmp_path / "m", replace(sweep, world_T_ee=poses))
    assert (
        outcome.findings[-1].startswith("The end effector moved 0.0") and "units: m" in outcome.findings[-1]
    )


def test_page_holds_frames_and_planes(tmp_path: Path) -> None:
    sweep = with_late_frames()
    outcome, html = looked_at(tmp_path, sweep)
    shown = script_value(html, "frames")
    assert isinstance(shown, list)
    assert [frame["outline"] is None for frame in shown] == [False] * 4 + [True] * 2
    assert shown[5]["label"].endswith("dropped: after the last pose")
    assert all(frame["picture"].startswith("data:image/jpeg;base64,") for frame in shown)
    corner = transforms.apply(synchronise(sweep, 0.05).world_A_pixel[2], np.array([10.0, 7.0, 0.0]))
    np.testing.assert_allclose(np.array(shown[2]["outline"])[:, 2], corner)
    assert outcome.metrics["frames_kept"] == 4.0
    assert outcome.metrics["frames_dropped"] == 5.0
    assert "2 after the last pose" in outcome.findings[0]
    assert "3 ImageStatus INVALID" in html
    assert outcome.cases is not None
    assert outcome.cases["dropped"].tolist() == [""] * 4 + ["after the last pose"] * 2
    assert outcome.cases["x_mm"].isna().tolist() == [False] * 4 + [True] * 2


def test_page_needs_nothing_beside_it(tmp_path: Path) -> None:
    _, html = looked_at(tmp_path, known_sweep())
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=[\"']?http", html)
    assert len(html) > 1_000_000  # the plotting library is in it
    assert "$" not in html.split("<script")[0]


def test_page_shows_the_path_the_planes_and_the_times(tmp_path: Path) -> None:
    sweep = with_late_frames()
    _, html = looked_at(tmp_path, sweep)
    path, planes, chosen = figure_of(html, "space")["data"]
    np.testing.assert_allclose(numbers(path["x"]), sweep.world_T_ee[:, 0, 3], rtol=1e-6)
    # Each of the four planes: its outline of five points, then a gap.
    assert np.flatnonzero(np.isnan(numbers(planes["x"]))).tolist() == [5, 11, 17, 23]
    assert chosen["name"] == "this frame"
    between_frames, between_poses = figure_of(html, "intervals")["data"]
    assert numbers(between_frames["y"]).sum() == 5
    assert numbers(between_poses["y"]).sum() == 27
    assert [trace["name"] for trace in figure_of(html, "timeline")["data"]] == [
        "frames with a pose",
        "dropped: after the last pose",
        "poses",
    ]


@pytest.mark.parametrize(
    ("sweep", "badge"),
    [
        (known_sweep(), '<span class="badge good">all frames have a pose</span>'),
        (with_late_frames(), '<span class="badge doubt">5 of 9 frames dropped</span>'),
    ],
)
def test_the_title_says_how_many_frames_are_of_use(tmp_path: Path, sweep: TrackedSweep, badge: str) -> None:
    assert f"<h1>Tracked sweep a sweep {badge}</h1>" in looked_at(tmp_path, sweep)[1]


def test_a_pose_far_away_is_outside_the_view_and_said(tmp_path: Path) -> None:
    sweep = known_sweep(frame_count=12)
    poses = sweep.world_T_ee.copy()
    poses[0, 0, 3] = 9000.0
    _, html = looked_at(tmp_path, replace(sweep, world_T_ee=poses))
    assert "1 pose lies outside the view." in html.replace("\n", " ")
    assert max(figure_of(html, "space")["layout"]["scene"]["xaxis"]["range"]) < 500


def test_only_so_many_frames_are_shown(tmp_path: Path) -> None:
    _, html = looked_at(tmp_path, known_sweep(frame_count=9), shown_frames=3)
    shown = script_value(html, "frames")
    assert isinstance(shown, list)
    assert [frame["label"].split(",")[0] for frame in shown] == ["frame 0", "frame 4", "frame 8"]


def test_names_cannot_break_out_of_the_page(tmp_path: Path) -> None:
    _, html = looked_at(tmp_path, known_sweep(), name="<b>&sweep")
    assert "&lt;b&gt;&amp;sweep" in html
    assert "<b>&sweep" not in html


def test_recording_without_frames_has_a_page_too(tmp_path: Path) -> None:
    sweep = known_sweep()
    poses_only = TrackedSweep(
        np.zeros((0, 0, 0), np.uint8), np.zeros(0), sweep.world_T_ee, sweep.pose_times_s, sweep.calibration
    )
    outcome, html = looked_at(tmp_path, poses_only)
    assert script_value(html, "frames") == []
    assert '<span class="badge bad">no frame has a pose</span>' in html
    assert outcome.metrics["poses"] == 28.0


def test_missing_sweep_is_refused() -> None:
    with pytest.raises(InputError, match="sweep: expected a file or folder, received 'absent'"):
        inspect_sweep.check(sweep="absent")
