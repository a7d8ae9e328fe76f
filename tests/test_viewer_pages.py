"""The pages of a registration and of a tracked sweep in a real browser, cut off from every network.

``make test-pages`` runs this; ``CTUS_SCREENSHOTS`` names a folder that gets a picture of each width.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import Page, browser_program, chromium_page
from page_checks import colored_box, cut_texts, reached_by_tab, save_picture, smallest_text_px
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from experiments.outcome import Silent
from experiments.reporting.scene import CloudLayer, Scene
from experiments.studies.inspect_sweep import study as inspect_sweep
from experiments.studies.register import study as register
from registration import transforms
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import write_centerline
from registration.io.surfaces import write_surface
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import Motion, PhantomSettings, Scanner
from registration.rigid.multi_start import MultiStartICP

pytestmark = [
    pytest.mark.pages,
    pytest.mark.skipif(browser_program() is None, reason="expected chromium, found none"),
]
WIDTHS = [1280, 390]
POSE = transforms.from_rotation(Rotation.from_rotvec([0.4, -0.9, 1.0]), np.array([-60.0, 20, 15]))
EYE = "JSON.stringify(document.getElementById(NAME).layout.scene.camera.eye)"
TITLES = "['x', 'y', 'z'].map(a => document.getElementById(NAME).layout.scene[a + 'axis'].title.text)"


VESSEL = bent_tube(along=80, around=32)
RINGS_MM = VESSEL.vertices_mm[:-2].reshape(80, 32, 3)
# Swept is all but the first 16 rings, whose own frame is another one.
SWEPT = slice(16, 80)


def line_through(rings_mm: np.ndarray) -> Centerline:
    """The centers of rings and their mean radii."""
    middle_mm = rings_mm.mean(axis=1)
    return Centerline(
        (Polyline(middle_mm, np.linalg.norm(rings_mm - middle_mm[:, None], axis=2).mean(axis=1)),)
    )


def swept_mm() -> np.ndarray:
    """The rings (64, 32, 3) of the swept part where they were swept, rippled by up to 0.25 mm."""
    rings_mm, ripple = RINGS_MM[SWEPT], np.sin(np.linspace(0.0, 18.0, 64))[:, None, None]
    outward = rings_mm - rings_mm.mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    return transforms.apply(transforms.invert_rigid(POSE), rings_mm + 0.25 * ripple * outward)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of the page of a registration: a rippled part of a vessel on the whole of it."""
    folder = tmp_path_factory.mktemp("scene")
    rings_mm = swept_mm()
    inside = (VESSEL.triangles >= 16 * 32).all(axis=1) & (VESSEL.triangles < 80 * 32).all(axis=1)
    write_surface(folder / "sweep.ply", Mesh(rings_mm.reshape(-1, 3), VESSEL.triangles[inside] - 16 * 32))
    write_surface(folder / "aorta.ply", VESSEL)
    write_centerline(folder / "sweep-centerline.vtp", line_through(rings_mm))
    write_centerline(folder / "aorta-centerline.vtp", line_through(RINGS_MM))
    given = dict.fromkeys(inspect.signature(register.run).parameters)
    given |= {"moving": str(folder / "sweep.ply"), "fixed": str(folder / "aorta.ply"), "carry": []}
    given |= {"rigid": {"multistart": MultiStartICP()}, "deformable": {"none": None}, "slicer": "none"}
    given |= {"moving_points": 1200, "fixed_points": 2500, "inlier_mm": 1.0, "keep": 0.9, "seed": 0}
    register.run(**given | {"workspace": folder, "progress": Silent()})
    return (folder / "scene.html").as_uri()


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of the page of a simulated sweep whose poses end before its frames do."""
    settings = PhantomSettings(
        "artery", scanner=Scanner(height_px=160, width_px=160), motion=Motion(frames=16)
    )
    made = simulate_sweep(settings, 0).sweep
    some = slice(0, -len(made.pose_times_s) // 8)
    short = replace(made, world_T_ee=made.world_T_ee[some], pose_times_s=made.pose_times_s[some])
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "recording.igs.mha").touch()
    inspect_sweep.run(
        sweep=str(folder / "recording.igs.mha"),
        acquisition=lambda path: short,
        max_gap_s=0.05,
        offset_s=0.0,
        shown_frames=20,
        shown_px=160,
        workspace=folder,
        progress=Silent(),
    )
    return (folder / "sweep.html").as_uri()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium_page(tmp_path_factory.mktemp("profile")) as opened:
        opened.offline()
        yield opened


def shown(page: Page, address: str, width: int) -> None:
    page.size(width, 900)
    page.open(address)
    page.wait("document.readyState === 'complete'", "the page")
    page.wait("!!document.querySelector('.js-plotly-plot canvas')", "the 3-D view")
    page.settle()


@pytest.mark.parametrize("width", WIDTHS)
def test_a_scene_is_drawn_offline_readable_and_without_errors(page: Page, scene: str, width: int) -> None:
    shown(page, scene, width)
    kinds = page.value("document.getElementById('scene').data.map(e => [e.type, e.name, e.visible])")
    assert kinds == [
        ["mesh3d", "fixed", True],
        ["mesh3d", "moving, before", "legendonly"],
        ["mesh3d", "moving, after", True],
        ["scatter3d", "centerline, fixed", True],
        ["scatter3d", "centerline, moving after", True],
    ]
    assert page.value("document.documentElement.scrollWidth") <= width
    assert smallest_text_px(page) >= 11
    assert cut_texts(page) == []
    # Fitted: all of the vessel, which is higher than wide, and nothing cut off at an edge.
    left, top, right, bottom = colored_box(page, "#scene canvas")
    assert min(left, top, 1 - right, 1 - bottom) > 0.01
    assert bottom - top > 0.4
    names_its_inputs_verdict_axes_and_radii(page)
    save_picture(page, f"scene_{width}")
    assert (page.requests(), page.errors()) == ([scene], [])


def names_its_inputs_verdict_axes_and_radii(page: Page) -> None:
    assert page.value("document.title") == "sweep.ply on aorta.ply by multistart"
    assert page.value("document.querySelector('h1 .badge.good').innerText") == "accepted"
    assert page.value("document.querySelector('h1 .badge').getBoundingClientRect().bottom") < 80
    assert page.value(TITLES.replace("NAME", "'scene'")) == ["x (mm)", "y (mm)", "z (mm)"]
    scales = page.value("[...document.querySelectorAll('.colorbar')].map(e => e.textContent)")
    assert len(scales) == 2
    assert "Distance to fixed (mm)" in scales[0]
    assert "Radius (mm)" in scales[1]
    assert page.value("document.getElementById('scene').data[3].line.coloraxis") == "coloraxis2"


def test_the_keyboard_reaches_every_control_of_a_scene(page: Page, scene: str) -> None:
    shown(page, scene, 1280)
    names = ["fixed", "moving, before", "moving, after", "centerline, fixed", "centerline, moving after"]
    assert reached_by_tab(page, 8) == [*names, "Fit view", "Save picture", "view"]
    before = page.value(EYE.replace("NAME", "'scene'"))
    page.press("ArrowLeft", 37)
    page.wait(f"{EYE.replace('NAME', repr('scene'))} !== {json.dumps(before)}", "another view")
    page.value("document.querySelectorAll('.layer')[1].focus()")
    page.press("Enter", 13)
    page.wait("document.getElementById('scene').data[1].visible === true", "the layer")
    assert page.value("document.querySelectorAll('.layer')[1].ariaPressed") == "true"
    # What moved lies elsewhere before: it is brought into the view.
    low, high = page.value("document.getElementById('scene').layout.scene.xaxis.range")
    assert low < swept_mm()[..., 0].min() < high
    assert page.errors() == []


def test_a_point_far_away_does_not_shrink_the_view(page: Page, tmp_path: Path) -> None:
    cloud_mm = np.concatenate([VESSEL.vertices_mm, [[4000.0, 0, 0]]])
    Scene([CloudLayer("points", cloud_mm)], "far.ply").write(tmp_path / "far.html")
    shown(page, (tmp_path / "far.html").as_uri(), 1280)
    assert "1 point lies far away" in page.text()
    _, top, _, bottom = colored_box(page, "#scene canvas")
    assert bottom - top > 0.4
    page.value("document.getElementById('all').click()")
    page.settle()
    low, high = page.value("document.getElementById('scene').layout.scene.xaxis.range")
    assert low < VESSEL.vertices_mm[:, 0].min() < 4000 < high


@pytest.mark.parametrize("width", WIDTHS)
def test_a_sweep_is_drawn_offline_readable_and_without_errors(page: Page, sweep: str, width: int) -> None:
    shown(page, sweep, width)
    assert page.value("document.title") == "Tracked sweep recording.igs.mha"
    assert "frames dropped" in page.value("document.querySelector('h1 .badge.doubt').innerText")
    assert page.value("document.querySelector('h1 .badge').getBoundingClientRect().bottom") < 110
    assert page.value(TITLES.replace("NAME", "'space'")) == ["x (mm)", "y (mm)", "z (mm)"]
    assert page.value("document.getElementById('picture').naturalWidth") == 160
    plots = page.value(
        "[...document.querySelectorAll('.js-plotly-plot .main-svg:first-child')]"
        ".map(e => [e.getBoundingClientRect().top, e.getBoundingClientRect().bottom])"
    )
    assert len(plots) == 3
    assert plots[0][1] < plots[1][0] < plots[1][1] < plots[2][0]
    assert page.value("document.documentElement.scrollWidth") <= width
    assert smallest_text_px(page) >= 11
    assert cut_texts(page) == []
    page.size(width, page.value("document.documentElement.scrollHeight"))
    page.settle()
    assert colored_box(page, "#space canvas")[3] > 0.4
    save_picture(page, f"sweep_{width}")
    assert (page.requests(), page.errors()) == ([sweep], [])


def test_the_keyboard_scrubs_through_a_sweep_and_turns_it(page: Page, sweep: str) -> None:
    shown(page, sweep, 1280)
    assert reached_by_tab(page, 2) == ["scrub", "turned"]
    before = page.value(EYE.replace("NAME", "'space'"))
    page.press("ArrowUp", 38)
    page.wait(f"{EYE.replace('NAME', repr('space'))} !== {json.dumps(before)}", "another view")
    page.value("document.getElementById('scrub').focus()")
    first = page.value("document.getElementById('label').innerText")
    page.press("ArrowRight", 39)
    page.wait(f"document.getElementById('label').innerText !== {json.dumps(first)}", "the next frame")
    assert page.errors() == []
