"""What every test may use: the real data where it is, a tracker of its own, and shapes checked at every call."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest
from filelock import FileLock
from shape_checks import Tests, install

# The test processes share the cores: one thread each, which does not spin while it waits.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
if os.environ.get("PYTEST_XDIST_WORKER"):
    os.environ.setdefault("OMP_NUM_THREADS", "1")

install(["models", "registration"])

# Loading and collecting leave little to collect, and what there is would be looked through again and again.
gc.disable()

REPOSITORY = Path(__file__).resolve().parents[1]
TOP = pytest.StashKey[set[str]]()
REAL_DATA = Path(os.environ.get("CTUS_TEST_DATA", REPOSITORY.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def repository() -> Path:
    """The top of the checkout."""
    return REPOSITORY


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real test data; a test that asks for it is skipped where there is none."""
    if not REAL_DATA.is_dir():
        pytest.skip(f"real test data: expected at {REAL_DATA} (set CTUS_TEST_DATA), found nothing")
    return REAL_DATA


def pytest_sessionstart(session: pytest.Session) -> None:
    """What lies at the top of the checkout before the first test."""
    session.config.stash[TOP] = {path.name for path in REPOSITORY.iterdir()}


def pytest_collection_finish() -> None:
    """Take what is loaded by now out of the garbage collector's sight, and let it look through the rest less often.

    With its own thresholds it takes a tenth of the processor time of tests that compose configurations.
    """
    gc.collect()
    gc.freeze()
    gc.enable()
    gc.set_threshold(20_000, 50, 50)


def pytest_runtest_setup() -> None:
    """Count the calls whose arrays are checked from the first, for each test."""
    Tests.number += 1


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where the real data is there and a test was skipped, and where a test wrote into the checkout."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None:  # one of several processes; the one that counts reports
        return
    wrong = []
    if REAL_DATA.is_dir() and reporter.stats.get("skipped"):
        wrong.append("a test was skipped although the real test data is there")
    there = {path.name for path in REPOSITORY.iterdir()}
    if left := there - session.config.stash[TOP] - {".pytest_cache"}:
        wrong.append(f"a test wrote into the current folder: {', '.join(sorted(left))}")
    for sentence in wrong:
        reporter.write_line(sentence, red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all test processes share."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if os.environ.get("PYTEST_XDIST_WORKER") else own


@pytest.fixture(scope="session", autouse=True)
def shared_compositions(shared_folder: Path) -> None:
    """Configurations that several tests look at are composed once for all test processes."""
    import configurations

    configurations.shared = shared_folder / "composed"
    configurations.shared.mkdir(exist_ok=True)


@pytest.fixture(scope="session")
def store_template(shared_folder: Path) -> Path:
    """A freshly made tracking store, made once for all test processes because making one takes seconds."""
    template = shared_folder / "store-template"
    with FileLock(shared_folder / "store-template.lock"):
        if not template.is_dir():
            from experiments.tracking import Store

            beside = shared_folder / "store-template.partial"
            Store(uri=f"sqlite:///{beside / 'ctus.db'}").client()
            beside.rename(template)
    return template


@pytest.fixture(scope="session")
def newest_schema() -> None:
    """MLflow reads all of its migrations whenever a store is opened, to see which is the newest; once is enough."""
    from mlflow.store.db import utils

    if hasattr(utils, "_get_latest_schema_revision"):
        utils._get_latest_schema_revision = functools.cache(utils._get_latest_schema_revision)


@pytest.fixture
def home(tmp_path: Path, store_template: Path, newest_schema: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project folder of the test's own, with an empty tracking store in it."""
    monkeypatch.setenv("CTUS_HOME", str(tmp_path))
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    (tmp_path / "mlruns").mkdir()
    shutil.copy(store_template / "ctus.db", tmp_path / "mlruns" / "ctus.db")
    return tmp_path


@pytest.fixture
def counting_study(home: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A study ``counting`` with two or more jobs that fail on demand, registered for one test.

    It keeps the number of its calls in ``calls``, so that a test sees what was run again.
    """
    from experiments import paths

    package = home / "package"
    shutil.copytree(REPOSITORY / "conf", package / "conf")
    (package / "conf" / "study" / "counting.yaml").write_text(
        "# @package _global_\n# Count, for tests.\n"
        "parts: [1, 2]\npart: null\nfail_on: []\nrefuse_on: []\nneeded: here\ndata: null\n"
    )
    module = ModuleType("experiments.studies.counting")
    exec((REPOSITORY / "tests" / "support" / "counting_study.py").read_text(), module.__dict__)
    monkeypatch.setitem(sys.modules, "experiments.studies.counting", module)
    monkeypatch.setattr(paths, "_PACKAGE", package)
    return module
