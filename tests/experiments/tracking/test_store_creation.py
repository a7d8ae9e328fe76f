"""A new store is there when it is complete: what stops its making leaves nothing that a later call trips over."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from mlflow.store.tracking import sqlalchemy_store

from experiments.tracking import Store
from experiments.tracking.store import sqlite_file


class _Engine:
    def dispose(self) -> None: ...


def test_a_store_whose_making_was_stopped_is_made_afresh(
    tmp_path: Path, store_template: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = tmp_path / "store" / "ctus.db"
    address = f"sqlite:///{database}"

    class Stopped:
        def __init__(self, uri: str, root: str) -> None:
            sqlite_file(uri).write_bytes((store_template / "ctus.db").read_bytes()[:5000])
            raise SystemExit(143)

    class Made:
        engine = _Engine()

        def __init__(self, uri: str, root: str) -> None:
            if sqlite_file(uri) != database:  # the client opens the one that has its name
                assert not database.exists()
                shutil.copy(store_template / "ctus.db", sqlite_file(uri))

    monkeypatch.setattr(sqlalchemy_store, "SqlAlchemyStore", Stopped)
    with pytest.raises(SystemExit):
        Store(address).client()
    assert not database.exists()
    (left,) = database.parent.glob(".ctus.db.making-*")
    # Of another process, which was killed.
    left.rename(database.parent / ".ctus.db.making-1")
    monkeypatch.setattr(sqlalchemy_store, "SqlAlchemyStore", Made)
    with monkeypatch.context() as patch:
        patch.setattr("mlflow.tracking.MlflowClient.search_experiments", lambda self, max_results: [])
        Store(address).client()
    assert database.is_file()
    assert not list(database.parent.glob(".ctus.db.making-*"))


def test_an_empty_file_is_no_store_and_becomes_one(
    tmp_path: Path, store_template: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Path] = []

    class Made:
        engine = _Engine()

        def __init__(self, uri: str, root: str) -> None:
            made.append(sqlite_file(uri))
            if "making" in made[-1].name:
                shutil.copy(store_template / "ctus.db", made[-1])

    monkeypatch.setattr(sqlalchemy_store, "SqlAlchemyStore", Made)
    monkeypatch.setattr("mlflow.tracking.MlflowClient.search_experiments", lambda self, max_results: [])
    (tmp_path / "a b%c.db").touch()
    Store(f"sqlite:///{tmp_path / 'a b%c.db'}").client()
    assert (tmp_path / "a b%c.db").stat().st_size
    assert [path.name.partition(".making")[0] for path in made] == [".a b%c.db", "a b%c.db"]
