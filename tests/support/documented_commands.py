"""The commands that a page shows: the lines of its shell blocks, joined, without comments, as words."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

SHELLS = ("sh", "bash", "shell")
# In a block without a language other text may stand, such as the tree of a folder.
PROGRAMS = ("ctus ", "make ", "python ")


def commands(page: Path) -> list[list[str]]:
    """Every command of a page that stands in a block of a shell, or begins a line of one without a language.

    Settings before a command (``NAME=value make``) are left out; what an ``&&`` leads to is a command of its own.
    """
    return [words for lines in _blocks(page.read_text(encoding="utf-8")) for words in _of_block(lines)]


def ctus_calls(page: Path) -> list[list[str]]:
    """Words of the calls of ``ctus``, without the name."""
    return [words[1:] for words in commands(page) if words[0] == "ctus"]


def _blocks(text: str) -> Iterator[str]:
    """The text of each block of a shell."""
    language: str | None = None
    lines: list[str] = []
    for line in text.splitlines():
        fence = re.match(r"\s*```(\S*)", line)
        if fence is None:
            if language in SHELLS or (language == "" and line.startswith(PROGRAMS)):
                lines.append(line.strip())
        elif language is None:
            language = fence[1]
        else:
            yield "\n".join(lines)
            language, lines = None, []


def _of_block(block: str) -> Iterator[list[str]]:
    for line in block.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|\|\|", line):
            words = shlex.split(part, comments=True)
            while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
                words = words[1:]
            if words:
                yield words
