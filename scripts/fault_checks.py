"""What must hold after a fault: the store, the runs in it, the files, and their numbers."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.analysis.runs.timing import is_timing

TABLES = (".parquet", ".csv")


def numbers(folder: Path) -> dict[str, str]:
    """A digest of every number in the files of a folder, by path; runtimes, memory and dates are left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or hidden(path, folder):
            continue
        name = path.relative_to(folder).as_posix()
        if path.name == "metrics.json":
            values = json.loads(path.read_text(encoding="utf-8"))
            found[name] = _digest(sorted((key, repr(v)) for key, v in values.items() if not is_timing(key)))
        elif path.suffix in TABLES:
            found[name] = _digest(table_rows(path))
        elif path.suffix == ".bin":
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def table_rows(path: Path) -> list[str]:
    """The rows of a table as text, without columns that differ every time."""
    table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path, dtype=str)
    kept = [name for name in table.columns if not is_timing(str(name))]
    if {"metric", "value"} <= set(kept):  # a history: a row a metric
        table = table[[not is_timing(str(name)) for name in table["metric"]]]
    return [str(kept), *(repr(row) for row in table[kept].itertuples(index=False, name=None))]


def _digest(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()


def hidden(path: Path, folder: Path) -> bool:
    """Whether a path is under a name that stands for something temporary."""
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def half_written(folder: Path) -> list[str]:
    """Files under final names that cannot be read to their end."""
    return [
        path.relative_to(folder).as_posix()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not hidden(path, folder) and not _reads(path)
    ]


def _reads(path: Path) -> bool:
    try:
        if path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix in TABLES:
            table_rows(path)
        elif path.suffix == ".yaml":
            import yaml

            yaml.safe_load(path.read_text(encoding="utf-8"))
        elif path.suffix == ".png":
            from PIL import Image

            Image.open(path).load()
        elif path.suffix == ".pt":
            import torch

            torch.load(path, weights_only=True, map_location="cpu")
        elif path.suffix in (".html", ".svg"):
            return path.read_text(encoding="utf-8").rstrip().endswith((">",))
        return path.suffix in (".bin", ".lock", "") or path.stat().st_size > 0
    except Exception:
        return False


def leftovers(home: Path) -> list[str]:
    """What only a process under way may leave: temporary files and folders, plans of several processes."""
    names = (".*.partial-*", ".*.making-*")
    found = [path for name in names for path in home.rglob(name)]
    plans = home / ".cache" / "plans"
    found += list(plans.iterdir()) if plans.is_dir() else []
    return sorted({path.relative_to(home).as_posix() for path in found})


def store_state(home: Path, address: str | None = None) -> dict[str, Any]:
    """Whether the store opens and is whole, and its runs: status, kind, hash, metrics and files."""
    os.environ["CTUS_HOME"] = str(home)
    from experiments.tracking import HASH_TAG, Store

    database, whole = home / "mlruns" / "ctus.db", "ok"
    if address is None:
        # Not read-only: what a killed process has left in the journal is rolled back by whoever opens the file next.
        with sqlite3.connect(f"file:{database}?mode=rw", uri=True) as connection:
            whole = str(connection.execute("PRAGMA integrity_check").fetchone()[0])
    store = Store(uri=address)
    runs = [
        {
            "id": run.info.run_id,
            "status": run.info.status,
            "kind": run.data.tags.get("ctus.kind", ""),
            "hash": run.data.tags.get(HASH_TAG, ""),
            "parent": run.data.tags.get("mlflow.parentRunId", ""),
            "metrics": {k: repr(v) for k, v in sorted(run.data.metrics.items()) if not is_timing(k)},
            "steps": _steps(store, run),
            "files": sorted(file.path for file in store.client().list_artifacts(run.info.run_id)),
        }
        for run in store.runs()
    ]
    return {"whole": whole, "runs": runs}


def _steps(store: Any, run: Any) -> dict[str, int]:
    client = store.client()
    return {key: len(client.get_metric_history(run.info.run_id, key)) for key in sorted(run.data.metrics)}


def tracked(state: dict[str, Any]) -> dict[str, Any]:
    """The finished jobs by hash with their tracked metrics: what a later fault must not change."""
    jobs = [run for run in state["runs"] if run["status"] == "FINISHED" and run["kind"] == "job"]
    return {run["hash"]: run["metrics"] for run in jobs}


def statuses(state: dict[str, Any]) -> Counter[str]:
    """How many runs have each status."""
    return Counter(run["status"] for run in state["runs"])
