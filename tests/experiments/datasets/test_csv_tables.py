import pytest

from experiments.datasets.csv_tables import read_table
from experiments.errors import InputError


def test_rows_by_column_with_blanks_cut_and_missing_cells_empty(tmp_path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes("\ufeffname , value,more\n a,1 ,x\nb,2\n".encode())
    assert read_table(path, ("name", "value")) == [
        {"name": "a", "value": "1", "more": "x"},
        {"name": "b", "value": "2", "more": ""},
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "expected a table with columns name, value, found no file"),
        (b"", "expected columns name, value, received none"),
        (b"name,other\n1,2\n", "expected columns name, value, received name, other"),
        (b"name,value,value\n1,2,3\n", "expected each column once, received value twice"),
        (b"name,value\na,1,5\n", "expected 2 cells a row, received 3 in the row of 'a'"),
        (
            b"\x89PNG\r\n\x1a\n\xff\xfe",
            "expected text in UTF-8, found bytes that are none",
        ),
    ],
)
def test_refuses_what_is_no_such_table(tmp_path, content: bytes | None, message: str) -> None:
    path = tmp_path / "t.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=rf"t\.csv: {message}"):
        read_table(path, ("name", "value"))
