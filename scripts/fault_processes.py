"""Commands of the project in processes that may be killed, forked from one that has all imports behind it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

SCRIPTS = Path(__file__).resolve().parent
SOURCE = SCRIPTS.parent / "src"
# A worker whose parent is gone looks twice a second, ends its run, and is killed after twenty seconds.
TIME_TO_END_S = 30.0


def load_all() -> None:
    """Import what commands need, once; nothing here starts a thread, which no fork would take along."""
    import importlib

    for name in (
        *("experiments.cli", "mlflow.tracking", "mlflow.store.tracking.sqlalchemy_store", "mlflow.server"),
        *("pandas", "pyarrow.parquet", "yaml", "torch", "lightning", "monai.networks.nets", "skimage"),
        *("experiments.running.run_sweep", "experiments.running.local_processes", "matplotlib.pyplot"),
        *("experiments.studies.segmentation", "experiments.studies.export_runs", "models.training.fold"),
        *("experiments.studies.import_runs", "experiments.studies.report.study", "hydra.core.plugins"),
        *("experiments.tracking.archive", "experiments.tracking.run_record", "sqlalchemy.dialects.sqlite"),
        *("mlflow.store.artifact.local_artifact_repo", "mlflow.tracking._tracking_service.client"),
    ):
        importlib.import_module(name)


def plugin(folder: Path) -> None:
    """Register the campaign's study, for this process and all that it starts."""
    package = folder / "ctus_faults"
    for place in (package / "conf" / "study", package / "studies", folder / "ctus_faults-1.dist-info"):
        place.mkdir(parents=True, exist_ok=True)
    for place in (package, package / "studies"):
        (place / "__init__.py").touch()
    shutil.copy(SCRIPTS / "fault_study.py", package / "studies" / "faults.py")
    sys.path.insert(0, str(folder))
    from ctus_faults.studies.faults import CONFIGURATION  # type: ignore[import-not-found]

    (package / "conf" / "study" / "faults.yaml").write_text(CONFIGURATION)
    about = folder / "ctus_faults-1.dist-info"
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: ctus-faults\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[ctus.plugins]\nctus_faults = ctus_faults\n")
    paths = [str(folder), str(SOURCE), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)


@dataclass
class Command:
    """A command in a process and a session of its own."""

    words: Sequence[str]
    home: Path
    log: Path
    environment: Mapping[str, str] = field(default_factory=dict)
    before: Callable[[], None] | None = None
    pid: int = 0
    begun_s: float = 0.0
    took_s: float = 0.0
    code: int | None = None

    def start(self) -> Command:
        """Fork the process that runs the command."""
        self.begun_s = time.monotonic()
        self.pid = os.fork()
        if self.pid == 0:
            self._run()
        return self

    def wait(self, timeout_s: float = 600.0) -> int | None:
        """The exit code, or minus the signal that ended it; None if it runs on after the time."""
        deadline = time.monotonic() + timeout_s
        while self.code is None and time.monotonic() < deadline:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.took_s = time.monotonic() - self.begun_s
                self.code = os.waitstatus_to_exitcode(status)
                return self.code
            time.sleep(0.005)
        return self.code

    def run(self, timeout_s: float = 600.0) -> int:
        """Start, wait, and kill what takes too long."""
        return self.start().finish(timeout_s)

    def finish(self, timeout_s: float = 600.0) -> int:
        """Wait for a command that has been started; it is killed where it takes too long."""
        if self.code is not None:
            return self.code
        code = self.wait(timeout_s)
        if code is None:
            self.kill()
            raise RuntimeError(f"{' '.join(self.words)}: over {timeout_s:g} s; {self.said()[-500:]}")
        return code

    def kill(self) -> None:
        """Kill the command's own process and no other."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)

    def outliving(self, wait_s: float = TIME_TO_END_S) -> list[int]:
        """Processes of the command's session that are there after the time a worker has to end; they are killed."""
        deadline = time.monotonic() + wait_s
        while (left := session(self.pid)) and time.monotonic() < deadline:
            time.sleep(0.1)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        return left

    def said(self) -> str:
        """What the command printed."""
        return self.log.read_text(encoding="utf-8", errors="replace") if self.log.exists() else ""

    def _run(self) -> None:
        code = 70
        try:
            os.setsid()
            stream = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            os.dup2(stream, 1)
            os.dup2(stream, 2)
            os.environ.update({"CTUS_HOME": str(self.home), **self.environment})
            from experiments.cli import main

            if self.before is not None:
                self.before()
            code = main([str(word) for word in self.words])
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)


def session(leader: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
        except (ProcessLookupError, psutil.NoSuchProcess, PermissionError):
            continue
    return found


def apart(function: Callable[[], Any], folder: Path) -> Any:
    """The result of a function in a forked process, so that this one never opens a store; it must be plain data."""
    place = folder / f"apart-{time.monotonic_ns()}.json"
    pid = os.fork()
    if pid == 0:
        try:
            place.write_text(json.dumps(function()), encoding="utf-8")
        except BaseException:
            place.with_suffix(".error").write_text(traceback.format_exc())
        finally:
            os._exit(0)
    os.waitpid(pid, 0)
    try:
        return json.loads(place.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RuntimeError(place.with_suffix(".error").read_text()) from None
    finally:
        place.unlink(missing_ok=True)
