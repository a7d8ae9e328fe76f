"""What messages advise: a setting that a user is told to pass is one that there is."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from configurations import OPTIONS, STUDIES, composed, mandatory, taker

from experiments.command_line.words import group_names, setting_names

# "pass units=m", "(pass acquisition=plus ...", "ctus study=import_runs archive=...": a name and a sign of equality.
ADVICE = re.compile(r"\b(?:pass|passing|needs)\s+(?:another\s+)?\'?\+?([a-z_][\w.@]*)=")


def texts(path: Path) -> Iterator[str]:
    """Every text of a module that is no documentation, with {} for what is filled in."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside | alone
        ):
            yield node.value


def known_settings() -> set[str]:
    """The dotted names of the settings of every study, with every option."""
    names = {"study", *group_names()}
    words = [[f"study={study}", *mandatory(study)] for study in STUDIES]
    words += [
        [f"study={taker(group)}", f"{group}={option}", *mandatory(taker(group))] for group, option in OPTIONS
    ]
    for each in words:
        names |= set(setting_names(composed(*each)))
    return names


def test_every_setting_that_a_message_advises_exists(repository: Path) -> None:
    known, advised = known_settings(), {}
    for path in sorted((repository / "src").rglob("*.py")):
        for text in texts(path):
            for name in ADVICE.findall(text):
                advised[name] = path.name
    assert {"units", "spacing_mm", "dataset.root"} <= set(advised)
    assert {name: place for name, place in advised.items() if name not in known} == {}
