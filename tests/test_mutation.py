"""The page of mutation checks: names, counts, and what nobody noticed."""

from __future__ import annotations

from pathlib import Path

import mutation
import pytest
from mutation import GROUPS, Mutant, copy, function, main, page, shortened

MUTANTS = [
    Mutant("a/b.py", "f", "killed", ""),
    Mutant("a/b.py", "f", "timeout", ""),
    Mutant("a/b.py", "C.g", "survived", "- return 1\n+ return 2"),
    Mutant("a/c.py", "h", "no tests", ""),
]


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("registration.transforms.x_compose__mutmut_3", "compose"),
        ("registration.transforms.x__where__mutmut_12", "_where"),
        ("models.metrics.xǁBoundaryǁ__init____mutmut_1", "Boundary.__init__"),
    ],
)
def test_a_mutant_is_named_by_its_function(key: str, name: str) -> None:
    assert function(key) == name


def test_of_a_difference_the_lines_before_and_after_are_shown() -> None:
    change = "--- a.py\n+++ a.py\n@@ -1,3 +1,3 @@\n def f():\n-    return 1\n+    return 2\n "
    assert shortened(change) == "- return 1\n+ return 2"


def test_the_page_counts_by_file_and_lists_what_survived() -> None:
    text = page(MUTANTS)
    assert "| a/b.py | 3 | 2 | 1 | 0 | 67 % |" in text
    assert "| a/c.py | 1 | 0 | 0 | 1 |  |" in text
    assert "| all | 4 | 2 | 1 | 1 | 67 % |" in text
    assert "# C.g\n- return 1\n+ return 2" in text and "### a/c.py" not in text


def test_the_code_and_the_groups_tests_alone_are_copied(tmp_path: Path) -> None:
    for name, group in GROUPS.items():
        copy(tmp_path / name, group)
        tests = tmp_path / name / "tests"
        assert all((tests / test).exists() for test in group.tests)
        assert list((tmp_path / name / "src").glob(group.sources[0]))
        assert not (tests / "test_mutation.py").exists()
        # Without the checks of shapes only what the tests themselves say counts.
        assert "\ninstall([" not in (tests / "conftest.py").read_text()
        break


def test_without_mutmut_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(mutation.importlib.util, "find_spec", lambda name: None)
    assert main([]) == 2
    assert "pip install -e '.[quality]'" in capsys.readouterr().err
