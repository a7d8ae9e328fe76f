"""The whole of ``ctus doctor``: the words of the call, all findings, the page and the exit code."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.command_line.doctor import machine, packages, places
from experiments.command_line.doctor.findings import Finding, exit_code, page
from experiments.errors import InputError, did_you_mean
from experiments.paths import project_root
from experiments.tracking.store import Store

USAGE = """\
ctus doctor [data=<folder of data sets>] [tracking.uri=<address>]

What this machine has, what is missing, and the line that installs it: Python, packages, system libraries, processor,
GPU, disk, the tracking store and data sets. Nothing is changed. Exit code 0 when ctus can work, 1 when it can't.
"""
SETTINGS = ("data", "tracking.uri")


def doctor(words: Sequence[str]) -> int:
    """Look at the machine and print what was found.

    Parameters
    ----------
    words : sequence of str
        Words after ``doctor``.

    Returns
    -------
    int
        Exit code: 0 when ctus can work, 1 when something that it needs is missing.

    Raises
    ------
    InputError
        For a word that is none of its settings, and a folder of data that does not exist.
    """
    if any(word in ("--help", "-h") for word in words):
        print(USAGE, end="")
        return 0
    given = _settings(words)
    found = findings(given.get("data"), given.get("tracking.uri"))
    print(page(found))
    return exit_code(found)


def findings(data: str | None = None, uri: str | None = None) -> list[Finding]:
    """Look at everything, in the order that the page shows.

    Parameters
    ----------
    data : str or None, optional
        Folder of data sets; None for the usual places.
    uri : str or None, optional
        Tracking address; None for that of the environment, else the project's own store.

    Returns
    -------
    list of Finding
        All findings.

    Raises
    ------
    InputError
        If ``data`` does not exist.
    """
    folders = places.data_folders(data)
    return [
        packages.interpreter(),
        *packages.required_packages(),
        *packages.system_libraries(),
        *packages.compiled_packages(),
        *packages.optional_packages(),
        machine.processor(),
        machine.gpu(),
        machine.free_disk(project_root()),
        places.store(Store(uri).address),
        *places.data_sets(folders),
    ]


def _settings(words: Sequence[str]) -> dict[str, str]:
    given = {}
    for word in words:
        name, separator, value = word.partition("=")
        if name not in SETTINGS or not separator or not value.strip():
            raise InputError(
                f"{word}: expected {' or '.join(f'{each}=<value>' for each in SETTINGS)} after doctor, received "
                f"something else{did_you_mean(name, SETTINGS)}"
            )
        given[name] = value
    return given
