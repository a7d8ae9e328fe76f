"""Public docstrings in numpydoc form: every parameter and every returned value is described, and no other."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import structure

SRC = Path(__file__).resolve().parents[1] / "src"
MODULES = structure.read_modules(SRC)
SECTION = re.compile(r"^(?P<title>[A-Z][A-Za-z ]+)\n-{3,}$", re.MULTILINE)
# A run of names before " : type" or at the end of a line that is not indented.
ENTRY = re.compile(r"^(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :.*)?$", re.MULTILINE)


def sections(docstring: str) -> dict[str, str]:
    """The text under every underlined heading of a docstring."""
    heads = list(SECTION.finditer(docstring))
    ends = [*(head.start() for head in heads[1:]), len(docstring)][: len(heads)]
    return {head["title"]: docstring[head.end() : end] for head, end in zip(heads, ends, strict=True)}


def described(docstring: str) -> set[str]:
    """The names that the section Parameters describes."""
    text = sections(docstring).get("Parameters", "") + sections(docstring).get("Other Parameters", "")
    return {name.lstrip("*") for entry in ENTRY.finditer(text) for name in entry["names"].split(", ")}


def parameters(function: ast.FunctionDef) -> set[str]:
    """The parameters of a function but ``self`` and ``cls``, and those whose name begins with an underscore."""
    given = function.args
    names = [arg.arg for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    names += [arg.arg for arg in (given.vararg, given.kwarg) if arg is not None]
    return {name for name in names if name not in ("self", "cls") and not name.startswith("_")}


def decorators(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """The last names of a definition's decorators."""
    return {ast.unparse(one).split("(")[0].rpartition(".")[2] for one in node.decorator_list}


def fields(cls: ast.ClassDef) -> set[str]:
    """The fields of a dataclass that its constructor takes."""
    return {
        item.target.id
        for item in cls.body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and not item.target.id.startswith("_")
        and "ClassVar" not in ast.unparse(item.annotation)
        and not (item.value is not None and "init=False" in ast.unparse(item.value))
    }


def public(module: structure.Module) -> Iterator[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    """The public functions and classes at the top of a module, and the public methods of these classes."""
    for node in module.tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            yield node.name, node
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for item in node.body:
                if isinstance(item, ast.FunctionDef) and (
                    not item.name.startswith("_") or item.name == "__call__"
                ):
                    yield f"{node.name}.{item.name}", item


def faults(node: ast.FunctionDef | ast.ClassDef) -> Iterator[str]:
    """What is missing from or wrong in one docstring."""
    docstring = ast.get_docstring(node)
    if not docstring:
        yield "has no docstring"
        return
    if isinstance(node, ast.ClassDef):
        if "dataclass" in decorators(node):
            yield from _differences(fields(node), described(docstring))
        return
    if decorators(node) & {"property", "cached_property", "setter", "overload"}:
        return
    yield from _differences(parameters(node), described(docstring))
    titles = sections(docstring).keys()
    returns = ast.unparse(node.returns) if node.returns else "None"
    if "contextmanager" in decorators(node):
        returns = "None" if returns in ("Iterator[None]", "Generator[None]") else returns
    if returns not in ("None", "NoReturn") and not titles & {"Returns", "Yields"}:
        yield f"describes no returned value ({returns})"


def _differences(expected: set[str], found: set[str]) -> Iterator[str]:
    if expected - found:
        yield f"describes no parameter {', '.join(sorted(expected - found))}"
    if found - expected:
        yield f"describes {', '.join(sorted(found - expected))}, which it does not have"


@pytest.mark.parametrize("module", MODULES)
def test_public_docstrings_describe_what_goes_in_and_out(module: str) -> None:
    wrong = [f"{module}.{name} {fault}" for name, node in public(MODULES[module]) for fault in faults(node)]
    assert wrong == []


def test_a_docstring_that_misses_a_parameter_is_found() -> None:
    text = '''
def crop(image, *, margin_px: int) -> int:
    """Crop.

    Parameters
    ----------
    image : ndarray, shape (h, w)
        Grey values.
    border : int
        No such parameter.

    Returns
    -------
    int
        Pixels.
    """
'''
    (function,) = ast.parse(text).body
    assert isinstance(function, ast.FunctionDef)
    assert list(faults(function)) == [
        "describes no parameter margin_px",
        "describes border, which it does not have",
    ]
