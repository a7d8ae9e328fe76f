"""Files of a run: read in place where the store's files lie on this machine, else fetched through the tracker."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname


def local_folder(uri: str | None) -> Path | None:
    """The folder of a local address.

    Parameters
    ----------
    uri : str or None
        Address of a run's files.

    Returns
    -------
    Path or None
        The folder; None for the address of anything but a folder of this machine.
    """
    if not uri or not uri.startswith("file:"):
        return None
    return Path(url2pathname(urlsplit(uri).path))


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
