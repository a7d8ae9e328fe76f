"""The picture of the house, held against the code: who may import whom, and what may be imported where."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SRC = Path(__file__).resolve().parents[1] / "src"
OWN = ("experiments", "models", "registration")
MODULES = {
    ".".join(path.relative_to(SRC).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(SRC.rglob("*.py"))
}
FORBIDDEN = {
    "models": {"registration", "experiments", "open3d", "mlflow", "hydra", "omegaconf", "pandas"},
    "registration": {
        "models",
        "experiments",
        "lightning",
        "monai",
        "mlflow",
        "hydra",
        "omegaconf",
        "torch",
        "pandas",
    },
    "experiments": set(),
}
# A heavy library and the only modules that may import it.
KEPT_IN = {
    "mlflow": {"experiments.tracking.store", "experiments.tracking.run_writer"},
    "hydra": {"experiments.cli"},
    "omegaconf": {"experiments.cli"},
}


def imports(path: Path, *, at_top: bool = False) -> Iterator[str]:
    """Every module that a file imports, dotted; only those executed at import when ``at_top``."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = _executed(tree) if at_top else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            for alias in node.names:
                dotted = f"{node.module}.{alias.name}"
                yield dotted if dotted in MODULES else node.module


def _executed(tree: ast.Module) -> Iterator[ast.AST]:
    """The statements that run when a module is imported, but for those under ``if TYPE_CHECKING``."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting.extend(node.orelse)
            continue
        waiting.extend(ast.iter_child_nodes(node))


@pytest.mark.parametrize("module", MODULES)
def test_no_forbidden_arrow(module: str) -> None:
    used = {name.split(".")[0] for name in imports(MODULES[module])}
    forbidden = FORBIDDEN[module.split(".")[0]]
    assert not used & forbidden
    for library, allowed in KEPT_IN.items():
        assert library not in used or module in allowed


def test_no_circle() -> None:
    arrows = {
        module: {name for name in imports(path, at_top=True) if name in MODULES and name != module}
        for module, path in MODULES.items()
    }
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join((*trail[trail.index(module) :], module))
        if module not in done:
            for other in arrows[module]:
                visit(other, (*trail, module))
            done.add(module)

    for module in MODULES:
        visit(module, ())


def test_every_test_file_stands_where_its_module_does() -> None:
    tests = Path(__file__).resolve().parent
    for path in tests.rglob("test_*.py"):
        if path.parent == tests:
            continue
        folder = path.relative_to(tests).parent
        assert (SRC / folder).is_dir(), path


def test_there_is_no_module_called_utils() -> None:
    assert not [name for name in MODULES if name.split(".")[-1] in ("utils", "helpers", "common", "misc")]


def test_the_packages_are_the_three() -> None:
    assert {name.split(".")[0] for name in MODULES} == set(OWN)
