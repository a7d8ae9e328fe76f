"""Which small changes of the code no test notices: mutation checks of metrics, transforms and statistics.

    python scripts/mutation.py [--only transforms] [--out results]

mutmut (https://mutmut.readthedocs.io) changes one operator, number, text or argument at a time in a copy of the code
and runs the tests of that module, without the checks of shapes, so that only what the tests themselves say counts. A
changed text of a message or a ``>`` for a ``>=`` between real numbers is a mutant as well: the page lists all that
nobody noticed. ``make mutation`` installs mutmut and writes results/mutation.md.
"""

from __future__ import annotations

import argparse
import collections
import datetime
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from quick_budget import REPOSITORY

from experiments import files
from experiments.provenance import running_commit
from experiments.running.terminal import markdown

WORK = REPOSITORY / "outputs" / "mutation"
NOTICED, SURVIVED = ("killed", "timeout", "segfault", "suspicious", "caught by type check"), "survived"
SETTINGS = """[tool.pytest.ini_options]
pythonpath = ["tests/support", "src"]
addopts = "--import-mode=importlib -q -p no:cacheprovider"
filterwarnings = ["ignore"]
[tool.mutmut]
source_paths = ["src"]
only_mutate = {sources}
pytest_add_cli_args_test_selection = {tests}
track_dependencies = false
use_git_change_detection = false
"""
# Prints the status of every mutant, and what was changed in those that survived.
LIST = """
import json
from mutmut.mutation.diff_apply import get_diff_for_mutant
from mutmut.mutation.data import SourceFileMutationData
from mutmut.stats import status_by_exit_code
found = []
for path in {sources}:
    data = SourceFileMutationData(path=__import__("pathlib").Path(path))
    data.load()
    for name, code in data.exit_code_by_key.items():
        status = status_by_exit_code[code]
        change = get_diff_for_mutant(name, path=path) if status == "survived" else ""
        found.append([path, name, status, change])
print(json.dumps(found))
"""


HEAD = """# Mutation checks

{date}, commit {commit}. One small change of the code at a time, and the tests of that module: *noticed* is a change
with which a test fails or does not end, *survived* one with which all pass, *not run* one that no test reaches. Some
that survive change nothing that can be seen. `make mutation` writes this page.
"""


@dataclass(frozen=True)
class Group:
    """What is changed and which tests have to notice it.

    Parameters
    ----------
    sources, tests : tuple of str
        Files under ``src``, and files or folders under ``tests``.
    """

    sources: tuple[str, ...]
    tests: tuple[str, ...]


GROUPS = {
    "transforms": Group(("registration/transforms.py",), ("registration/test_transforms.py",)),
    "mask_metrics": Group(("models/metrics/*.py",), ("models/metrics",)),
    "surface_metrics": Group(("registration/metrics/*.py",), ("registration/metrics",)),
    "statistics": Group(("experiments/statistics/*.py",), ("experiments/statistics",)),
}


@dataclass(frozen=True)
class Mutant:
    """One change of one line.

    Parameters
    ----------
    path : str
        File under ``src``.
    function : str
        Its function.
    status : str
        mutmut's word for what the tests did.
    change : str
        Lines before and after, of one that survived.
    """

    path: str
    function: str
    status: str
    change: str


def main(arguments: list[str] | None = None) -> int:
    """Change, test, count, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=[*GROUPS], default=[*GROUPS], metavar="GROUP")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, help="folder that gets mutation.md")
    given = parser.parse_args(arguments)
    if importlib.util.find_spec("mutmut") is None:
        print("mutation.py: expected mutmut, found none: pip install -e '.[quality]'", file=sys.stderr)
        return 2
    if given.out is not None and set(given.only) != set(GROUPS):
        parser.error("--out: expected all groups for a page, received some")
    mutants = [mutant for name in dict.fromkeys(given.only) for mutant in checked(name, given.processes)]
    text = page(mutants)
    print(text.split("## Survived")[0])
    if given.out is not None:
        files.write_text(given.out / "mutation.md", text)
        print(f"Written: {given.out / 'mutation.md'}")
    return 0


def checked(name: str, processes: int) -> list[Mutant]:
    """The mutants of a group, tested."""
    group, folder = GROUPS[name], WORK / name
    copy(folder, group)
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE"}
    # The copies lie elsewhere than the checkout, from which the tests would look for the public data.
    environment.setdefault("CTUS_TEST_DATA", str(REPOSITORY.parent / "shared" / "data"))
    with (folder / "log.txt").open("w") as log:
        done = subprocess.run(
            [sys.executable, "-m", "mutmut", "run", "--max-children", str(processes)],
            cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT, check=False,
        )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"mutation.py: mutmut failed; the end of {folder / 'log.txt'} says why")
    listed = subprocess.run(
        [sys.executable, "-c", LIST.format(sources=sources(folder, group))],
        cwd=folder, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [
        Mutant(path.removeprefix("src/"), function(key), status, shortened(change))
        for path, key, status, change in json.loads(listed.stdout)
    ]


def copy(folder: Path, group: Group) -> None:
    """A project of the code and the group's tests alone; earlier results of it are removed."""
    shutil.rmtree(folder, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(REPOSITORY / "src", folder / "src", ignore=ignored)
    shutil.copytree(REPOSITORY / "tests" / "support", folder / "tests" / "support", ignore=ignored)
    for test in group.tests:
        source, target = REPOSITORY / "tests" / test, folder / "tests" / test
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=ignored)
        else:
            shutil.copy(source, target)
    conftest = (REPOSITORY / "tests" / "conftest.py").read_text(encoding="utf-8")
    files.write_text(folder / "tests" / "conftest.py", conftest.replace("\ninstall([", "\n_ = ([", 1))
    tests = [f"tests/{test}" for test in group.tests]
    settings = SETTINGS.format(sources=[f"src/{source}" for source in group.sources], tests=tests)
    files.write_text(folder / "pyproject.toml", settings)


def sources(folder: Path, group: Group) -> list[str]:
    """The files that are changed, as mutmut names them."""
    found = [path for source in group.sources for path in sorted((folder / "src").glob(source))]
    return [
        str(path.relative_to(folder))
        for path in found
        if (folder / "mutants" / f"{path.relative_to(folder)}.meta").is_file()
    ]


def function(key: str) -> str:
    """A mutant's function: mutmut writes ``module.x_function__mutmut_3`` and ``module.xǁClassǁmethod__mutmut_3``."""
    name = key.rsplit(".", 1)[-1].rsplit("__mutmut_", 1)[0]
    return name.removeprefix("xǁ").replace("ǁ", ".") if name.startswith("xǁ") else name.removeprefix("x_")


def shortened(change: str) -> str:
    """The lines before and after of a difference."""
    lines = change.splitlines()
    return "\n".join(f"{line[0]} {line[1:].strip()}" for line in lines[2:] if line[:1] in ("-", "+"))


def page(mutants: list[Mutant]) -> str:
    """Counts by file, and every change that nobody noticed."""
    import pandas as pd

    by_file: dict[str, collections.Counter[str]] = {}
    for mutant in mutants:
        by_file.setdefault(mutant.path, collections.Counter())[mutant.status] += 1
    rows = [row(path, counts) for path, counts in by_file.items()]
    rows.append(row("all", sum(by_file.values(), collections.Counter())))
    head = HEAD.format(date=datetime.date.today(), commit=running_commit())
    parts = [head, markdown({"By file": pd.DataFrame(rows)}), "## Survived\n"]
    for path in by_file:
        survived = [each for each in mutants if each.path == path and each.status == SURVIVED]
        if survived:
            changes = "\n\n".join(f"# {each.function}\n{each.change}" for each in survived)
            parts.append(f"### {path}\n\n```diff\n{changes}\n```\n")
    return "\n".join(parts)


def row(path: str, counts: collections.Counter[str]) -> dict[str, object]:
    """Counts of one file."""
    noticed, survived = sum(counts[status] for status in NOTICED), counts[SURVIVED]
    share = f"{100 * noticed / (noticed + survived):.0f} %" if noticed + survived else ""
    rest = counts.total() - noticed - survived
    return {
        "file": path,
        "changes": counts.total(),
        "noticed": noticed,
        "survived": survived,
        "not run": rest,
        "share noticed": share,
    }


if __name__ == "__main__":
    sys.exit(main())
