"""The page of the report in a real browser: it needs nothing from elsewhere, fits the screen and sorts.

``make test-pages`` runs this; ``CTUS_SCREENSHOTS`` names a folder that gets a picture of each width.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from chromium import Page, browser_program, chromium_page
from page_checks import cut_texts, save_picture, smallest_text_px
from report_runs import HOSTILE, runs
from vessels import bent_tube

from experiments.cli import main
from experiments.outcome import Silent
from experiments.studies.report import run
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from registration.io.surfaces import write_surface

pytestmark = [
    pytest.mark.pages,
    pytest.mark.skipif(browser_program() is None, reason="expected chromium, found none"),
]
SECTION = "document.querySelector('#segmentation_carotid table')"
FIRST = f"{SECTION}.tBodies[0].rows[0].cells[0].innerText"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("report")
    write_archive(runs(), folder / "runs")
    (folder / "out").mkdir()
    place = str(folder / "runs")
    off = Store(enabled=False)
    run(runs=[], archive=place, out=None, store=off, workspace=folder / "out", progress=Silent())
    return (folder / "out" / "index.html").as_uri()


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of the report of two methods that were tried on a drawn vessel."""
    home = tmp_path_factory.mktemp("simulated")
    write_surface(home / "tube.ply", bent_tube())
    words = [f"target={home / 'tube.ply'}", "rigid=[single_icp,multistart]", "trials=3", "overlaps=[1.0]"]
    words += ["perturbation.moving_points=300", "perturbation.fixed_points=900", f"out={home / 'robustness'}"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CTUS_HOME", str(home))
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        assert main(["study=robustness", *words]) == 0
        (home / "out").mkdir()
        run(runs=[], archive=None, out=None, store=Store(), workspace=home / "out", progress=Silent())
    return (home / "out" / "index.html").as_uri()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium_page(tmp_path_factory.mktemp("profile")) as opened:
        opened.offline()
        yield opened


@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_fits_the_screen_and_shows_its_figures(page: Page, address: str, width: int) -> None:
    page.size(width, 900)
    page.open(address)
    page.wait("document.readyState === 'complete'", "the page")
    assert page.value("document.documentElement.scrollWidth") <= width
    page.value("document.querySelectorAll('img').forEach(e => { e.loading = 'eager'; })")
    page.wait("[...document.images].every(e => e.complete && e.naturalWidth > 0)", "the figures")
    assert page.value("document.images.length") == 1
    # What is wider than the screen scrolls in a frame of its own, which the keyboard reaches.
    assert page.value("[...document.querySelectorAll('.wide')].every(e => e.tabIndex === 0)")
    assert smallest_text_px(page) >= 11
    assert cut_texts(page, ".wide") == []
    save_picture(page, f"report_{width}")
    assert (page.requests(), page.errors()) == ([address], [])


@pytest.mark.parametrize("width", [1280, 390])
def test_a_section_has_its_tables_and_figures(page: Page, simulated: str, width: int) -> None:
    page.size(width, 1300)
    page.open(simulated)
    page.wait("document.readyState === 'complete'", "the page")
    page.value("document.querySelectorAll('img').forEach(e => { e.loading = 'eager'; })")
    page.wait("[...document.images].every(e => e.complete && e.naturalWidth > 0)", "the figures")
    assert page.value("document.documentElement.scrollWidth") <= width
    assert page.value(
        "document.querySelector('section[id^=robustness] table').innerText.includes('multistart')"
    )
    page.value("document.querySelector('section[id^=robustness]').scrollIntoView()")
    page.settle()
    save_picture(page, f"report_section_{width}")
    assert (page.requests(), page.errors()) == ([simulated], [])


def test_a_table_sorts_both_ways_and_names_are_text(page: Page, address: str) -> None:
    page.size(1280, 900)
    page.open(address)
    page.wait(f"!!{SECTION}", "the table")
    page.value(f"{SECTION}.querySelector('th button').click()")
    up = page.value(FIRST)
    page.value(f"{SECTION}.querySelector('th button').click()")
    assert {up, page.value(FIRST)} == {"unet", HOSTILE}
    assert page.value(f"{SECTION}.querySelector('th').getAttribute('aria-sort')") == "descending"


def test_the_keyboard_reaches_links_and_headings(page: Page, address: str) -> None:
    page.open(address)
    page.wait(f"!!{SECTION}", "the table")
    for _ in range(4):
        page.press("Tab", 9)
    assert page.value("document.activeElement.tagName") in ("A", "DIV", "BUTTON")
    page.value("document.querySelector('nav a[href=\"#provenance\"]').click()")
    page.wait("location.hash === '#provenance'", "the section")
