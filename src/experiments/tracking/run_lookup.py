"""Runs by their id, or by the first characters of it, with all runs below them: from a store or from an archive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments import files
from experiments.errors import InputError
from experiments.masking import masked
from experiments.paths import project_root
from experiments.tracking import PARENT_TAG, Store, origin_of
from experiments.tracking.archive import read_archive
from experiments.tracking.run_record import RunRecord, is_job, read_run, resumed_ids

# Of so many runs an id may be the beginning before the rest is left out of the message.
MOST_NAMED = 5


@dataclass(frozen=True)
class Family:
    """A run and all runs below it.

    Parameters
    ----------
    run : RunRecord
        The run that was asked for.
    below : tuple of RunRecord, optional
        Runs below it at any depth, in the order in which they started.
    """

    run: RunRecord
    below: tuple[RunRecord, ...] = ()

    @property
    def digests(self) -> dict[str, dict[str, str]]:
        """Beginning of the digest of each data set by its name, by the id of the run that used it."""
        return {
            run.run_id: {data.name: data.digest for data in run.inputs}
            for run in (self.run, *self.below)
            if run.inputs
        }

    @property
    def jobs(self) -> tuple[RunRecord, ...]:
        """The runs that computed something: those with no run below them.

        A run over others whose jobs an earlier sweep had all finished has none below it and is no job.
        """
        parents = {run.parent_id for run in self.below}
        every = (self.run, *self.below)
        return tuple(run for run in every if run.run_id not in parents and is_job(run.tags))

    @property
    def above(self) -> tuple[RunRecord, ...]:
        """The runs that sum up others."""
        jobs = {run.run_id for run in self.jobs}
        return tuple(run for run in (self.run, *self.below) if run.run_id not in jobs)


def find_family(reference: str, store: Store, archive: Path | None = None, setting: str = "run") -> Family:
    """Find a run by its id, with all runs below it.

    Parameters
    ----------
    reference : str
        Id of the run where it was first run or in this store, or the first characters of it.
    store : Store
        The tracker, where no archive is named.
    archive : Path or None, optional
        Folder of exported runs; None for the tracker.
    setting : str, optional
        Name of the setting that ``reference`` comes from, for messages.

    Returns
    -------
    Family
        The run and those below it.

    Raises
    ------
    InputError
        If no run has such an id, or several do.
    """
    return find_families([reference], store, archive, setting)[0]


def find_families(
    references: Sequence[str], store: Store, archive: Path | None = None, setting: str = "runs"
) -> list[Family]:
    """Find several runs by their ids, each with all runs below it; store or archive are listed once.

    Parameters
    ----------
    references : Sequence[str]
        Ids of the runs where they were first run or in this store, or the first characters of them.
    store : Store
        The tracker, where no archive is named.
    archive : Path or None, optional
        Folder of exported runs; None for the tracker.
    setting : str, optional
        Name of the setting that ``references`` come from, for messages.

    Returns
    -------
    list of Family
        The runs and those below them, in the order of the references.

    Raises
    ------
    InputError
        If no run has such an id, or several do.
    """
    if any(not reference.strip() for reference in references):
        raise InputError(f"{setting}: expected the id of a run, received none")
    if not references:
        return []
    if archive is not None:
        records = {record.run_id: record for record in read_archive(archive)}
        return [_archived(reference, records, archive, setting) for reference in references]
    listed = _Listed.of(store)
    return [_stored(reference, store, listed, setting) for reference in references]


def _archived(reference: str, records: Mapping[str, RunRecord], archive: Path, setting: str) -> Family:
    found = {key: record for key, record in records.items() if key.startswith(reference)}
    titles = {key: f"{record.experiment}, {record.name}" for key, record in found.items()}
    top = found[_only(reference, titles, f"the archive {archive}", setting)]
    below = {run.run_id: run for run in _below(top.run_id, records.values())}
    below |= {key: records[key] for key in resumed_ids(top.tags) if key in records}
    return Family(top, _sorted(below.values()))


def _below(run_id: str, records: Iterable[RunRecord]) -> list[RunRecord]:
    every = list(records)
    own = [record for record in every if record.parent_id == run_id]
    return own + [further for record in own for further in _below(record.run_id, every)]


@dataclass(frozen=True)
class _Listed:
    """All runs of a store, newest first, also by the id where each was first run and by the run above it."""

    runs: Sequence[Any]
    origins: Mapping[str, Any]
    below: Mapping[str, Sequence[Any]]
    names: Mapping[str, str]

    @staticmethod
    def of(store: Store) -> _Listed:
        origins: dict[str, Any] = {}
        below: dict[str, list[Any]] = {}
        runs = list(store.runs())
        for run in runs:
            origins.setdefault(origin_of(run), run)
            if PARENT_TAG in run.data.tags:
                below.setdefault(run.data.tags[PARENT_TAG], []).append(run)
        names = {each.experiment_id: each.name for each in store.client().search_experiments()}
        return _Listed(runs, origins, below, names)

    def title(self, run: Any) -> str:
        return f"{self.names[run.info.experiment_id]}, {run.info.run_name}"

    def read(self, store: Store, run: Any) -> RunRecord:
        return read_run(store, run.info.run_id, self.names[run.info.experiment_id])


def _stored(reference: str, store: Store, listed: _Listed, setting: str) -> Family:
    found: dict[str, Any] = {}
    # Of two runs with one origin, the newer is seen first and kept.
    for run in listed.runs:
        if origin_of(run).startswith(reference) or run.info.run_id.startswith(reference):
            found.setdefault(origin_of(run), run)
    titles = {origin: listed.title(run) for origin, run in found.items()}
    top = found[_only(reference, titles, f"the store {masked(store.address)}", setting)]
    below, waiting = list[RunRecord](), [top]
    while waiting:
        run = waiting.pop(0)
        below.append(listed.read(store, run))
        waiting += listed.below.get(run.info.run_id, ())
    known = {record.run_id for record in below}
    for run_id in resumed_ids(top.data.tags):
        run = None if run_id in known else listed.origins.get(run_id)
        if run is not None:
            below.append(listed.read(store, run))
    return Family(below[0], _sorted(below[1:]))


def _sorted(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    return tuple(sorted(records, key=lambda record: (record.start_ms, record.run_id)))


def _only(reference: str, titles: Mapping[str, str], place: str, setting: str) -> str:
    """The one id that was found; InputError names those that an unclear one begins."""
    if reference in titles:
        return reference
    if len(titles) == 1:
        return next(iter(titles))
    if not titles:
        raise InputError(
            f"{setting}: expected the id of a run in {place}, found none that begins with {reference!r}"
            f"{_elsewhere(reference, place)}"
        )
    named = [f"{key[:12]} ({title})" for key, title in list(titles.items())[:MOST_NAMED]]
    more = f" and {len(titles) - MOST_NAMED} others" if len(titles) > MOST_NAMED else ""
    raise InputError(
        f"{setting}: expected the id of one run in {place}, received {reference!r}, with which those of "
        f"{len(titles)} runs begin: {', '.join(named)}{more}"
    )


def _elsewhere(reference: str, place: str) -> str:
    """Whether the project's own archive has such a run, as the end of a message."""
    archive = project_root() / "results" / "runs"
    if place == f"the archive {archive}":
        return ""
    for table in sorted(archive.glob("*/runs.parquet")):
        ids = files.read_table(table, "a table of exported runs", ["run_id"])["run_id"]
        if ids.astype(str).str.startswith(reference).any():
            return f"; {archive} has one: pass archive={archive}"
    return ""
