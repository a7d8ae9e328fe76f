"""The documentation's site in a real browser: pictures, navigation, search, and tables that fit the screen.

``make test-pages`` runs this; ``CTUS_SCREENSHOTS`` names a folder that gets a picture of each width.
"""

from __future__ import annotations

import http.server
import importlib.util
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from chromium import Page, browser_program, chromium_page
from page_checks import cut_texts, reached_by_tab, save_picture, smallest_text_px

pytestmark = [
    pytest.mark.pages,
    pytest.mark.skipif(browser_program() is None, reason="expected chromium, found none"),
    pytest.mark.skipif(
        importlib.util.find_spec("mkdocs") is None,
        reason="expected mkdocs (pip install 'ctus[docs]'), found none",
    ),
]
WIDTHS = [1280, 390]
LOADED = "document.readyState === 'complete' && [...document.images].every(e => e.complete)"
MISSING = "[...document.images].filter(e => !e.naturalWidth).map(e => e.src)"
SEEN = "(e => !!e && e.getBoundingClientRect().width > 0)(document.querySelector('SELECTOR'))"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Files of a folder, without a line on the terminal for each."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    """The folder of the site, built as ``make docs`` does."""
    folder = tmp_path_factory.mktemp("site")
    words = ["build", "--strict", "--quiet", "--config-file", str(repository / "mkdocs.yml")]
    subprocess.run(
        [sys.executable, "-m", "mkdocs", *words, "--site-dir", str(folder)],
        check=True,
        cwd=repository,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )
    return folder


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """The address of the site on this machine."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium_page(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def shown(page: Page, address: str, width: int) -> None:
    page.size(width, 900)
    page.open(address)
    page.wait(f"location.href === {address!r} && {LOADED}", address)


def wrong_on(page: Page, address: str, place: str, width: int) -> list[str]:
    """What is missing on a page, asked for elsewhere, reported as an error, or wider than the screen."""
    shown(page, f"{address}/{place}", width)
    elsewhere = [asked for asked in page.requests() if not asked.startswith(address)]
    wide = page.value("document.documentElement.scrollWidth") > width
    return [*page.value(MISSING), *elsewhere, *page.errors(), *(["wider than the screen"] if wide else [])]


def test_every_page_fits_a_narrow_screen_with_its_pictures_and_no_error(
    page: Page, site: Path, address: str
) -> None:
    places = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    assert len(places) > 40
    found = {place: wrong for place in places if (wrong := wrong_on(page, address, place, 390))}
    assert found == {}


@pytest.mark.parametrize(
    "place",
    ["index.html", "registration.html", "reference/registration.html", "results/rigid_benchmark.html"],
)
def test_a_page_of_each_kind_fits_a_wide_screen(page: Page, address: str, place: str) -> None:
    assert wrong_on(page, address, place, 1280) == []


@pytest.mark.parametrize("width", WIDTHS)
def test_the_start_has_navigation_and_search(page: Page, address: str, width: int) -> None:
    shown(page, f"{address}/index.html", width)
    if width == 390:
        assert page.value(SEEN.replace("SELECTOR", "label[for=__drawer].md-header__button"))
        assert page.value(SEEN.replace("SELECTOR", "label[for=__search].md-header__button"))
    else:
        entries = page.value(
            "[...document.querySelectorAll('.md-nav--primary a')].map(e => e.textContent.trim())"
        )
        assert {"Architecture", "Changelog"} <= set(entries)
        assert page.value(SEEN.replace("SELECTOR", ".md-nav--primary .md-nav__item a"))
        assert page.value(SEEN.replace("SELECTOR", ".md-search__input"))
    assert smallest_text_px(page) > 10.5
    assert cut_texts(page, ".md-typeset__scrollwrap, pre, .md-nav, .md-search, .md-skip") == []
    save_picture(page, f"docs_{width}")


def test_the_search_finds_a_page_by_the_keyboard(page: Page, address: str) -> None:
    shown(page, f"{address}/index.html", 1280)
    assert "Skip to content" in reached_by_tab(page, 1)
    page.value("document.querySelector('.md-search__input').focus()")
    page.type("Hausdorff")
    page.wait("document.querySelectorAll('.md-search-result__item').length > 0", "results of the search")
    assert page.errors() == []
