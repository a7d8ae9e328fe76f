"""The tracking store and the data sets: where they are looked for and what is there."""

from __future__ import annotations

import os
import re
import sqlite3
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from urllib.parse import quote, unquote

import yaml

from experiments.command_line.doctor.findings import Finding, State
from experiments.errors import InputError
from experiments.masking import masked
from experiments.paths import conf_dir, project_root
from experiments.tracking.addresses import SERVERS, require_address

_WAIT_S = 5.0
_SQLITE = re.compile(r"sqlite(?P<driver>\+pysqlite)?:///(file://)?(?P<path>[^?]+)(\?uri=true)?")
# Files of a data set are counted up to this many, so that a large one on a slow disk does not hold up the page.
_MOST_FILES = 20_000


def store(address: str) -> Finding:
    """Look whether a tracking store can be opened; nothing is made or changed.

    Parameters
    ----------
    address : str
        Tracking address.

    Returns
    -------
    Finding
        Missing for a wrong address, a server that does not answer, a file that is no store or can't be written.
    """
    try:
        require_address(address)
    except InputError as refusal:
        return Finding("store", State.MISSING, str(refusal))
    if address.startswith(SERVERS):
        return _server(address)
    if (file := _SQLITE.fullmatch(address)) is not None:
        # Only an address that names the driver is quoted (experiments.tracking.store.sqlite_address).
        return _file(Path(unquote(file["path"]) if file["driver"] else file["path"]))
    return Finding("store", State.NOTE, f"{masked(address)}: a database is opened at the first run, not here")


def _server(address: str) -> Finding:
    shown = masked(address)
    try:
        with urllib.request.urlopen(f"{address.rstrip('/')}/health", timeout=_WAIT_S) as response:
            answer = response.status
    except (OSError, ValueError) as error:
        reason = masked(str(getattr(error, "reason", error)))
        return Finding("store", State.MISSING, f"{shown}: expected an MLflow server, received {reason}")
    return Finding("store", State.OK, f"{shown} answers ({answer})")


def _file(path: Path) -> Finding:
    there = next(each for each in (path, *path.parents) if each.exists())
    if not os.access(there, os.W_OK):
        remedy = "CTUS_HOME=<folder that can be written>"
        return Finding("store", State.MISSING, f"{path}: expected a place that can be written", remedy)
    if not path.exists():
        return Finding("store", State.OK, f"{path} is made at the first run")
    try:
        with closing(
            sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True, timeout=_WAIT_S)
        ) as opened:
            (runs,) = opened.execute("select count(*) from runs").fetchone()
    except sqlite3.Error as error:
        remedy = f"mv {path} {path}.broken"
        return Finding(
            "store", State.MISSING, f"{path}: expected a store of MLflow, received {error}", remedy
        )
    return Finding("store", State.OK, f"{path} opens, {runs} runs")


def data_folders(given: str | None = None) -> list[Path]:
    """List the folders that data sets are looked for in.

    Parameters
    ----------
    given : str or None, optional
        Folder of data sets that the call names; None for the usual places.

    Returns
    -------
    list of Path
        Absolute paths.

    Raises
    ------
    InputError
        If the call names a folder that does not exist.
    """
    if given is not None:
        folder = Path(given).expanduser().absolute()
        if not folder.is_dir():
            raise InputError(f"data: expected a folder of data sets, received {given!r}")
        return [folder]
    usual = (Path.cwd() / "data", project_root() / "data", project_root().parent / "shared" / "data")
    return list(dict.fromkeys(usual))


def data_sets(folders: Sequence[Path]) -> list[Finding]:
    """Look for the data sets that the configurations know; none of them is needed.

    Parameters
    ----------
    folders : sequence of Path
        Folders that may hold them, each data set in a folder of its own name.

    Returns
    -------
    list of Finding
        What was found where, and one note for those that were not.
    """
    findings, absent = [], []
    for name, options in _known().items():
        place = next((folder / name for folder in folders if (folder / name).is_dir()), None)
        if place is None:
            absent.append(name)
            continue
        files = sum(1 for _ in zip(_files(place), range(_MOST_FILES), strict=False))
        count = f"{files} file{'s' * (files != 1)}" if files < _MOST_FILES else f"{_MOST_FILES} files or more"
        findings.append(
            Finding(
                f"data {name}",
                State.OK if files else State.NOTE,
                f"{place}, {count}",
                f"ctus study=inspect_dataset dataset={options[0]} dataset.root={place}",
            )
        )
    if absent:
        looked = " or ".join(map(str, folders))
        instead = "dataset=phantom needs none, dataset.simulate=true makes a substitute"
        text = f"{', '.join(absent)}: not in {looked}; {instead}"
        findings.append(Finding("data", State.NOTE, text, "ctus doctor data=<folder of data sets>"))
    return findings


def _known() -> dict[str, list[str]]:
    """The options of each data set by the name of its folder, as its configuration has it."""
    known: dict[str, list[str]] = {}
    for path in sorted((conf_dir() / "dataset").glob("*.yaml")):
        settings = yaml.safe_load(path.read_text(encoding="utf-8"))
        root = settings.get("root")
        # What is published under a name has a simulated substitute; a folder of the user's own has neither.
        if isinstance(root, str) and "simulate" in settings:
            known.setdefault(Path(root).name, []).append(path.stem)
    return known


def _files(folder: Path) -> Iterator[str]:
    for _, _, names in os.walk(folder):
        yield from names
