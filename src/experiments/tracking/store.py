"""Where runs go: the tracker, opened, searched and tidied.

Runs are written through ``MlflowClient`` alone: the fluent interface keeps a global active run, which parallel jobs
and nested runs trip over. The default store is one SQLite file; it is made under a file lock, because several
processes that open a new one at once leave it broken.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

from filelock import FileLock

from experiments import files
from experiments.errors import InputError
from experiments.masking import masked
from experiments.paths import project_root
from experiments.provenance import environment_tags, is_gone, process_tags
from experiments.tracking.addresses import opening
from experiments.tracking.artifacts import run_file
from experiments.tracking.moved import follow_move
from experiments.tracking.names import LONGEST
from experiments.tracking.run_writer import RunWriter, ServerAwayError, server_unreachable, shortened
from experiments.tracking.saved_view import KIND_TAGS, VIEW_TAG, view_tag
from experiments.tracking.written import RunStart

if TYPE_CHECKING:
    import pandas as pd
    from mlflow.entities import Run as MlflowRun
    from mlflow.tracking import MlflowClient

PARENT_TAG = "mlflow.parentRunId"
HASH_TAG = "ctus.config_hash"
# What tells a job from the others of its call, in the words of the command line.
LABEL_TAG = "ctus.label"
ORIGIN_TAG = "ctus.run_id"
METRICS_FILE, CASES_FILE = "metrics.json", "cases.parquet"
# Characters that mean nothing but themselves in a tracking address.
_PLAIN_PATH = re.compile(r"[\w./+=@,~ -]*")


def origin_of(run: MlflowRun) -> str:
    """The id that a run had where it was first run.

    Parameters
    ----------
    run : mlflow.entities.Run
        The run as the store has it.

    Returns
    -------
    str
        The first id; its own for a run that was not copied.
    """
    return str(run.data.tags.get(ORIGIN_TAG, run.info.run_id))


@dataclass(frozen=True)
class Store:
    """Where runs go. ``uri`` is an MLflow tracking address or null for the project's own SQLite file.

    Parameters
    ----------
    uri : str or None, optional
        Tracking address; None for the project's own SQLite file.
    enabled : bool, optional
        Whether runs are tracked.
    reads_only : bool, optional
        Whether the project's own store is opened as it is: one whose folder was moved is not told so.
    """

    uri: str | None = None
    enabled: bool = True
    reads_only: bool = False
    _opened: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def folder(self) -> Path:
        """The folder of the project's own store."""
        return project_root() / "mlruns"

    @property
    def address(self) -> str:
        """The tracking address: the setting, else ``MLFLOW_TRACKING_URI``, else the project's SQLite file."""
        return self.uri or os.environ.get("MLFLOW_TRACKING_URI") or sqlite_address(self.folder / "ctus.db")

    @property
    def dashboard(self) -> str:
        """The command or the address that opens the dashboard."""
        if self.address.startswith(("http://", "https://")):
            return masked(self.address)
        return f"{_mlflow_program()} ui --backend-store-uri {shlex.quote(masked(self.address))}"

    @property
    def exists(self) -> bool:
        """Whether there is a store to look into; of a server and its database this is not known before it is asked."""
        if not self.address.startswith(("sqlite:///", "sqlite+pysqlite:///")):
            return True
        database = sqlite_file(self.address)
        return database.is_file() and database.stat().st_size > 0

    @property
    def undelivered(self) -> Path:
        """The folder of runs that wait for this tracker; each address has its own."""
        return self.folder / "untracked" / hashlib.sha256(self.address.encode()).hexdigest()[:12]

    def client(self) -> MlflowClient:
        """The client, opened and initialised at the first call.

        Returns
        -------
        MlflowClient
            The client.
        """
        if "client" not in self._opened:
            with opening(self.address):
                self._opened["client"] = _open(self.address, self.folder, self.reads_only)
        client: MlflowClient = self._opened["client"]
        return client

    def experiment_id(self, name: str) -> str:
        """The experiment of that name, made if there is none.

        Parameters
        ----------
        name : str
            Name as the project has it.

        Returns
        -------
        str
            Id of the experiment.
        """
        if (known := self._opened.get(f"experiment {name}")) is not None:
            return str(known)
        with self._lock():
            found = self.client().get_experiment_by_name(name)
            if found is not None and found.lifecycle_stage == "deleted":
                raise InputError(
                    f"experiment {name!r}: expected an experiment that exists, "
                    f"found a deleted one (restore it in the dashboard)"
                )
            identity = found.experiment_id if found is not None else self._create_experiment(name)
        self._opened[f"experiment {name}"] = identity
        return str(identity)

    def save_view(self, experiment: str, parameters: Sequence[str], metrics: Sequence[str]) -> None:
        """Give an experiment the view of its results that the dashboard offers under Views.

        Parameters
        ----------
        experiment : str
            Name of the experiment.
        parameters, metrics : Sequence[str]
            Names that have columns, in their order.
        """
        try:
            identity = self.experiment_id(experiment)
            tags = self.client().get_experiment(identity).tags
            wanted = {VIEW_TAG: view_tag(parameters, metrics, tags.get(VIEW_TAG, "")), **KIND_TAGS}
            for name, value in wanted.items():
                if tags.get(name) != value and (name == VIEW_TAG or name not in tags):
                    self.client().set_experiment_tag(identity, name, value)
        except InputError as refusal:
            if not isinstance(refusal, ServerAwayError):
                raise
        except Exception as error:  # a view is a convenience: without it the runs are the same
            if not server_unreachable(error):
                print(masked(f"The tracker refused a view ({str(error).splitlines()[0]})."), file=sys.stderr)

    def start(
        self, experiment: str, name: str, tags: Mapping[str, str], parent_id: str | None = None
    ) -> RunWriter:
        """Begin a run that is RUNNING until its writer sets how it ended.

        Parameters
        ----------
        experiment : str
            Name of the experiment.
        name : str
            Name of the run.
        tags : Mapping[str, str]
            Tags by name.
        parent_id : str or None, optional
            Id of the run above; None if there is none.

        Returns
        -------
        RunWriter
            The writer of the run.
        """
        all_tags = {
            **environment_tags(),
            **tags,
            "mlflow.runName": name[:LONGEST],
        }
        if parent_id is not None:
            all_tags[PARENT_TAG] = parent_id
        start = RunStart(experiment, name, parent_id, all_tags, int(time.time() * 1000))
        try:
            run = self.client().create_run(
                self.experiment_id(experiment), tags=shortened(all_tags), run_name=name[:LONGEST]
            )
        except Exception as error:
            if isinstance(error, InputError) and not isinstance(error, ServerAwayError):
                raise
            # What the job computes is kept for the tracker.
            if not server_unreachable(error):
                print(
                    masked(f"The tracker refused a new run ({str(error).splitlines()[0]})."), file=sys.stderr
                )
            return RunWriter(
                self._opened.get("client"), uuid.uuid4().hex, beating=False, start=start, known=False
            )
        return RunWriter(self.client(), run.info.run_id, start=start)

    def reopen(self, run_id: str) -> RunWriter:
        """Set a finished or failed run to RUNNING again, to go on with it from this process.

        The process is recorded first: a run that is marked as running must never name one that is gone.

        Parameters
        ----------
        run_id : str
            Id of the run.

        Returns
        -------
        RunWriter
            The writer of the run.
        """
        run = self.client().get_run(run_id)
        experiment = self.client().get_experiment(run.info.experiment_id).name
        tags = dict(run.data.tags)
        start = RunStart(experiment, run.info.run_name, tags.pop(PARENT_TAG, None), tags, run.info.start_time)
        writer = RunWriter(self.client(), run_id, start=start)
        writer.tags(process_tags())
        self.client().update_run(run_id, status="RUNNING")
        return writer

    @staticmethod
    def is_under_way(run: MlflowRun) -> bool:
        """Whether another process that lives is writing a run.

        Parameters
        ----------
        run : MlflowRun
            The run that is being written.

        Returns
        -------
        bool
            Whether another process that lives is writing a run.
        """
        tags = run.data.tags
        return run.info.status == "RUNNING" and tags.get("ctus.pid") != str(os.getpid()) and not is_gone(tags)

    def runs(self, experiments: Iterable[str] | None = None, filter_string: str = "") -> Iterator[MlflowRun]:
        """All runs of the named experiments (all of them if none is named), newest first, page by page.

        Parameters
        ----------
        experiments : Iterable[str] or None, optional
            Names of experiments; None for all.
        filter_string : str, optional
            Condition in MLflow's search language.

        Returns
        -------
        Iterator[MlflowRun]
            The runs, newest first.
        """
        client = self.client()
        ids = [
            experiment.experiment_id
            for experiment in client.search_experiments()
            if experiments is None or experiment.name in set(experiments)
        ]
        token = None
        while ids:
            page = client.search_runs(ids, filter_string, max_results=1000, page_token=token)
            yield from page
            token = page.token
            if not token:
                return

    def finished(self, experiment: str, config_hash: str) -> str | None:
        """The id of the newest FINISHED run of a job, or none.

        Parameters
        ----------
        experiment : str
            Name of the experiment.
        config_hash : str
            Hash of the job.

        Returns
        -------
        str or None
            Id of the run; None if there is none.
        """
        wanted = f"tags.`{HASH_TAG}` = '{config_hash}' and attributes.status = 'FINISHED'"
        try:
            found = next(self.runs([experiment], wanted), None)
        except Exception as error:
            if not server_unreachable(error):
                raise
            return None
        return None if found is None else str(found.info.run_id)

    def run(self, run_id: str) -> MlflowRun | None:
        """A run by its id, or none if there is no such run.

        Parameters
        ----------
        run_id : str
            Id of the run.

        Returns
        -------
        MlflowRun or None
            The run; None if there is none.
        """
        from mlflow.exceptions import MlflowException

        try:
            return self.client().get_run(run_id)
        except MlflowException as error:
            if error.error_code == "RESOURCE_DOES_NOT_EXIST":
                return None
            raise

    def origin(self, run_id: str | None) -> str | None:
        """The id that a run had where it was first run, which is what an archive knows it by.

        Parameters
        ----------
        run_id : str or None
            Id of the run in this store.

        Returns
        -------
        str or None
            The first id, ``run_id`` itself where the run is not in this store; None for None.
        """
        if run_id is None:
            return None
        # Asked for by every run below it, and never changed.
        known: dict[str, str] = self._opened.setdefault("origins", {})
        if run_id not in known and (run := self.run(run_id)) is not None:
            known[run_id] = origin_of(run)
        return known.get(run_id, run_id)

    def metrics(self, run_id: str) -> dict[str, float]:
        """The last value of every metric of a run, of those as well that the dashboard has no columns for.

        Parameters
        ----------
        run_id : str
            Id of the run.

        Returns
        -------
        dict[str, float]
            Values by name.
        """
        run = self.client().get_run(run_id)
        return {**dict(run.data.metrics), **self.all_metrics(run)}

    def all_metrics(self, run: str | MlflowRun) -> dict[str, float]:
        """The metrics in the file that a run keeps of them.

        Parameters
        ----------
        run : str or mlflow.entities.Run
            Id of the run, or the run, which then is not looked up again.

        Returns
        -------
        dict[str, float]
            Values by name, NaN and infinity among them; empty where there is no such file.
        """
        path = self._file(run, METRICS_FILE)
        if path is None:
            return {}
        values = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): float(value) for name, value in values.items()}

    def restore_files(self, run_id: str, folder: Path) -> None:
        """Copy every artifact of a run into ``folder``.

        Parameters
        ----------
        run_id : str
            Id of the run.
        folder : Path
            Folder to copy into.
        """
        for entry in self.client().list_artifacts(run_id):
            self.client().download_artifacts(run_id, entry.path, str(folder))

    def artifact(self, run_id: str, name: str) -> Path | None:
        """A file of a run.

        Parameters
        ----------
        run_id : str
            Id of the run.
        name : str
            Name of the file among its artifacts.

        Returns
        -------
        Path or None
            The file; None where the run is not in this store or has no such file.
        """
        run = self.run(run_id)
        return None if run is None else run_file(self.client(), run, name)

    def _file(self, run: str | MlflowRun, name: str) -> Path | None:
        found = self.client().get_run(run) if isinstance(run, str) else run
        return run_file(self.client(), found, name)

    def cases(self, run: str | MlflowRun) -> pd.DataFrame | None:
        """The per-case table of a run, or none if it has none.

        Parameters
        ----------
        run : str or mlflow.entities.Run
            Id of the run, or the run, which then is not looked up again.

        Returns
        -------
        pd.DataFrame or None
            The table; None if there is none.
        """
        path = self._file(run, CASES_FILE)
        return None if path is None else files.read_table(path)

    def begin_copy(self, experiment: str, name: str, tags: Mapping[str, str], start_ms: int) -> RunWriter:
        """Make a run that was run before, elsewhere: with its own start and tags, and no heartbeat.

        Until the copy is complete it names this process; ``tags`` of the process that ran it are to be set at the end.

        Parameters
        ----------
        experiment : str
            Name of the experiment.
        name : str
            Name of the run.
        tags : Mapping[str, str]
            Tags by name.
        start_ms : int
            Start in ms since 1970.

        Returns
        -------
        RunWriter
            The writer of the run.
        """
        own = shortened({**tags, **process_tags()})
        run = self.client().create_run(self.experiment_id(experiment), start_ms, own, name[:LONGEST])
        return RunWriter(self.client(), run.info.run_id, beating=False)

    def mark_orphans_failed(self, experiment: str) -> list[str]:
        """End as FAILED every RUNNING run of ``experiment`` whose process is gone; return their ids.

        On this machine a run is gone when its process is; on another one, or in another container, when its heartbeat
        has been silent for twenty minutes.

        Parameters
        ----------
        experiment : str
            Name of the experiment.

        Returns
        -------
        list[str]
            Ids of the runs.
        """
        return self._end_failed(
            experiment, lambda tags: {"ctus.ended_by": "process is gone"} if is_gone(tags) else None
        )

    def mark_ended_failed(
        self, experiment: str, ended: Iterable[tuple[str, Mapping[str, str], str]]
    ) -> list[str]:
        """End as FAILED the RUNNING runs of jobs whose processes are known to have ended, wherever they were.

        Parameters
        ----------
        experiment : str
            Name of the experiment.
        ended : iterable of (str, mapping of str to str, str)
            Hash of each job, the tags that its run has of its process, and what became of that.

        Returns
        -------
        list[str]
            Ids of the runs.
        """
        known = {key: (process, message) for key, process, message in ended}

        def why(tags: Mapping[str, str]) -> dict[str, str] | None:
            process, message = known.get(tags.get(HASH_TAG, ""), ({}, ""))
            same = process and all(tags.get(name) == value for name, value in process.items())
            return {"ctus.ended_by": "process is gone", "ctus.error": message} if same else None

        return self._end_failed(experiment, why) if known else []

    def _end_failed(
        self, experiment: str, why: Callable[[Mapping[str, str]], Mapping[str, str] | None]
    ) -> list[str]:
        """End as FAILED the RUNNING runs for which ``why``, asked with their tags, has further ones."""
        running = self.runs([experiment], "attributes.status = 'RUNNING'")
        found = {
            run.info.run_id: tags
            for run in running
            # Its process may have ended it, and then itself, since it was listed; once it is gone, nothing changes.
            if (tags := why(run.data.tags)) is not None
            and self.client().get_run(run.info.run_id).info.status == "RUNNING"
        }
        for run_id, tags in found.items():
            for name, value in shortened(tags).items():
                self.client().set_tag(run_id, name, value)
            self.client().set_terminated(run_id, "FAILED")
        return list(found)

    def _create_experiment(self, name: str) -> str:
        from mlflow.exceptions import MlflowException

        # A server decides itself where artifacts go; a database alone would put them under the current folder.
        served = self.address.startswith(("http://", "https://"))
        place = None if served else (self.folder / "artifacts").as_uri()
        try:
            return str(self.client().create_experiment(name, place, tags=KIND_TAGS))
        except MlflowException:
            # Another machine made it between the look and the making: the file lock reaches only this one.
            found = self.client().get_experiment_by_name(name)
            if found is None:
                raise
            return str(found.experiment_id)

    def _lock(self) -> FileLock:
        self.folder.mkdir(parents=True, exist_ok=True)
        return FileLock(self.folder / ".lock")


def _mlflow_program() -> str:
    """MLflow's command as a shell finds it: by its place where this Python's environment is not activated."""
    beside = Path(sys.executable).with_name("mlflow")
    known = shutil.which("mlflow")
    if not beside.is_file() or (known is not None and Path(known).resolve() == beside.resolve()):
        return "mlflow"
    here = Path.cwd()
    return shlex.quote(str(beside.relative_to(here) if beside.is_relative_to(here) else beside))


def sqlite_address(database: Path) -> str:
    """The tracking address of a SQLite file, whatever characters its path has.

    Parameters
    ----------
    database : Path
        SQLite file.

    Returns
    -------
    str
        The address.
    """
    plain = str(database)
    if _PLAIN_PATH.fullmatch(plain):
        return f"sqlite:///{plain}"
    from sqlalchemy import make_url

    # A question mark would begin the address's options, and a percent sign another character. The driver is named
    # because MLflow makes a folder of the quoted name for an address that begins with sqlite:///.
    quoted = f"sqlite+pysqlite:///{quote(plain)}"
    if make_url(quoted).database == plain:
        return quoted
    # SQLAlchemy before 2.1 does not read what is quoted, but SQLite's own form of an address does.
    return f"sqlite+pysqlite:///{database.as_uri()}?uri=true"


def sqlite_file(address: str) -> Path:
    """The file of such an address, however it is written.

    Parameters
    ----------
    address : str
        Tracking address.

    Returns
    -------
    Path
        The file.
    """
    from sqlalchemy import make_url

    path = make_url(address).database or ""
    return Path(unquote(path.removeprefix("file://"))) if path.startswith("file://") else Path(path)


def _make_database(database: Path) -> None:
    """Make a new store under another name and rename it: one that is killed on the way leaves nothing half made.

    Called under the lock, so that files of the other name are left over from a process that is gone.
    """
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    for left in database.parent.glob(f".{database.name}.making-*"):
        left.unlink(missing_ok=True)
    stage = database.parent / f".{database.name}.making-{os.getpid()}"
    SqlAlchemyStore(sqlite_address(stage), (database.parent / "artifacts").as_uri()).engine.dispose()
    stage.replace(database)


def _open(address: str, folder: Path, reads_only: bool = False) -> MlflowClient:
    """Open the store; a SQLite file that is not there yet is made and given its tables under a lock."""
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    import logging

    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.WARNING)
    from mlflow.tracking import MlflowClient

    if address.startswith(("sqlite:///", "sqlite+pysqlite:///")):
        database = sqlite_file(address)
        database.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(database.parent / f".{database.name}.lock"):
            if not database.exists() or not database.stat().st_size:
                _make_database(database)
            client = MlflowClient(tracking_uri=address, registry_uri=address)
            client.search_experiments(max_results=1)
            if database == folder / "ctus.db" and not reads_only:
                follow_move(database, folder / "artifacts")
        return client
    # MLflow's own seven retries take minutes for each call to a server that is away.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "3")
    client = MlflowClient(tracking_uri=address, registry_uri=address)
    client.search_experiments(max_results=1)
    return client
