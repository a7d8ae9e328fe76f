"""Runs that wait for the tracker: what it could not be told, or refused, is delivered once it takes it again.

A folder below the project holds them, each as an archive of one run. The next call delivers them, oldest first. A run
that the tracker knows is completed in its place; one that it does not know is added, and the runs below it find it.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd
from filelock import FileLock, Timeout

from experiments import files
from experiments.masking import masked
from experiments.provenance import process_tags
from experiments.tracking import (
    CASES_FILE,
    METRICS_FILE,
    ORIGIN_TAG,
    PARENT_TAG,
    RunWriter,
    Store,
    server_unreachable,
)
from experiments.tracking.archive import read_archive, write_archive
from experiments.tracking.run_record import RunRecord, restore_run, write_record
from experiments.tracking.run_writer import shortened
from registration.io.atomic import atomic_folder, remove_leftovers, write_atomic

FILES = "files.json"


def keep(run: RunWriter, folder: Path) -> Path:
    """Keep a run that has ended for a later delivery.

    Parameters
    ----------
    run : RunWriter
        The run, of which the tracker lacks something.
    folder : Path
        Folder of waiting runs (``Store.undelivered``).

    Returns
    -------
    Path
        The run's own folder, which ``study=import_runs`` reads too.
    """
    record = written_run(run)
    with atomic_folder(folder / f"{record.start_ms:014d}-{record.run_id}") as stage:
        write_archive([record], stage, as_is=True)
        write_atomic(stage / FILES, json.dumps(run.written.files).encode())
    return folder / f"{record.start_ms:014d}-{record.run_id}"


def waiting(folder: Path) -> list[Path]:
    """The runs that wait, oldest first.

    Parameters
    ----------
    folder : Path
        Folder of waiting runs.

    Returns
    -------
    list of Path
        The folder of each.
    """
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))


def deliver(store: Store) -> int:
    """Deliver every run that waits, each once and in the order in which they began; say what came of it.

    Nothing is done while another process delivers. What the tracker refuses waits on.

    Parameters
    ----------
    store : Store
        The tracker.

    Returns
    -------
    int
        Number of runs that were delivered.
    """
    folder = store.undelivered
    if not waiting(folder):
        return 0
    delivered, reason = 0, ""
    try:
        with FileLock(folder / ".lock", timeout=0):
            remove_leftovers(folder)
            for path in waiting(folder):
                try:
                    _deliver_one(store, path)
                except Exception as refusal:
                    reason = reason or masked((str(refusal).splitlines() or [type(refusal).__name__])[0])
                    if server_unreachable(refusal):
                        break
                    continue
                delivered += 1
                shutil.rmtree(path)
    except (Timeout, OSError):
        return delivered
    _say(delivered, waiting(folder), folder, reason)
    return delivered


def _say(delivered: int, left: Sequence[Path], folder: Path, reason: str) -> None:
    if delivered:
        print(f"The tracker got {delivered} runs that had waited for it.", file=sys.stderr)
    if left:
        print(f"{len(left)} runs wait for the tracker in {folder} ({reason}).", file=sys.stderr)


def _deliver_one(store: Store, path: Path) -> None:
    for record in read_archive(path, stand_ins=False):
        known = known_run(store, record.run_id)
        if known is None:
            # A run above that is still to come finds those that name it.
            above = None if record.parent_id is None else known_run(store, record.parent_id)
            known = restore_run(store, record, above or record.parent_id)
            _adopt(store, record, known)
        else:
            complete_run(store, record, known, exact=True)
        _deliver_files(store, record, known, path / FILES)


def known_run(store: Store, run_id: str) -> str | None:
    """The id under which the tracker has a run.

    Parameters
    ----------
    store : Store
        The tracker.
    run_id : str
        Id of the run where it was first run.

    Returns
    -------
    str or None
        Its own id, or that of its copy; None where the tracker has neither, or has it deleted.
    """
    found = store.run(run_id)
    if found is not None and found.info.lifecycle_stage == "active":
        return run_id
    copy = next(store.runs(None, f"tags.`{ORIGIN_TAG}` = '{run_id}'"), None)
    return None if copy is None else str(copy.info.run_id)


def _adopt(store: Store, record: RunRecord, run_id: str) -> None:
    """Have runs that name a run by the id that the tracker did not know name the one it has."""
    for below in list(store.runs([record.experiment], f"tags.`{PARENT_TAG}` = '{record.run_id}'")):
        store.client().set_tag(below.info.run_id, PARENT_TAG, run_id)


def _deliver_files(store: Store, record: RunRecord, run_id: str, listed: Path) -> None:
    """Add the run's further files, as far as they are where they were written and no later call has replaced them."""
    if not listed.is_file():
        return
    there = {file.path for file in store.client().list_artifacts(run_id)}
    writer = RunWriter(store.client(), run_id, beating=False)
    for folder, name in json.loads(listed.read_text(encoding="utf-8")):
        path = Path(folder) / name
        if name not in there and path.is_file() and path.stat().st_mtime * 1000 <= (record.end_ms or 0):
            writer.files(Path(folder), [name])


def written_run(run: RunWriter) -> RunRecord:
    """A run of this process that has just ended, as ``read_run`` would have read it from a tracker that took it all.

    Parameters
    ----------
    run : RunWriter
        The run.

    Returns
    -------
    RunRecord
        The run.
    """
    start, written = run.start, run.written
    assert start is not None, "a run begun or reopened by Store knows what it was begun with"
    assert written.status is not None and written.end_ms is not None, "a run is kept once it has ended"
    metrics, cases = written.text_of(METRICS_FILE), written.file_of(CASES_FILE)
    history = pd.DataFrame(written.points, columns=["metric", "value", "timestamp_ms", "step"])
    return RunRecord(
        run_id=run.run_id,
        experiment=start.experiment,
        name=start.name,
        status=written.status,
        start_ms=start.start_ms,
        end_ms=written.end_ms,
        parent_id=start.parent_id,
        tags={k: v for k, v in shortened({**start.tags, **written.tags}).items() if k != PARENT_TAG},
        params=dict(written.params),
        config=written.texts.get("config.yaml", ""),
        history=history[["metric", "step", "value", "timestamp_ms"]],
        cases=None if cases is None else files.read_table(cases),
        metrics={str(name): float(value) for name, value in json.loads(metrics or "{}").items()},
        inputs=tuple(written.inputs),
    )


def complete_run(store: Store, record: RunRecord, run_id: str, *, exact: bool = False) -> None:
    """Give a run of the store what it lacks of a record, and end it as the record says. A second time changes nothing.

    Parameters
    ----------
    store : Store
        The tracker.
    record : RunRecord
        The run as it was computed.
    run_id : str
        Id of the run in the store, which is not complete there.
    exact : bool, optional
        Whether the record's texts are those of the run, and not those of an archive, which has no folders.
    """
    there = store.client().get_run(run_id).data
    writer = RunWriter(store.client(), run_id, beating=False)
    missing = {name: value for name, value in record.params.items() if name not in there.params}
    process = process_tags().keys()
    tags = {k: v for k, v in record.tags.items() if exact or k in process or k not in there.tags}
    write_record(writer, replace(record, params=missing))
    writer.tags(tags)
    outdated = ("ctus.ended_by", "ctus.error")
    writer.drop_tags(name for name in outdated if name in there.tags and name not in record.tags)
    writer.end(record.status, record.end_ms)
    if writer.incomplete:
        raise RuntimeError(f"the tracker took only a part of run {run_id}")
