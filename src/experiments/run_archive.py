"""Runs as Parquet files, small enough to commit: a table can be rebuilt on a machine that never ran it.

Layout under a folder: ``<experiment>/runs.parquet`` (a row a run), ``<experiment>/history.parquet`` (a row a metric
and step) and ``<experiment>/cases/<run id>.parquet`` (the per-case table of a run).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.errors import InputError
from experiments.run_record import RunRecord

_JSON_COLUMNS = ("tags", "params")
# Not what follows a letter, a dot or a colon: a relative path, an address, a fraction.
_ABSOLUTE = re.compile(r"(?:(?<![\w.:/])|(?<=sqlite:///))/(?:[^\s/:'\",\]]+/)+([^\s/:'\",\]]*)")


def write_archive(records: Iterable[RunRecord], folder: Path) -> int:
    """Write runs into ``folder``, beside those already there; a run written before is replaced. Returns the count."""
    by_experiment: dict[str, dict[str, RunRecord]] = {}
    count = 0
    for record in records:
        by_experiment.setdefault(record.experiment, {})[record.run_id] = record
        count += 1
    for experiment, fresh in by_experiment.items():
        place = folder / experiment
        place.mkdir(parents=True, exist_ok=True)
        rows = pd.DataFrame([_row(record) for record in fresh.values()])
        history = pd.concat([record.history.assign(run_id=record.run_id) for record in fresh.values()])
        _merged(place / "runs.parquet", rows, fresh).to_parquet(place / "runs.parquet", index=False)
        _merged(place / "history.parquet", history, fresh).to_parquet(place / "history.parquet", index=False)
        for record in fresh.values():
            if record.cases is not None:
                (place / "cases").mkdir(exist_ok=True)
                record.cases.to_parquet(place / "cases" / f"{record.run_id}.parquet", index=False)
    return count


def read_archive(folder: Path, experiments: list[str] | None = None) -> Iterator[RunRecord]:
    """Read the runs under ``folder``, parents before their children; only of the named experiments if any is named."""
    tables = sorted(folder.glob("*/runs.parquet"))
    if not tables:
        raise InputError(f"{folder}: expected exported runs (<experiment>/runs.parquet), found none")
    for table in tables:
        place = table.parent
        if experiments is not None and place.name not in experiments:
            continue
        history = pd.read_parquet(place / "history.parquet")
        rows = pd.read_parquet(table).sort_values("parent_id", na_position="first", kind="stable")
        for row in rows.to_dict("records"):
            yield _record({str(key): value for key, value in row.items()}, history, place)


def without_folders(text: str) -> str:
    """The text with every absolute path cut to its last part.

    >>> without_folders("root: /home/someone/data/usgra")
    'root: .../usgra'
    """
    return _ABSOLUTE.sub(r".../\1", text)


def _row(record: RunRecord) -> dict[str, Any]:
    row = {key: value for key, value in asdict(record).items() if key not in ("history", "cases")}
    for key in _JSON_COLUMNS:
        row[key] = json.dumps(
            {name: without_folders(value) for name, value in row[key].items()}, sort_keys=True
        )
    return {**row, "config": without_folders(record.config)}


def _merged(path: Path, fresh: pd.DataFrame, replaced: Iterable[str]) -> pd.DataFrame:
    """The rows of ``path`` of other runs, then the fresh ones; sorted, so that the file changes only where runs do."""
    if path.is_file():
        old = pd.read_parquet(path)
        kept = old[~old["run_id"].isin(list(replaced))]
        if len(kept):
            fresh = pd.concat([kept, fresh]) if len(fresh) else kept
    keys = [key for key in ("run_id", "metric", "step", "timestamp_ms") if key in fresh.columns]
    return fresh.sort_values(keys, kind="stable").reset_index(drop=True)


def _record(row: dict[str, Any], history: pd.DataFrame, place: Path) -> RunRecord:
    cases = place / "cases" / f"{row['run_id']}.parquet"
    return RunRecord(
        run_id=row["run_id"],
        experiment=row["experiment"],
        name=row["name"],
        status=row["status"],
        start_ms=int(row["start_ms"]),
        end_ms=None if pd.isna(row["end_ms"]) else int(row["end_ms"]),
        parent_id=row["parent_id"] if isinstance(row["parent_id"], str) else None,
        tags=json.loads(row["tags"]),
        params=json.loads(row["params"]),
        config=row["config"],
        history=history[history["run_id"] == row["run_id"]].drop(columns="run_id"),
        cases=pd.read_parquet(cases) if cases.is_file() else None,
    )
