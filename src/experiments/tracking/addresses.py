"""Tracking addresses: which are taken, and the error where one can't be opened."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from experiments.errors import InputError
from experiments.masking import masked
from experiments.tracking.run_writer import ServerAwayError, server_unreachable

SERVERS = ("http", "https")
DATABASES = ("sqlite", "postgresql", "mysql", "mssql")
_EXPECTED = (
    "tracking.uri: expected the address of an MLflow server (http://host:port, https://...) or of a database "
    "(sqlite:///file, postgresql://..., mysql://..., mssql://...)"
)
_UNKNOWN_NAME = re.compile(r"NameResolutionError|Name or service not known|getaddrinfo failed")
# What a server says with a number instead of an answer; of the others it is enough that they are none of MLflow's.
_SAID = {
    "401": (
        "to know this user",
        " (MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD, or MLFLOW_TRACKING_TOKEN, say who it is)",
    ),
    "403": ("to let this machine in", " (mlflow server --allowed-hosts names the hosts it answers)"),
}


def require_address(address: str) -> None:
    """Raise InputError unless ``address`` is one that runs can be tracked at.

    Parameters
    ----------
    address : str
        Tracking address.
    """
    scheme, separator, rest = address.partition("://")
    if not separator:
        # "localhost:5000", "tracker.example/mlflow"; a path of the file system is no server.
        host = re.fullmatch(r"(localhost|[\w-]+(\.[\w-]+)+|[\w.-]+(?=:\d))(:\d+)?(/.*)?", address)
        guess = f"; did you mean http://{masked(address)}?" if host else ""
        raise InputError(f"{_EXPECTED}, received {masked(address)!r}{guess}")
    if scheme.partition("+")[0] not in (*SERVERS, *DATABASES):
        raise InputError(f"{_EXPECTED}, received {masked(address)!r}")
    if scheme == "sqlite" and not rest.startswith("/"):
        raise InputError(
            f"{_EXPECTED}, received {masked(address)!r} (an absolute path follows three slashes: sqlite:////runs.db)"
        )
    if scheme in SERVERS:
        try:
            parts = urlsplit(address)
            valid = bool(parts.hostname) and (parts.port or 1) > 0 and not re.search(r"\s", address)
        except ValueError:  # a port that is no number
            valid = False
        if not valid:
            raise InputError(f"{_EXPECTED}, received {masked(address)!r}")


@contextmanager
def opening(address: str) -> Iterator[None]:
    """Say in one sentence, as an InputError, why a store can't be opened at ``address``.

    Parameters
    ----------
    address : str
        Tracking address.
    """
    require_address(address)
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # of MLflow, of the database's driver, of the network, of the file system
        if server_unreachable(error):
            reason = f"expected an MLflow server that answers at {masked(address)}, received no answer"
            # A name that nobody knows is a wrong address, not a server that is away.
            kind = InputError if _UNKNOWN_NAME.search(str(error)) else ServerAwayError
            raise kind(f"tracking.uri: {reason}") from error
        served = address.startswith(SERVERS)
        reason = _of_server(address, str(error)) if served else _of_database(address, error)
        raise InputError(f"tracking.uri: {reason}") from error


def _of_server(address: str, message: str) -> str:
    address = masked(address)
    number = re.search(r"error code (\d+)", message)
    if number is None:
        # A page to log in at, or a web server of another kind: with status 200, but not in MLflow's words.
        what = (
            "a web page"
            if "<" in message.partition("Response body:")[2]
            else "an answer that is not MLflow's"
        )
        return f"expected an MLflow server at {address}, received {what}"
    if number[1] in _SAID:
        wanted, remedy = _SAID[number[1]]
        return f"expected the server at {address} {wanted}, received {number[1]}{remedy}"
    return f"expected an MLflow server at {address}, received {number[1]} for the list of its experiments"


def _of_database(address: str, error: Exception) -> str:
    shown = masked(address)
    message = masked(str(error))
    if "database schema" in message:
        found = re.search(r"found version (\w+), but expected (\w+)", message)
        versions = f" ({found[2]}), received {found[1]}" if found else ""
        return (
            f"expected the schema of the installed MLflow in {shown}{versions}; keep a copy of the database, then run: "
            f"mlflow db upgrade {shown} (or install the newer MLflow that wrote it)"
        )
    if isinstance(error, ImportError):
        return f"expected the driver of the database at {shown} to be installed, received: {message}"
    return (
        f"expected a database that can be opened and written at {shown}, received: {message.splitlines()[0]}"
    )
