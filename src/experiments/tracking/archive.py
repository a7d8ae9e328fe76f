"""Runs as Parquet files, small enough to commit: a table can be rebuilt on a machine that never ran it.

Layout under a folder: ``<experiment>/runs.parquet`` (a row a run), ``<experiment>/history.parquet`` (a row a metric
and step) and ``<experiment>/cases/<run id>.parquet`` (the per-case table of a run). The folder's name is the
experiment's with all that means something to a file system quoted; its own name stands in the rows.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd

from experiments import files
from experiments.errors import InputError
from experiments.masking import masked
from experiments.outcome import InputData
from experiments.paths import project_root
from experiments.tracking.headline import metrics_text
from experiments.tracking.run_record import KIND_TAG, RunRecord
from registration.io.atomic import atomic_write, remove_leftovers

_JSON_COLUMNS = ("tags", "params")
# Kept of a run that has lost its files from an earlier export.
_KEPT_COLUMNS = ("config", "metrics", "inputs")
_COLUMNS = (
    *("run_id", "experiment", "name", "status", "start_ms", "end_ms", "parent_id"),
    *("tags", "params", "config"),
)
_ENDED = ("FINISHED", "FAILED", "KILLED")
# Longer names of folders are cut.
_LONGEST, _KEPT = 200, 160
_RUN_ID = re.compile(r"[\w-]{1,64}", re.ASCII)
# Not what follows a letter, a dot or a colon: a relative path, an address, a fraction.
_ABSOLUTE = re.compile(r"(?:(?<![\w.:/])|(?<=sqlite:///))/(?:[^\s/:'\",\]]+/)+([^\s/:'\",\]]*)")


def write_archive(records: Iterable[RunRecord], folder: Path, *, as_is: bool = False) -> int:
    """Write runs into ``folder``, next to those already there; a run written before is replaced. Returns the count.

    A run that has lost its files keeps the configuration and the table that an earlier export has of it.

    Parameters
    ----------
    records : Iterable[RunRecord]
        Runs to write.
    folder : Path
        Folder of the archive.
    as_is : bool, optional
        Whether folders of this machine stay in the texts: of an archive that waits here for this machine's tracker.

    Returns
    -------
    int
        Number of runs written.
    """
    by_experiment: dict[str, dict[str, RunRecord]] = {}
    count = 0
    for record in records:
        known = by_experiment.setdefault(record.experiment, {})
        # A run that was lost and then restored is in the store twice; what finished is the complete one.
        if record.run_id not in known or record.status == "FINISHED":
            known[record.run_id] = record
        count += 1
    for experiment, fresh in by_experiment.items():
        place = folder / folder_of(experiment)
        for record in fresh.values():
            _require_plain_id(record.run_id, record.experiment)
        for each in (place, place / "cases"):
            each.mkdir(parents=True, exist_ok=True)
            remove_leftovers(each)
        rows = pd.DataFrame([_row(record if as_is else shared(record)) for record in fresh.values()])
        history = pd.concat([record.history.assign(run_id=record.run_id) for record in fresh.values()])
        # The list of runs comes last: stopped at any point, all that it names is there.
        for record in fresh.values():
            if record.cases is not None:
                _write(record.cases, place / "cases" / f"{record.run_id}.parquet")
        _write(_merged(place / "history.parquet", history, fresh), place / "history.parquet")
        _write(_merged(place / "runs.parquet", rows, fresh), place / "runs.parquet")
    return count


def _write(table: pd.DataFrame, path: Path) -> None:
    """Write a table so that the one before stays until the new one is complete."""
    with atomic_write(path) as temporary:
        table.to_parquet(temporary, index=False)


def read_archive(
    folder: Path, experiments: list[str] | None = None, *, stand_ins: bool = True
) -> Iterator[RunRecord]:
    """Read the runs under ``folder``, parents before their children; only of the named experiments if any is named.

    Jobs that were exported while their sweep was running name a run above them that the archive lacks. In its place
    stands a KILLED one, with what all of the jobs have in common, so that they are one sweep here too.

    Parameters
    ----------
    folder : Path
        Folder of the archive.
    experiments : list[str] or None, optional
        Names of experiments; None for all.
    stand_ins : bool, optional
        Whether runs above the jobs of missing sweeps are made up; not where the tracker that gets the runs has them.

    Returns
    -------
    Iterator[RunRecord]
        The runs.
    """
    tables = sorted(folder.glob("*/runs.parquet"))
    if not tables:
        raise InputError(f"{folder}: expected exported runs (<experiment>/runs.parquet), found none")
    read = {table: _read(table, _COLUMNS) for table in tables}
    known = {run_id for rows in read.values() for run_id in rows["run_id"]}
    for table, rows in read.items():
        place = table.parent
        if experiments is not None:
            rows = rows[rows["experiment"].isin(experiments)]
        if not len(rows):
            continue
        history = _read(place / "history.parquet", ("run_id", "metric", "step", "value", "timestamp_ms"))
        rows = rows.assign(depth=_depths(rows)).sort_values(
            ["depth", "parent_id"], na_position="first", kind="stable"
        )
        if stand_ins:
            yield from _in_place_of_missing(rows[~rows["parent_id"].isin(known)], history, place)
        for row in rows.to_dict("records"):
            yield _record({str(key): value for key, value in row.items()}, history, place)


def _in_place_of_missing(rows: pd.DataFrame, history: pd.DataFrame, place: Path) -> Iterator[RunRecord]:
    """A run above the jobs of each sweep that is not there itself."""
    for parent, own in rows[rows["parent_id"].map(lambda given: isinstance(given, str))].groupby("parent_id"):
        _require_plain_id(parent, place / "runs.parquet")
        jobs = [
            _record({str(key): value for key, value in row.items()}, history, place)
            for row in own.to_dict("records")
        ]
        ends = [job.end_ms for job in jobs if job.end_ms is not None]
        yield RunRecord(
            run_id=str(parent),
            experiment=jobs[0].experiment,
            name=f"{jobs[0].experiment} ({len(jobs)} job{'s' * (len(jobs) > 1)})",
            status="KILLED",
            start_ms=min(job.start_ms for job in jobs),
            end_ms=max(ends, default=None),
            parent_id=None,
            tags={**_common([job.tags for job in jobs]), KIND_TAG: "sweep"},
            params=_common([job.params for job in jobs]),
            config="",
            history=history.iloc[:0].drop(columns="run_id"),
            cases=None,
        )


def _common(each: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """What is the same for all."""
    return {key: value for key, value in each[0].items() if all(other.get(key) == value for other in each)}


def _depths(rows: pd.DataFrame) -> list[int]:
    """How many runs of the archive stand above each."""
    above = dict(zip(rows["run_id"], rows["parent_id"], strict=True))

    def depth(run: object) -> int:
        seen: list[object] = []
        while isinstance(parent := above.get(run), str) and parent in above and parent not in seen:
            seen.append(parent)
            run = parent
        return len(seen)

    return [depth(run) for run in rows["run_id"]]


def folder_of(experiment: str) -> str:
    """The folder of an experiment in an archive: its name, quoted so that it is one folder inside the archive.

    Parameters
    ----------
    experiment : str
        Name of the experiment.

    Returns
    -------
    str
        The folder.

    Examples
    --------
    >>> folder_of("segmentation"), folder_of("team/x"), folder_of("../up")
    ('segmentation', 'team%2Fx', '%2E.%2Fup')
    """
    quoted = quote(experiment, safe=" ")
    # What begins with a dot is hidden or another folder; so is what is nothing but blanks, to some systems.
    if quoted.startswith("."):
        quoted = f"%2E{quoted[1:]}"
    quoted = quoted.replace(" ", "%20") if quoted != quoted.strip() else quoted
    if len(quoted) <= _LONGEST:
        return quoted
    return f"{quoted[:_KEPT]}%{hashlib.sha256(experiment.encode()).hexdigest()[:16]}"


def without_folders(text: str) -> str:
    """The text without passwords and folders of a machine.

    A path within the project starts at the project: files of one name in several of its folders stay apart. Every other
    absolute path is cut to its last part.

    Parameters
    ----------
    text : str
        Text that may name folders of this machine.

    Returns
    -------
    str
        The text without these folders.

    Examples
    --------
    >>> without_folders("root: /home/someone/data/usgra")
    'root: .../usgra'
    """
    within = re.compile(rf"(?<![\w.:/]){re.escape(str(project_root()))}/(?=[^\s/])")
    return _ABSOLUTE.sub(r".../\1", within.sub("", masked(text)))


def shared(record: RunRecord) -> RunRecord:
    """Give a run as an archive has it.

    Parameters
    ----------
    record : RunRecord
        The run.

    Returns
    -------
    RunRecord
        The run without passwords and folders of a machine.
    """
    return replace(
        record,
        tags={name: without_folders(value) for name, value in record.tags.items()},
        params={name: without_folders(value) for name, value in record.params.items()},
        config=without_folders(record.config),
        inputs=tuple(replace(data, source=without_folders(data.source)) for data in record.inputs),
    )


def _row(record: RunRecord) -> dict[str, Any]:
    row = {key: value for key, value in asdict(record).items() if key not in ("history", "cases")}
    texts = {key: json.dumps(row[key], sort_keys=True) for key in _JSON_COLUMNS}
    return {**row, **texts, "metrics": metrics_text(record.metrics), "inputs": json.dumps(row["inputs"])}


def _merged(path: Path, fresh: pd.DataFrame, replaced: Iterable[str]) -> pd.DataFrame:
    """The rows of ``path`` of other runs, then the fresh ones; sorted, so that the file changes only where runs do."""
    if path.is_file():
        old = _read(path, ())
        for name in _KEPT_COLUMNS if "config" in fresh else ():
            # Archives of before have no columns of metrics and of inputs.
            before = dict(zip(old["run_id"], old[name], strict=True)) if name in old else {}
            values = [
                value if value not in ("", "{}", "[]") else before.get(run) or value
                for run, value in zip(fresh["run_id"], fresh[name], strict=True)
            ]
            fresh = fresh.assign(**{name: values})
        kept = old[~old["run_id"].isin(list(replaced))]
        if len(kept):
            fresh = pd.concat([kept, fresh]) if len(fresh) else kept
    keys = [key for key in ("run_id", "metric", "step", "timestamp_ms") if key in fresh.columns]
    return fresh.sort_values(keys, kind="stable").reset_index(drop=True)


def _read(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    return files.read_table(path, "a table of exported runs", columns)


def _require_plain_id(run_id: object, where: object) -> None:
    # It becomes the name of a file.
    if not isinstance(run_id, str) or not _RUN_ID.fullmatch(run_id):
        raise InputError(f"{where}: expected run ids of letters, digits, - and _, received {run_id!r}")


def _record(row: dict[str, Any], history: pd.DataFrame, place: Path) -> RunRecord:
    table = place / "runs.parquet"
    _require_plain_id(row["run_id"], table)
    if row["status"] not in _ENDED:
        raise InputError(f"{table}: expected runs that ended ({', '.join(_ENDED)}), found {row['status']!r}")
    path = place / "cases" / f"{row['run_id']}.parquet"
    cases = _read(path, ()) if path.is_file() else None
    try:
        return RunRecord(
            run_id=row["run_id"],
            experiment=_text(row["experiment"]),
            name=_text(row["name"]),
            status=row["status"],
            start_ms=int(row["start_ms"]),
            end_ms=None if pd.isna(row["end_ms"]) else int(row["end_ms"]),
            parent_id=row["parent_id"] if isinstance(row["parent_id"], str) else None,
            tags=_texts(row["tags"]),
            params=_texts(row["params"]),
            config=_text(row["config"]),
            history=history[history["run_id"] == row["run_id"]].drop(columns="run_id"),
            cases=cases,
            metrics=_numbers(row.get("metrics")),
            inputs=_inputs(row.get("inputs")),
        )
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{table}: expected the fields of an exported run, found {error}") from error


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} where a text belongs")
    return value


def _numbers(value: object) -> dict[str, float]:
    found = json.loads(value) if isinstance(value, str) else {}
    return {str(key): float(item) for key, item in found.items()}


def _inputs(value: object) -> tuple[InputData, ...]:
    found = json.loads(value) if isinstance(value, str) else []
    return tuple(InputData(**{key: _text(item) for key, item in data.items()}) for data in found)


def _texts(value: object) -> dict[str, str]:
    found = json.loads(_text(value))
    if not isinstance(found, dict):
        raise TypeError(f"{value!r} where names with values belong")
    return {str(key): _text(item) for key, item in found.items()}
