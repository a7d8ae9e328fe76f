"""The topmost runs of a store or an archive, with as little read of each as tells what it is about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.tracking import PARENT_TAG, Store, origin_of
from experiments.tracking.archive import read_archive
from experiments.tracking.artifacts import run_file
from experiments.tracking.run_record import CONFIG_FILE, is_job, resumed_ids

FINISHED = "FINISHED"


@dataclass(frozen=True)
class TopRun:
    """A run with none above it.

    Parameters
    ----------
    run_id : str
        Id that it had where it was first run.
    experiment : str
        Name of the experiment.
    name : str
        Name of the run.
    status : str
        FINISHED, FAILED or KILLED; RUNNING for a sweep that runs, or whose end was not recorded.
    start_ms : int
        Start in ms since 1970.
    tags : Mapping[str, str]
        Tags by name.
    config : str
        Resolved configuration as YAML of the first job that finished; empty where none did.
    finished : int
        Number of jobs that finished.
    """

    run_id: str
    experiment: str
    name: str
    status: str
    start_ms: int
    tags: Mapping[str, str] = field(default_factory=dict)
    config: str = ""
    finished: int = 0


def top_runs(store: Store, archive: Path | None, experiments: Sequence[str]) -> list[TopRun]:
    """List the topmost ended runs of some experiments, newest first, and sweeps that run and have jobs that finished.

    Parameters
    ----------
    store : Store
        The tracker, where no archive is named.
    archive : Path or None
        Folder of exported runs; None for the tracker.
    experiments : sequence of str
        Names of experiments.

    Returns
    -------
    list of TopRun
        The runs. One that was restored is listed under its first id, once.
    """
    found = _archived(archive, experiments) if archive is not None else _stored(store, experiments)
    once: dict[str, TopRun] = {}
    for run in found:
        if run.run_id not in once or run.status == FINISHED:
            once[run.run_id] = run
    return sorted(once.values(), key=lambda run: (-run.start_ms, run.run_id))


def _archived(archive: Path, experiments: Sequence[str]) -> Iterator[TopRun]:
    records = list(read_archive(archive, list(experiments)))
    by_id = {record.run_id: record for record in records}
    below: dict[str | None, list[Any]] = {}
    for record in records:
        below.setdefault(record.parent_id, []).append(record)
    for top in (record for record in records if record.parent_id not in by_id):
        own = [*_leaves(top, lambda run: below.get(run.run_id, ())), *_resumed(top.tags, by_id)]
        leaves = [leaf for leaf in own if leaf.status == FINISHED and is_job(leaf.tags)]
        first = min(leaves, key=lambda leaf: (leaf.start_ms, leaf.run_id), default=None)
        config = first.config if first is not None else ""
        told = (top.name, top.status, top.start_ms, top.tags)
        yield TopRun(top.run_id, top.experiment, *told, config, len(leaves))


def _stored(store: Store, experiments: Sequence[str]) -> Iterator[TopRun]:
    client = store.client()
    names = {each.experiment_id: each.name for each in client.search_experiments()}
    runs = list(store.runs(experiments))
    ids = {run.info.run_id for run in runs}
    origins = {origin_of(run): run for run in runs}
    below: dict[str | None, list[Any]] = {}
    for run in runs:
        below.setdefault(run.data.tags.get(PARENT_TAG), []).append(run)
    for top in (run for run in runs if run.data.tags.get(PARENT_TAG) not in ids):
        own = [*_leaves(top, lambda run: below.get(run.info.run_id, ())), *_resumed(top.data.tags, origins)]
        ended = [leaf for leaf in own if leaf.info.status == FINISHED and is_job(leaf.data.tags)]
        if top.info.status == "RUNNING" and not ended:
            continue
        first = min(ended, key=lambda leaf: (leaf.info.start_time, origin_of(leaf)), default=None)
        path = None if first is None else run_file(client, first, CONFIG_FILE)
        config = "" if path is None else path.read_text(encoding="utf-8")
        info, tags = top.info, dict(top.data.tags)
        experiment = names[info.experiment_id]
        told = (info.run_name, info.status, info.start_time, tags)
        yield TopRun(origin_of(top), experiment, *told, config, len(ended))


def _resumed(tags: Mapping[str, str], known: Mapping[str, Any]) -> list[Any]:
    """The jobs of an earlier sweep that a later one did not run again."""
    return [known[run_id] for run_id in resumed_ids(tags) if run_id in known]


def _leaves(run: Any, below: Any) -> Iterator[Any]:
    """The runs at the bottom: those that computed something."""
    own: Iterable[Any] = below(run)
    for child in own:
        yield from _leaves(child, below)
    if not own:
        yield run
