"""Files of a run: read in place where the store's files lie on this machine, else fetched through the tracker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from experiments.tracking.moved import local_folder


def run_file(client: Any, run: Any, name: str) -> Path | None:
    """Find a file of a run.

    The tracker looks a run up several times for each file that it hands out, which takes most of the time that a report
    of many runs takes: a file on this machine is opened where it lies.

    Parameters
    ----------
    client : mlflow.tracking.MlflowClient
        Client of the store.
    run : mlflow.entities.Run
        The run.
    name : str
        Name of the file at the top of its artifacts.

    Returns
    -------
    Path or None
        The file; None where the run has no such file.
    """
    folder = local_folder(run.info.artifact_uri)
    if folder is not None:
        path = folder / name
        return path if path.is_file() else None
    if not any(file.path == name for file in client.list_artifacts(run.info.run_id)):
        return None
    return Path(client.download_artifacts(run.info.run_id, name))
