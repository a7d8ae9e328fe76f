"""What is said of a tracking address that can't be used."""

from __future__ import annotations

import shutil
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.tracking import Store
from experiments.tracking.addresses import require_address


@contextmanager
def server(status: int, body: bytes) -> Iterator[str]:
    """A web server that answers everything with the same status and body."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST

        def log_message(self, format: str, *args: object) -> None:
            pass

    running = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=running.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{running.server_port}"
    finally:
        running.shutdown()
        running.server_close()


@pytest.mark.parametrize(
    ("address", "hint"),
    [
        ("localhost:5000", "did you mean http://localhost:5000?"),
        ("tracker.example/mlflow", "did you mean http://tracker.example/mlflow?"),
        ("htp://localhost:5000", "received 'htp://localhost:5000'"),
        ("http://", "received 'http://'"),
        ("http://localhost:abc", "received 'http://localhost:abc'"),
        ("http://a b", "received 'http://a b'"),
        ("./mlruns", "received './mlruns'"),
        ("file:///tmp/mlruns", "received 'file:///tmp/mlruns'"),
        ("sqlite://", "sqlite:////runs.db"),
        ("databricks", "received 'databricks'"),
    ],
)
def test_an_address_without_a_scheme_that_is_known_is_refused(address: str, hint: str) -> None:
    with pytest.raises(
        InputError, match=r"tracking\.uri: expected the address of an MLflow server"
    ) as refusal:
        Store(uri=address).client()
    assert hint in str(refusal.value)


@pytest.mark.parametrize(
    "address",
    [
        "http://localhost:5000",
        "https://tracker.example/mlflow",
        "sqlite:////tmp/x.db",
        "sqlite:///x.db",
        "postgresql+psycopg2://u:p@db/mlflow",
    ],
)
def test_an_address_of_a_server_or_a_database_is_taken(address: str) -> None:
    require_address(address)


@pytest.mark.parametrize(
    ("status", "body", "sentence"),
    [
        (401, b"", r"to know this user, received 401 \(MLFLOW_TRACKING_USERNAME"),
        (403, b"", r"to let this machine in, received 403 \(mlflow server --allowed-hosts"),
        (404, b"<html>", "expected an MLflow server at .*, received 404"),
        (200, b"<html>Log in</html>", "expected an MLflow server at .*, received a web page"),
        (200, b"[1]", "received an answer that is not MLflow's"),
    ],
)
def test_what_a_server_says_instead_of_an_answer(
    status: int, body: bytes, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with server(status, body) as address, pytest.raises(InputError, match=sentence):
        Store(uri=address).client()


def test_an_older_schema_names_the_command_that_mends_it(tmp_path: Path, store_template: Path) -> None:
    database = tmp_path / "old.db"
    shutil.copy(store_template / "ctus.db", database)
    with sqlite3.connect(database) as connection:
        connection.execute("UPDATE alembic_version SET version_num = 'bd07f7e963c5'")
    connection.close()
    with pytest.raises(InputError, match=f"received bd07f7e963c5; .* mlflow db upgrade sqlite:///{database}"):
        Store(uri=f"sqlite:///{database}").client()


def test_a_file_that_is_no_database_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.db").write_text("no database\n" * 100)
    with pytest.raises(InputError, match=r"expected a database .*text\.db, received: .*not a database"):
        Store(uri=f"sqlite:///{tmp_path / 'text.db'}").client()


def test_a_missing_driver_is_named_and_the_password_is_not() -> None:
    with pytest.raises(InputError, match="expected the driver of the database") as refusal:
        Store(uri="postgresql+pg8000://user:secret@host/db").client()
    assert "secret" not in str(refusal.value)
