"""Structure of the source tree: files a folder, imports between packages, circles, line counts, longest functions.

``python scripts/structure.py [SRC ...]`` prints one column a source folder, so that two checkouts stand side by side:
``git worktree add ../before <commit>; python scripts/structure.py ../before/src src``. The same functions hold the
architecture test (``tests/test_architecture.py``).
"""

from __future__ import annotations

import ast
import functools
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("ctus", "experiments", "models", "registration")
# Lines of a function's body, without signature and docstring: one that is longer does more than one thing.
LONGEST_BODY = 40


@dataclass(frozen=True)
class Module:
    """One source file: its dotted name, its path, its syntax tree and its number of lines."""

    name: str
    path: Path
    tree: ast.Module
    lines: int

    @property
    def package(self) -> str:
        """The dotted name of the folder that holds it."""
        return self.name if self.path.stem == "__init__" else self.name.rpartition(".")[0]


@functools.cache
def read_modules(src: Path) -> dict[str, Module]:
    """Parse every module of the packages below ``src``, once in a process.

    Parameters
    ----------
    src : Path
        The folder that holds ``PACKAGES``.

    Returns
    -------
    dict of str to Module
        By dotted name; a package's ``__init__`` has the name of the package.
    """
    modules = {}
    for package in PACKAGES:
        for path in sorted((src / package).rglob("*.py")):
            name = ".".join(path.relative_to(src).with_suffix("").parts).removesuffix(".__init__")
            text = path.read_text(encoding="utf-8")
            modules[name] = Module(name, path, ast.parse(text), len(text.splitlines()))
    return modules


def imported_names(module: Module, known: Iterable[str]) -> Iterator[str]:
    """Yield every module that ``module`` imports: at top level, inside functions and under ``TYPE_CHECKING``.

    ``from package import name`` counts as an import of ``package.name`` where that is one of the ``known`` modules.
    """
    known = set(known)
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level or node.module is None:
                raise ValueError(f"{module.path}: expected absolute imports, found a relative one")
            for alias in node.names:
                dotted = f"{node.module}.{alias.name}"
                yield dotted if dotted in known else node.module


def import_graph(modules: Mapping[str, Module]) -> dict[str, set[str]]:
    """For every module, the modules of the tree that it imports."""
    return {
        name: {other for other in imported_names(module, modules) if other in modules and other != name}
        for name, module in modules.items()
    }


def room_of(module: Module) -> str:
    """The folder of a module; a file directly under a top package or ``experiments.studies`` stands for itself."""
    return module.name if module.package in (*PACKAGES, "experiments.studies") else module.package


def package_graph(modules: Mapping[str, Module], graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The imports between rooms (``room_of``)."""
    packages: dict[str, set[str]] = {room_of(module): set() for module in modules.values()}
    for name, others in graph.items():
        here = room_of(modules[name])
        packages[here] |= {room_of(modules[other]) for other in others} - {here}
    return packages


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """The strongly connected components of more than one node, largest first (Tarjan, SIAM J. Comput. 1, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            component = []
            while not component or component[-1] != node:
                component.append(stack.pop())
            if len(component) > 1:
                found.append(sorted(component))

    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, 10 * len(graph) + 1000))
    try:
        for node in graph:
            if node not in index:
                visit(node)
    finally:
        sys.setrecursionlimit(limit)
    return sorted(found, key=len, reverse=True)


def study_of(module: str) -> str | None:
    """The study that a module belongs to, None outside ``experiments.studies``."""
    parts = module.split(".")
    return parts[2] if parts[:2] == ["experiments", "studies"] and len(parts) > 2 else None


def study_imports(graph: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Every import of a study by another study."""
    return sorted(
        (name, other)
        for name, others in graph.items()
        for other in others
        if study_of(name) and study_of(other) and study_of(name) != study_of(other)
    )


def functions(modules: Mapping[str, Module]) -> list[tuple[int, str]]:
    """The length in lines and the dotted name of every function, longest first."""
    return sorted(
        (
            (node.end_lineno - node.lineno + 1, f"{name}.{node.name}")
            for name, module in modules.items()
            for node in ast.walk(module.tree)
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and node.end_lineno is not None
        ),
        reverse=True,
    )


def function_bodies(modules: Mapping[str, Module]) -> list[tuple[int, str]]:
    """The lines of every function from its first statement after the docstring on, and its name, longest first."""
    return sorted(
        (
            (_body_lines(node), f"{name}.{node.name}")
            for name, module in modules.items()
            for node in ast.walk(module.tree)
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        ),
        reverse=True,
    )


def _body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = function.body[1:] if ast.get_docstring(function, clean=False) is not None else function.body
    return (function.end_lineno or 0) - body[0].lineno + 1 if body else 0


def code_lines(module: Module) -> int:
    """Lines that hold code: without docstrings, comments and blank lines."""
    docstrings: set[int] = set()
    for node in ast.walk(module.tree):
        documented = isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        if documented and ast.get_docstring(node, clean=False) is not None:
            first = node.body[0]
            docstrings |= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return sum(
        bool(line.strip()) and not line.lstrip().startswith("#") and number not in docstrings
        for number, line in enumerate(module.path.read_text(encoding="utf-8").splitlines(), 1)
    )


def summary(src: Path) -> dict[str, str]:
    """The figures of one source tree, by what they are."""
    modules = read_modules(src)
    graph = import_graph(modules)
    packages = package_graph(modules, graph)
    files = Counter(module.package for module in modules.values() if module.path.stem != "__init__")
    fullest, full = files.most_common(1)[0]
    lengths, bodies = functions(modules), function_bodies(modules)
    tops = {
        top: sum(_between(modules, name, other, top) for name in graph for other in graph[name])
        for top in PACKAGES
    }
    return {
        "modules": str(sum(files.values())),
        "folders": str(len(files)),
        "modules a folder (mean)": f"{sum(files.values()) / len(files):.1f}",
        "fullest folder": f"{full} {fullest}",
        **{f"imports between folders of {top}": str(count) for top, count in tops.items()},
        "circles of modules": str(len(circles(graph))),
        "circles of folders": str(len(circles(packages))),
        "imports of a study by another": str(len(study_imports(graph))),
        "lines": str(sum(module.lines for module in modules.values())),
        "lines of code": str(sum(code_lines(module) for module in modules.values())),
        "longest function, with docstring": _longest(lengths),
        "longest function body": _longest(bodies),
        f"functions over {LONGEST_BODY} lines, with docstring": str(_over(lengths)),
        f"function bodies over {LONGEST_BODY} lines": str(_over(bodies)),
    }


def _longest(lengths: list[tuple[int, str]]) -> str:
    count, function = lengths[0]
    return f"{count} {'.'.join(function.split('.')[-2:])}"


def _over(lengths: list[tuple[int, str]]) -> int:
    return sum(count > LONGEST_BODY for count, _ in lengths)


def _between(modules: Mapping[str, Module], name: str, other: str, top: str) -> bool:
    ours = name.startswith(f"{top}.") and other.startswith(f"{top}.")
    return ours and modules[name].package != modules[other].package


def main(folders: list[str]) -> int:
    """Print the table; 2 where a folder holds none of the packages."""
    trees = [Path(folder) for folder in folders] or [Path(__file__).resolve().parents[1] / "src"]
    for tree in trees:
        if not any((tree / package).is_dir() for package in PACKAGES):
            print(
                f"{tree}: expected a folder with {', '.join(PACKAGES)}, found none of them", file=sys.stderr
            )
            return 2
    columns = [summary(tree) for tree in trees]
    width = max(map(len, columns[0]))
    print(" " * width, *(f"{tree!s:>40}" for tree in trees))
    for row in columns[0]:
        print(f"{row:{width}}", *(f"{column[row]:>40}" for column in columns))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
