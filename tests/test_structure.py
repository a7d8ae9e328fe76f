"""The figures of a source tree, on a tree of three modules whose figures are known."""

from __future__ import annotations

from pathlib import Path

import pytest
import structure

BODY = "\n".join(f"    x = {number}" for number in range(41))
DOCUMENTED = '''"""A module."""

from models import ground


def documented(
    first: int,
    second: int,
) -> int:
    """One sentence.

    And a second one.
    """
    total = first + second
    # A comment counts, as it has to be read; so does the blank line that follows.

    return total


def only_a_sentence() -> None:
    """Nothing but this."""
'''


@pytest.fixture
def src(tmp_path: Path) -> Path:
    for package in structure.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / "models" / "ground.py").write_text(f"def long():\n{BODY}\n")
    (tmp_path / "models" / "documented.py").write_text(DOCUMENTED)
    return tmp_path


def test_a_body_is_counted_without_signature_and_docstring(src: Path) -> None:
    modules = structure.read_modules(src)
    assert structure.function_bodies(modules) == [
        (41, "models.ground.long"),
        (4, "models.documented.documented"),
        (0, "models.documented.only_a_sentence"),
    ]
    assert structure.functions(modules) == [
        (42, "models.ground.long"),
        (12, "models.documented.documented"),
        (2, "models.documented.only_a_sentence"),
    ]


def test_the_table_holds_both_counts(src: Path) -> None:
    figures = structure.summary(src)
    assert figures["longest function, with docstring"] == "42 ground.long"
    assert figures["longest function body"] == "41 ground.long"
    assert figures["functions over 40 lines, with docstring"] == "1"
    assert figures["function bodies over 40 lines"] == "1"
    assert (figures["modules"], figures["imports between folders of models"]) == ("2", "0")


def test_two_trees_stand_next_to_each_other(src: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert structure.main([str(src), str(src)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert next(row for row in rows if row.startswith("longest function body")).count("41 ground.long") == 2
    assert structure.main([str(src / "models")]) == 2
