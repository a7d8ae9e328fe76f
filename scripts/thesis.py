"""Run every step of conf/thesis.yaml that has no run yet, export the runs, and write the report.

trainer=smoke shows that all works: it has a store of its own and writes to results/smoke alone.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from experiments.paths import project_root
from experiments.plugins import options_of
from experiments.reporting.thesis_steps import SMOKE, Step, thesis_steps

ROOT = project_root()


def main() -> int:
    """Run the steps and return the exit code.

    Returns
    -------
    int
        0: every step that could be run was; 1: a step failed.
    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    budgets = options_of("trainer")
    parser.add_argument(
        "--trainer", default="cpu", choices=budgets, help="budget of the trainings (default: cpu)"
    )
    parser.add_argument(
        "--data", default="", help="folder of data sets (carotid, usgra); empty: simulated ones alone"
    )
    parser.add_argument("--only", nargs="*", help="names of steps; all if none is given")
    asked = parser.parse_args()
    known = [step.name for step in thesis_steps()]
    if unknown := sorted(set(asked.only or ()) - set(known)):
        parser.error(f"--only: expected steps of {', '.join(known)}, received {', '.join(unknown)}")
    data = Path(asked.data).expanduser().absolute() if asked.data else None
    if data is not None and not data.is_dir():
        parser.error(f"--data: expected a folder, found none at {data}")
    small = asked.trainer == SMOKE
    home = ROOT / "outputs" / "thesis" / SMOKE if small else ROOT
    results = ROOT / "results" / SMOKE if small else ROOT / "results"
    out = ROOT / "outputs" / "thesis" / asked.trainer
    failed, left_out = [], []
    for step in thesis_steps():
        if asked.only and step.name not in asked.only:
            continue
        if step.needs and (data is None or not (data / step.needs).is_dir()):
            left_out.append(f"{step.name} (no folder {step.needs} in {data or '--data'})")
        elif not ran(step, asked.trainer, data or Path(), out, home):
            failed.append(step.name)
    for words in (
        ["study=export_runs", f"archive={results / 'runs'}"],
        ["study=report", f"out={results}", "replace=true"],
    ):
        if call(words, home):
            failed.append(words[0])
    if left_out:
        print(f"Left out: {', '.join(left_out)}.")
    if failed:
        print(f"Failed: {', '.join(failed)}. The same command runs these again.", file=sys.stderr)
    print(f"Open {results / 'index.html'}")
    return 1 if failed else 0


def ran(step: Step, trainer: str, data: Path, out: Path, home: Path) -> bool:
    """Run a step where it has no finished runs yet.

    Parameters
    ----------
    step : Step
        The step.
    trainer : str
        Budget of trainings.
    data : pathlib.Path
        Folder of the data sets.
    out : pathlib.Path
        Folder that the steps write to.
    home : pathlib.Path
        Folder of the store.

    Returns
    -------
    bool
        Whether it ended well.
    """
    print(f"== {step.name}", flush=True)
    start = time.monotonic()
    words = step.arguments(trainer, str(data), str(out))
    code = call([*words, f"out={out / step.name}", "resume=true"], home)
    print(f"== {step.name}: {time.monotonic() - start:.0f} s", flush=True)
    return code == 0


def call(words: list[str], home: Path) -> int:
    """Run ``ctus`` with some words.

    Parameters
    ----------
    words : list of str
        Words of the command line.
    home : pathlib.Path
        Folder of the store.

    Returns
    -------
    int
        Exit code.
    """
    program = "import sys; from experiments.cli import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", program, *words], env={**os.environ, "CTUS_HOME": str(home)}, check=False
    ).returncode


if __name__ == "__main__":
    sys.exit(main())
