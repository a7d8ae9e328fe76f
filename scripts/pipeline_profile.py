"""Where ``ctus study=pipeline`` spends its time: seconds of each stage, and profiles of the three slowest.

    python scripts/pipeline_profile.py --out profile.json [--repeats 2] [--quick]

The stages are timed in fresh processes without a profiler, which slows Python's own calls down most; the profiles come
from one more process. What no stage has is the start of Python, imports, composing and the end.
"""

from __future__ import annotations

import argparse
import cProfile
import functools
import importlib
import json
import os
import pstats
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from claims_framework import phantom_network, pipeline_words
from quick_budget import parsed

STUDY = "experiments.studies.pipeline.study"
# Of each stage the owners of its functions, as module:class (or module), and the functions.
STAGES = {
    "simulate the sweep": ((STUDY, "simulate_sweep"),),
    "load the network": (("models.predictor:Predictor", "load"),),
    "segment": (("models.predictor:Predictor", "soft_masks"),),
    "contours and filters": (("registration.pipeline:Reconstruction", "gather"),),
    "surface and centerline": (("registration.pipeline:Reconstruction", "build"),),
    "rigid registration": (("registration.rigid.multi_start:MultiStartICP", "__call__"),),
    "deformable registration": (("registration.cpd:CoherentPointDrift", "__call__"),),
    "files and page": ((STUDY, "write"), (STUDY, "outcome")),
    "scores of the masks": ((STUDY, "_score_frames"),),
    "tracking": tuple(
        (f"experiments.tracking.{owner}", name)
        for owner, names in (
            (
                "store:Store",
                ("client", "start", "reopen", "save_view", "finished", "mark_orphans_failed", "run"),
            ),
            (
                "run_writer:RunWriter",
                ("params", "history", "points", "tags", "drop_tags", "inputs", "text", "files", "end"),
            ),
        )
        for name in names
    ),
}
REST = "start, imports, composing, the rest"
SLOWEST, SHOWN = 3, 6


class StageClock:
    """Seconds inside the functions of each stage; of nested ones the outermost counts.

    Parameters
    ----------
    profiled : tuple of str, optional
        Stages that a profiler watches, each with its own.
    """

    def __init__(self, profiled: tuple[str, ...] = ()) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.profiles = {stage: cProfile.Profile() for stage in profiled}
        self._inside = False

    def watch(self, stage: str, owner: Any, name: str) -> None:
        """Count a function of a stage.

        Parameters
        ----------
        stage : str
            Name of the stage.
        owner : type or module
            What has the function.
        name : str
            Name of the function.
        """
        found = vars(owner)[name]
        if isinstance(found, classmethod):
            setattr(owner, name, classmethod(self._timed(found.__func__, stage)))
        else:
            setattr(owner, name, self._timed(found, stage))

    def _timed(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*given: Any, **named: Any) -> Any:
            if self._inside:
                return function(*given, **named)
            self._inside, begin_s = True, time.perf_counter()
            profile = self.profiles.get(stage)
            try:
                return (
                    function(*given, **named)
                    if profile is None
                    else profile.runcall(function, *given, **named)
                )
            finally:
                self.seconds[stage] += time.perf_counter() - begin_s
                self._inside = False

        return timed


def busiest(profile: cProfile.Profile, count: int = SHOWN) -> list[dict[str, Any]]:
    """List the functions that take the most time of their own.

    Parameters
    ----------
    profile : cProfile.Profile
        What was recorded.
    count : int, optional
        Number of functions.

    Returns
    -------
    list of dict
        Name, calls, and the share of the profile's time in the function itself, greatest first.
    """
    stats: dict[Any, Any] = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    whole_s = sum(own_s for _, _, own_s, _, _ in stats.values()) or 1.0
    rows = [
        {"function": _shown(*place), "calls": calls, "share": own_s / whole_s}
        for place, (_, calls, own_s, _, _) in stats.items()
    ]
    return sorted(rows, key=lambda row: -row["share"])[:count]


def _shown(path: str, line: int, name: str) -> str:
    """A function as package/module:function; those of C have no file."""
    if path == "~":
        return name.strip("<>")
    parts = Path(path).with_suffix("").parts
    for top in ("site-packages", "src", "lib"):
        if top in parts[:-1]:
            parts = parts[len(parts) - parts[::-1].index(top) :]
    return f"{'/'.join(parts[-3:])}:{name}"


def one_call(words: list[str], profiled: tuple[str, ...]) -> dict[str, Any]:
    """Run the pipeline in this process.

    Parameters
    ----------
    words : list of str
        The call.
    profiled : tuple of str
        Stages that are profiled.

    Returns
    -------
    dict
        Seconds of each stage and of the whole, and functions of the profiled stages.
    """
    clock, begin_s = StageClock(profiled), time.perf_counter()
    for stage, functions in STAGES.items():
        for owner, name in functions:
            module, _, inner = owner.partition(":")
            found = importlib.import_module(module)
            clock.watch(stage, getattr(found, inner) if inner else found, name)
    from experiments.cli import main

    if main([*words, "quiet=true"]):
        raise SystemExit("study=pipeline: expected exit code 0")
    whole_s = time.perf_counter() - begin_s
    seconds = {stage: clock.seconds.get(stage, 0.0) for stage in STAGES}
    seconds[REST] = whole_s - sum(seconds.values())
    return {
        "seconds": seconds,
        "whole_s": whole_s,
        "functions": {stage: busiest(profile) for stage, profile in clock.profiles.items()},
    }


def profile_pipeline(work: Path, repeats: int, quick: bool) -> dict[str, Any]:
    """Time the stages in fresh processes, then profile the slowest ones in one more.

    Parameters
    ----------
    work : Path
        Folder of the network and the store.
    repeats : int
        Number of calls that are timed.
    quick : bool
        Whether a small sweep is enough.

    Returns
    -------
    dict
        ``stages``: seconds of each stage in each call; ``functions``: those of the three slowest stages.
    """
    phantom_network(work, quick)
    timed = [_in_process(work, quick, ()) for _ in range(repeats)]
    stages = {stage: [each["seconds"][stage] for each in timed] for stage in timed[0]["seconds"]}
    ranked = sorted(STAGES, key=lambda stage: -statistics.median(stages[stage]))[:SLOWEST]
    functions = _in_process(work, quick, tuple(ranked))["functions"]
    return {"stages": stages, "whole_s": [each["whole_s"] for each in timed], "functions": functions}


def _in_process(work: Path, quick: bool, profiled: tuple[str, ...]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        words = [sys.executable, __file__, "--child", *profiled, "--out", str(out), "--work", str(work)]
        subprocess.run(
            [*words, *(["--quick"] if quick else [])],
            check=True,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "CTUS_HOME": str(work)},
        )
        found: dict[str, Any] = json.loads(out.read_text())
        return found


def main() -> None:
    """Profile, or be one of the processes that are profiled."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="file of the result, JSON")
    parser.add_argument("--work", type=Path, default=Path("outputs/benchmarks"), help="folder of the network")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--child", nargs="*", help=argparse.SUPPRESS)
    given = parsed(parser, {"repeats": 1})
    work = given.work.resolve()
    if given.child is None:
        found = profile_pipeline(work, given.repeats, given.quick)
    else:
        with tempfile.TemporaryDirectory() as folder:
            found = one_call(pipeline_words(work, given.quick, Path(folder) / "out"), tuple(given.child))
    given.out.write_text(json.dumps(found))


if __name__ == "__main__":
    main()
