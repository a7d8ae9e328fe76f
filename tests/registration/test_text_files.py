"""Text with and without byte-order marks; numbers that mean one thing."""

from __future__ import annotations

from pathlib import Path

import pytest

from registration.errors import InputError
from registration.text_files import parse_number, read_text


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_byte_order_marks_are_no_text(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("größe,1".encode(encoding))
    assert read_text(tmp_path / "a.csv") == "größe,1"


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xff\x00\x12")
    with pytest.raises(InputError, match=r"a\.csv: expected text in UTF-8"):
        read_text(tmp_path / "a.csv")
    with pytest.raises(InputError, match=r"b\.csv: expected a file, received nothing there"):
        read_text(tmp_path / "b.csv")


def test_numbers() -> None:
    assert [parse_number(text) for text in ("1", "-2.5e-1", " .5 ")] == [1, -0.25, 0.5]


@pytest.mark.parametrize("text", ["1_000", "1,5", "٣", "0x10", "", "1 2"])
def test_what_python_takes_or_refuses_as_a_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        parse_number(text)
