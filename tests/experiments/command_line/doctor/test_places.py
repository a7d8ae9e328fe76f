"""Store and data sets: looked for where they are expected, opened without being changed."""

from __future__ import annotations

import http.server
import sqlite3
import threading
from pathlib import Path

import pytest

from experiments.command_line.doctor import places
from experiments.command_line.doctor.findings import State
from experiments.errors import InputError
from experiments.tracking.store import sqlite_address


def test_a_store_opens_and_its_runs_are_counted(home: Path) -> None:
    database = home / "mlruns" / "ctus.db"
    before = database.read_bytes()
    found = places.store(sqlite_address(database))
    assert found.state is State.OK
    assert found.text == f"{database} opens, 0 runs"
    assert database.read_bytes() == before


def test_a_store_that_is_not_there_yet_is_made_later_and_not_now(tmp_path: Path) -> None:
    database = tmp_path / "a 100% new? folder" / "ctus.db"
    found = places.store(sqlite_address(database))
    assert (found.state, found.text) == (State.OK, f"{database} is made at the first run")
    assert not database.parent.exists()


def test_a_file_that_is_no_store_is_missing(tmp_path: Path) -> None:
    (tmp_path / "ctus.db").write_text("no database" * 100)
    assert places.store(sqlite_address(tmp_path / "ctus.db")).state is State.MISSING
    sqlite3.connect(tmp_path / "other.db").close()
    found = places.store(sqlite_address(tmp_path / "other.db"))
    assert found.state is State.MISSING
    assert "no such table" in found.text


@pytest.mark.parametrize("address", ["localhost:5000", "ftp://somewhere", "http://localhost:1"])
def test_an_address_that_is_wrong_or_does_not_answer_is_missing(address: str) -> None:
    assert places.store(address).state is State.MISSING


def test_a_password_in_an_address_is_not_shown() -> None:
    found = places.store("postgresql://me:secret@db.example/runs")
    assert found.state is State.NOTE
    assert "secret" not in found.text


def test_a_server_that_answers_is_no_fault() -> None:
    class Healthy(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200 if self.path == "/health" else 404)
            self.end_headers()

        def log_message(self, *words: object) -> None:
            del words

    with http.server.HTTPServer(("127.0.0.1", 0), Healthy) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        found = places.store(f"http://127.0.0.1:{server.server_port}")
        server.shutdown()
    assert found.state is State.OK


def test_data_sets_are_found_by_the_folder_that_their_configuration_names(tmp_path: Path) -> None:
    (tmp_path / "usgra" / "images").mkdir(parents=True)
    (tmp_path / "usgra" / "images" / "1.png").write_bytes(b"")
    (tmp_path / "musv").mkdir()
    musv, usgra, rest = places.data_sets([tmp_path])
    assert (usgra.subject, usgra.state) == ("data usgra", State.OK)
    assert usgra.text.endswith("usgra, 1 file")
    assert usgra.remedy == f"ctus study=inspect_dataset dataset=usgra dataset.root={tmp_path / 'usgra'}"
    assert (musv.subject, musv.state) == ("data musv", State.NOTE)
    assert rest.text.startswith("carotid, san_raffaele: not in ")


def test_a_folder_of_data_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="data: expected a folder of data sets"):
        places.data_folders(str(tmp_path / "none"))
