"""Files of anyone's: what may be opened, how large they may be, where names in them may lead, and how failures read."""

from __future__ import annotations

import errno
import os
import socket
from pathlib import Path

import pytest

from registration.errors import InputError
from registration.input_files import (
    FREE_UNPACKED_BYTES,
    LARGEST_FACTOR,
    beside,
    guarded,
    read_regular,
    refusing,
    require_regular,
    require_unpacked_size,
)


def test_regular_files_and_links_to_them_are_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "b").symlink_to("a")
    assert read_regular(tmp_path / "b") == b"abc"
    with pytest.raises(InputError, match="a: expected a file of at most 2 bytes, received 3 bytes"):
        read_regular(tmp_path / "a", largest=2)


def test_everything_else_is_named_and_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "s"))
        for path, found in (
            (tmp_path / "pipe", "a pipe"),
            (tmp_path / "s", "a socket"),
            (Path("/dev/zero"), "a device"),
            (tmp_path, "a folder"),
            (tmp_path / "none", "nothing there"),
            (tmp_path / "pipe" / "below", "nothing there"),
            (tmp_path / ("n" * 300), "File name too long"),
        ):
            with pytest.raises(InputError, match=f"expected a file, received {found}"):
                require_regular(path)


@pytest.mark.parametrize("name", ["/a", "../a", "b/../../a", "..\\a", "C:\\a", "c:a", "", " ", "a\0b"])
def test_names_in_a_file_may_not_lead_away(name: str) -> None:
    with pytest.raises(InputError, match=r"h\.mhd: expected the name of a file in its own folder"):
        beside(Path("scan/h.mhd"), name)


def test_names_in_a_file_may_lead_below() -> None:
    assert beside(Path("scan/h.mhd"), "raw/a..b.raw") == Path("scan/raw/a..b.raw")


def test_what_is_packed_may_be_large_or_much_smaller_than_it_was_but_not_both() -> None:
    require_unpacked_size(FREE_UNPACKED_BYTES, 1, "a")
    require_unpacked_size(LARGEST_FACTOR * (1 << 30), 1 << 30, "a")
    with pytest.raises(InputError, match="a: expected at most 100 times its 1000 packed bytes"):
        require_unpacked_size(FREE_UNPACKED_BYTES + 1, 1000, "a")


@pytest.mark.parametrize(
    "failure", [KeyError("x"), MemoryError(), RecursionError("deep"), TypeError("no\nmore")]
)
def test_whatever_a_library_raises_becomes_one_sentence(failure: Exception) -> None:
    with (
        pytest.raises(
            InputError, match=r"^a\.x: expected an X, received a file that can't be read as one"
        ) as found,
        refusing("a.x", "an X"),
    ):
        raise failure
    assert "\n" not in str(found.value)
    assert found.value.__cause__ is failure


def test_refusals_stops_and_faults_of_the_machine_pass() -> None:
    for failure in (InputError("a.x: said"), KeyboardInterrupt(), OSError(errno.ENOSPC, "full")):
        with pytest.raises(type(failure)) as found, refusing("a.x", "an X"):
            raise failure
        assert found.value is failure


def test_a_refusal_that_does_not_name_the_file_gets_its_name() -> None:
    class SpecialError(InputError): ...

    with pytest.raises(SpecialError, match=r"^a\.x: fold: expected 0"), refusing("a.x", "an X"):
        raise SpecialError("fold: expected 0")


def test_a_guarded_reader_sees_regular_files_alone(tmp_path: Path) -> None:
    @guarded("a number", largest=3)
    def number(path: Path, base: int = 10) -> int:
        return int(path.read_text(), base)

    (tmp_path / "a").write_text("ff")
    assert number(tmp_path / "a", base=16) == 255
    with pytest.raises(InputError, match=r"a: expected a number, received .*ValueError: invalid literal"):
        number(tmp_path / "a")
    (tmp_path / "a").write_text("1234")
    with pytest.raises(InputError, match="at most 3 bytes"):
        number(tmp_path / "a")
