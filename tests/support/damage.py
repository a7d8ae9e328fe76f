"""Files changed at random, reproducibly: bits, bytes, cuts, repeats, numbers in text; and what readers say of them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from models import errors as models_errors
from registration import errors as registration_errors

if TYPE_CHECKING:
    from reader_table import Reader

ACCEPTED, REFUSED = "accepted", "refused"
REFUSALS = (InputError, models_errors.InputError, registration_errors.InputError)
_NUMBER = re.compile(rb"-?\d+(\.\d+)?")
_ODD = (
    b"-1",
    b"0",
    b"2000000000",
    b"99999999999999999999",
    b"nan",
    b"inf",
    b"1e308",
    b"",
    b"../../etc/passwd",
    b"/dev/zero",
    b"\xff\xfe",
    b"{",
    b"*a",
)


def flipped(data: bytes, chance: random.Random, begin: int = 0, end: int = 0) -> bytes:
    """One bit changed between two places."""
    at = chance.randrange(begin, len(data) - end)
    return data[:at] + bytes([data[at] ^ (1 << chance.randrange(8))]) + data[at + 1 :]


def damaged(data: bytes, chance: random.Random) -> bytes:
    """One to three changes of any kind."""
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        data = chance.choice(_CHANGES)(data, chance) if data else b"\0"
    return data


def changes(reader: Reader, data: bytes, count: int, seed: int) -> list[bytes]:
    """So many damaged files; where a sum covers what is packed, a quarter of them with one bit of that changed."""
    chance = random.Random(f"{reader.name} {seed}")
    made = [damaged(data, chance) for _ in range(count)]
    if reader.begin is not None:
        begin, end = reader.begin(data), reader.end or 12 * (b"IEND" in data)
        made[: flips(reader, count)] = [
            flipped(data, chance, begin, end) for _ in range(flips(reader, count))
        ]
    return made


def flips(reader: Reader, count: int) -> int:
    """How many of so many files have one bit changed of what a sum covers: they come first."""
    return count // 4 if reader.begin is not None else 0


def alike(first: object, second: object) -> bool:
    """Whether two readings gave the same numbers."""
    if hasattr(first, "lines"):
        pairs = zip(first.lines, second.lines, strict=False)  # type: ignore[attr-defined]
        return all(
            np.array_equal(a.points_mm, b.points_mm) and np.array_equal(a.radius_mm, b.radius_mm)
            for a, b in pairs
        )
    return bool(np.array_equal(first, second))  # type: ignore[arg-type, call-overload]


def said(read: Callable[[Path], Any], path: Path) -> tuple[str, str]:
    """What a reader makes of a file: accepted, refused, or the name of a foreign exception; and its message."""
    try:
        read(path)
    except REFUSALS as refusal:
        named = path.name in str(refusal) or path.parent.name in str(refusal)
        return (REFUSED if named else "refusal without the file"), str(refusal)
    except Exception as failure:
        return type(failure).__name__, str(failure)
    return ACCEPTED, ""


def _noise(data: bytes, chance: random.Random) -> bytes:
    at, length = chance.randrange(len(data)), chance.choice((1, 2, 4, 8, 64))
    return data[:at] + chance.randbytes(length) + data[at + length :]


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))]


def _gap(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data))
    return data[:at] + data[at + chance.choice((1, 4, 100)) :]


def _repeat(data: bytes, chance: random.Random) -> bytes:
    at, length = chance.randrange(len(data)), chance.choice((1, 16, 256))
    return data[:at] + data[at : at + length] * chance.choice((2, 3, 50)) + data[at + length :]


def _number(data: bytes, chance: random.Random) -> bytes:
    found = list(_NUMBER.finditer(data[:20_000]))
    if not found:
        return _noise(data, chance)
    one = chance.choice(found)
    return data[: one.start()] + chance.choice(_ODD) + data[one.end() :]


def _word(data: bytes, chance: random.Random) -> bytes:
    found = list(re.finditer(rb"\w+", data[:20_000]))
    if not found:
        return _noise(data, chance)
    one, other = chance.choice(found), chance.choice(found)
    return data[: one.start()] + chance.choice((*_ODD, other.group())) + data[one.end() :]


_CHANGES = (flipped, flipped, _noise, _cut, _gap, _repeat, _number, _number, _word)
