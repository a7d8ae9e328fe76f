"""The real dashboard in a real browser: what a person sees of three sweeps without typing any name of a metric.

``make test-pages`` runs this; ``CTUS_SCREENSHOTS`` names a folder that gets a picture of each page.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator

import pytest
from chromium import Page, browser_program, chromium_page
from dashboard_sweeps import write_sweeps
from page_checks import save_picture

from experiments.tracking import Store

pytestmark = [
    pytest.mark.pages,
    pytest.mark.skipif(browser_program() is None, reason="expected chromium, found none"),
]
WIDTH, HEIGHT = 1600, 900
EXPANDERS = "[...document.querySelectorAll('button[data-component-id*=runnamecellrenderer]')]"
# Headers from left to right: the page has them in another order.
HEADERS = (
    "[...document.querySelectorAll('.ag-header-cell')].map(e => [e.getBoundingClientRect().x, e.innerText.trim()])"
    ".sort((a, b) => a[0] - b[0]).map(e => e[1])"
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A store with three sweeps in it."""
    home = tmp_path_factory.mktemp("dashboard")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CTUS_HOME", str(home))
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        write_sweeps(home, patch)
        yield Store()


@pytest.fixture(scope="module")
def address(store: Store) -> Iterator[str]:
    """The address of the dashboard on that store."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["server", "--backend-store-uri", store.address, "--port", str(port), "--workers", "1"]
    # Jobs of MLflow's own, such as judging language models, are none that the dashboard needs.
    environment = {**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    environment["MLFLOW_DISABLE_TELEMETRY"] = "true"
    server = subprocess.Popen(
        [sys.executable, "-m", "mlflow", *words],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + 240
        while True:
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=5)
                break
            except OSError:
                assert time.monotonic() < deadline and server.poll() is None, "the dashboard does not start"
                time.sleep(0.5)
        yield f"http://127.0.0.1:{port}"
    finally:
        os.killpg(server.pid, 15)
        server.wait(timeout=30)


@pytest.fixture(scope="module")
def page(address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium_page(tmp_path_factory.mktemp("profile"), WIDTH, HEIGHT) as page:
        page.open(f"{address}/#/experiments")
        page.wait_for_text("segmentation", 180)
        page.value("localStorage.setItem('mlflow.assistant.panelOpen_v1', 'false')")
        page.value("localStorage.setItem('mlflow.assistant.fab.autoOpenedOnFirstLoad_v1', 'true')")
        yield page


def picture(page: Page, name: str, height: int | None = None) -> None:
    time.sleep(1.0)  # figures fade in
    save_picture(page, f"dashboard_{name}", height)


def button(words: str) -> str:
    return f"[...document.querySelectorAll('button')].find(b => b.innerText.trim().startsWith({json.dumps(words)}))"


def item(words: str) -> str:
    """The smallest element that shows these words and no more."""
    return (
        f"[...document.querySelectorAll('*')].filter(e => e.innerText?.trim() === {json.dumps(words)}).at(-1)"
    )


def open_view(page: Page, address: str, store: Store, study: str, more: str = "") -> None:
    experiment = store.experiment_id(study)
    page.open("about:blank")
    page.open(f"{address}/#/experiments/{experiment}/runs{more}")
    page.wait_for_text("matching runs", 120)


def run_id(store: Store, study: str, name: str) -> str:
    (found,) = [run for run in store.runs([study]) if run.info.run_name == name]
    return str(found.info.run_id)


def test_the_list_shows_what_was_compared_with_its_folds_below(
    page: Page, address: str, store: Store
) -> None:
    open_view(page, address, store, "segmentation")
    page.wait_for_text("phantom: unet")
    assert "fold 0 of attention_unet" not in page.text()
    page.click_element(f"{EXPANDERS}[0]", "the sweep's expander")
    page.wait(f"{EXPANDERS}.length === 3", "a row for each network")
    page.click_element(f"{EXPANDERS}[1]", "the network's expander")
    page.wait_for_text("fold 2 of attention_unet")
    shown = page.text()
    assert "fold 0 of attention_unet" in shown and "phantom (0123456789abcdef)" in shown
    assert "ctus study=segmentation" in shown
    picture(page, "list", 450)


def test_the_saved_view_has_columns_for_settings_and_metrics(page: Page, address: str, store: Store) -> None:
    open_view(page, address, store, "segmentation")
    page.click_element(button("Views"), "the menu of views")
    page.click_element(item("Results"), "the view of results")
    page.wait_for_text("3 matching runs")
    page.click_element(f"{EXPANDERS}[0]", "the sweep's expander")
    page.wait_for_text("attention_unet")
    headers = page.value(HEADERS)
    assert headers.index("model") < headers.index("dsc_mean") and "dataset" in headers
    assert "fold 0" not in page.text()
    picture(page, "results", 410)


def test_grouping_by_a_setting_needs_no_typing(page: Page, address: str, store: Store) -> None:
    open_view(page, address, store, "robustness", "?viewStateShareKey=ctus_results")
    page.click_element(button("Group by"), "the menu of groups")
    page.click_element(item("rigid"), "the method")
    page.wait_for_text("Group: multistart")
    page.press("Escape", 27)
    shown = page.text()
    assert "Group: single_icp" in shown
    assert "multistart, overlap 1.0" in shown and "multistart, overlap 0.6, place middle" in shown
    assert {"rigid", "overlap", "place", "success_rate", "success_tre_rate"} <= set(page.value(HEADERS))
    picture(page, "grouped")


def test_networks_are_compared_side_by_side(page: Page, address: str, store: Store) -> None:
    ids = [run_id(store, "segmentation", name) for name in ("unet", "attention_unet")]
    experiment = store.experiment_id("segmentation")
    page.open("about:blank")
    page.open(
        f"{address}/#/compare-runs?runs={json.dumps(ids)}&experiments={json.dumps([experiment])}".replace(
            " ", ""
        ).replace('"', "%22")
    )
    page.wait_for_text("Comparing 2 Runs", 60)
    page.wait_for_text("dsc_mean")
    shown = page.text()
    assert "attention_unet" in shown and "hd95_px_mean" in shown
    # a dozen parameters and as many metrics, not two hundred
    for one in ids:
        data = store.client().get_run(one).data
        assert len(data.params) <= 14 and len(data.metrics) <= 13
    picture(page, "compare")


def test_curves_over_epochs_have_the_same_names_on_every_fold(page: Page, address: str, store: Store) -> None:
    open_view(
        page, address, store, "segmentation", "?searchFilter=tags.level%3D%27repeat%27&compareRunsMode=CHART"
    )
    page.wait_for_text("Model metrics", 60)
    charts = "[...document.querySelectorAll('input')].find(e => e.placeholder === 'Search metric charts')"
    page.click_element(charts, "the search of charts")
    page.type("loss|val_dsc")
    page.wait_for_text("val_dsc")
    page.wait_for_text("train_loss")
    shown = page.text()
    assert "val_loss" in shown and "learning_rate" not in shown and "validation_dsc" not in shown
    page.wait("document.querySelectorAll('.js-plotly-plot .scatterlayer .trace').length >= 6", "six curves")
    picture(page, "curves")


def test_a_run_says_what_was_found_from_what_by_whom(page: Page, address: str, store: Store) -> None:
    experiment, run = (
        store.experiment_id("segmentation"),
        run_id(store, "segmentation", "phantom: unet, attention_unet"),
    )
    page.open("about:blank")
    page.open(f"{address}/#/experiments/{experiment}/runs/{run}")
    page.wait_for_text("Description", 60)
    page.wait("document.querySelectorAll('table').length > 0", "the summary's table")
    page.click_element(item("Show more"), "the rest of the description")
    page.wait("document.querySelector('img[src*=get-artifact]')?.naturalWidth > 100", "the summary's figure")
    shown = page.text()
    assert "ctus study=segmentation" in shown and "attention_unet" in shown and "Created by" in shown
    picture(page, "run")
    page.open(f"{address}/#/experiments/{experiment}/runs/{run}/artifacts")
    page.wait_for_text("metrics.json", 60)
    shown = page.text()
    assert "config.yaml" in shown and "summary.md" in shown and "cases.parquet" in shown
    picture(page, "artifacts")


def test_a_registration_is_called_after_its_files_and_method(page: Page, address: str, store: Store) -> None:
    open_view(page, address, store, "register", "?viewStateShareKey=ctus_results")
    page.wait_for_text("tube.ply to tube.ply")
    assert {"rigid", "moving", "fixed", "rmse_mm"} <= set(page.value(HEADERS))
    picture(page, "register")
