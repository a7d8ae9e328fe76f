"""Writing beside and renaming."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.files import atomic_write, digest, read_table, staged, write_text


def test_a_failed_write_leaves_the_old_file_and_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as beside:
        beside.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_name_beside_keeps_the_suffix(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "cloud.ply") as beside:
        assert beside.suffix == ".ply"
        beside.write_text("x")
    assert (tmp_path / "cloud.ply").read_text() == "x"


def test_a_staged_folder_appears_whole_and_keeps_other_files(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "mine.txt").write_text("mine")
    (folder / "result.txt").write_text("old")
    with staged(folder) as stage:
        (stage / "deep").mkdir()
        (stage / "deep" / "new.txt").write_text("new")
        (stage / "result.txt").write_text("new")
        assert (folder / "result.txt").read_text() == "old"
    assert (folder / "deep" / "mine.txt").read_text() == "mine"
    assert (folder / "deep" / "new.txt").read_text() == "new"
    assert (folder / "result.txt").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def test_a_failed_stage_changes_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), staged(tmp_path / "out") as stage:
        (stage / "half.txt").write_text("half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_digest_is_sha256(tmp_path: Path) -> None:
    (tmp_path / "abc").write_text("abc")
    # The test vector of FIPS 180-2, appendix B.1.
    assert digest(tmp_path / "abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


@pytest.mark.parametrize("name", [b"pandas_type", b"numpy_type", b"index_columns", b"column_indexes"])
def test_a_table_whose_description_is_damaged_is_refused_by_name(tmp_path: Path, name: bytes) -> None:
    path = tmp_path / "cases.parquet"
    pd.DataFrame({"case_id": ["a", "b"], "dsc": [0.5, 0.75]}).to_parquet(path)
    whole = path.read_bytes()
    assert read_table(path, columns=["dsc"])["dsc"].tolist() == [0.5, 0.75]
    assert name in whole
    path.write_bytes(whole.replace(name, name[:-1] + b"_"))
    try:
        read = read_table(path)
    except InputError as refusal:
        assert str(refusal).startswith(f"{path}: expected a table of cases, received")
    else:
        assert read["dsc"].tolist() == [0.5, 0.75]
    path.write_bytes(whole[:-20])
    with pytest.raises(InputError, match=r"cases\.parquet: expected a table of cases"):
        read_table(path)


def test_a_table_without_a_column_is_refused(tmp_path: Path) -> None:
    pd.DataFrame({"dsc": [0.5]}).to_parquet(tmp_path / "cases.parquet")
    with pytest.raises(
        InputError, match=r"cases\.parquet: expected the columns run_id, dsc, found no run_id"
    ):
        read_table(tmp_path / "cases.parquet", columns=["run_id", "dsc"])


def test_a_text_that_is_none_is_refused_by_the_files_name(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    bytes_ = pa.array([b"\xa8bc", b"right"], pa.binary())
    parquet.write_table(pa.table({"name": bytes_.view(pa.string())}), tmp_path / "cases.parquet")
    with pytest.raises(InputError, match=r"cases\.parquet: expected a table of cases"):
        read_table(tmp_path / "cases.parquet")
