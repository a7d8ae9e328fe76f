"""A project's own store whose folder was moved, renamed or copied: its runs' files are where the store is now.

The tracker keeps the place of every run's files as an absolute address and has no call that changes it.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from experiments.tracking.artifacts import local_folder


def follow_move(database: Path, artifacts: Path) -> int:
    """Point a SQLite store at ``artifacts``, the folder next to it, for what lay in one of that name elsewhere.

    Only what is found in ``artifacts``, or is no longer where the store says, is changed: another project's files that
    this store names stay where they are. Returns how many runs were changed.

    Parameters
    ----------
    database : Path
        SQLite file.
    artifacts : Path
        Folder of the artifacts.

    Returns
    -------
    int
        Number of addresses that were changed.
    """
    with closing(sqlite3.connect(database, timeout=60.0)) as store, store:
        experiments = store.execute("SELECT experiment_id, artifact_location FROM experiments").fetchall()
        changed = 0
        for identity, location in experiments:
            before = local_folder(location)
            if before is None or before == artifacts or before.parts[-2:] != artifacts.parts[-2:]:
                continue
            runs = store.execute(
                "SELECT run_uuid, artifact_uri FROM runs WHERE experiment_id = ?", (identity,)
            ).fetchall()
            moved = [(run, place) for run, uri in runs if (place := _moved(uri, before, artifacts))]
            store.executemany(
                "UPDATE runs SET artifact_uri = ? WHERE run_uuid = ?",
                [(place.as_uri(), run) for run, place in moved],
            )
            changed += len(moved)
            if moved or not before.is_dir():
                store.execute(
                    "UPDATE experiments SET artifact_location = ? WHERE experiment_id = ?",
                    (artifacts.as_uri(), identity),
                )
        return changed


def _moved(uri: str | None, before: Path, artifacts: Path) -> Path | None:
    """Where a run's files are now, if they lay under ``before`` and are no longer, or not only, there."""
    place = local_folder(uri)
    if place is None or not place.is_relative_to(before):
        return None
    now = artifacts / place.relative_to(before)
    return now if now.is_dir() or not place.exists() else None
