"""What is claimed of the speed of the simulator, the command line, the tracker and a whole pipeline."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from quick_budget import REPOSITORY
from side_by_side import Claim, Side, version_of

CTUS = (sys.executable, "-m", "experiments.cli")
NAMES, STEPS = 10, 100
# log_metric is called so many times, and its time multiplied.
ONE_BY_ONE = 100


def simulator(quick: bool) -> Claim:
    """Frames of a simulated sweep; nobody else simulates this."""
    from registration.phantom.conditions import Motion
    from registration.phantom.scan import simulate_sweep
    from registration.phantom.settings import PhantomSettings

    frames = 2 if quick else 10
    settings = PhantomSettings(motion=Motion(frames=frames))
    known = simulate_sweep(settings, 0)
    height, width = known.masks.shape[1:]
    return Claim(
        "Simulator",
        f"{frames} frames of {height} x {width} px with exact masks and tracked poses",
        Side("simulate_sweep", lambda number: simulate_sweep(settings, 0)),
        lambda number, found: float(
            (found.sweep.images != known.sweep.images).sum() + (found.masks != known.masks).sum()
        ),
        "pixels that differ from the same sweep simulated before",
        0.0,
        rounds=1 if quick else 5,
        remarks=[
            "No peer: no other program was found that makes B-mode frames, exact masks and tracked poses of a vessel "
            "that deforms."
        ],
    )


def help_page(quick: bool) -> Claim:
    """``ctus --help`` beside the help of other programs of its kind."""
    folder = Path(tempfile.mkdtemp())
    (folder / "config.yaml").write_text("a: 1\n")
    app = folder / "app.py"
    app.write_text(
        "import hydra\n\n\n@hydra.main(version_base=None, config_path='.', config_name='config')\n"
        "def main(config):\n    print(config)\n\n\nmain()\n"
    )
    studies = sorted(path.stem for path in (REPOSITORY / "conf" / "study").glob("*.yaml"))
    return Claim(
        "--help",
        f"a new process that prints the help and ends; ours lists {len(studies)} studies",
        called_side("ctus --help", [*CTUS, "--help"], studies),
        lambda number, lacking: lacking,
        "words that are not in the output, or the exit code",
        0.0,
        [
            called_side(
                "--help of a Hydra application with one setting",
                [sys.executable, str(app), "--help"],
                ["a: 1"],
                version_of("hydra-core"),
            ),
            called_side(
                "mlflow --help", [sys.executable, "-m", "mlflow", "--help"], ["Usage"], version_of("mlflow")
            ),
            called_side(
                "python -c 'import hydra': no help at all",
                [sys.executable, "-c", "import hydra"],
                [],
                version_of("hydra-core"),
            ),
        ],
        rounds=1 if quick else 5,
    )


def called(
    words: Sequence[str], expected: Sequence[str], root: Path = REPOSITORY, folder: Path | None = None
) -> float:
    """Run a program to its end.

    Parameters
    ----------
    words : sequence of str
        The program and its words.
    expected : sequence of str
        What its output must have.
    root : Path, optional
        Tree whose ``src`` it imports.
    folder : Path or None, optional
        Home of its store and outputs; None for that of this process.

    Returns
    -------
    float
        Number of the expected words that its output lacks; its exit code where that is not 0.
    """
    surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "src"), *_own_paths()])}
    if folder is not None:
        surroundings["CTUS_HOME"] = str(folder)
    done = subprocess.run(words, capture_output=True, text=True, env=surroundings, check=False)
    if done.returncode:
        print(done.stderr[-2000:], file=sys.stderr)
        return float(done.returncode)
    return float(sum(word not in done.stdout for word in expected))


def _own_paths() -> list[str]:
    """Of the surroundings' search path all but a tree of this project."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return [each for each in given if each and not (Path(each) / "experiments").is_dir()]


def called_side(
    name: str, words: list[str], expected: list[str], version: str = "", root: Path = REPOSITORY
) -> Side:
    """Make a side of a program that is run to its end, as ``called`` does."""
    return Side(name, lambda number: called(words, expected, root), version)


@dataclass(frozen=True)
class _Runs:
    """Fresh runs of one store, and what is logged in each."""

    ours: Any
    others: dict[str, str]
    steps: list[dict[str, float]]


def metrics_logged(quick: bool) -> Claim:
    """1000 values of metrics, beside MLflow's own ways of logging them."""
    os.environ["CTUS_HOME"] = tempfile.mkdtemp()
    os.environ.pop("MLFLOW_TRACKING_URI", None)
    import mlflow
    from mlflow.entities import Metric

    from experiments.tracking import Store

    store = Store()
    client, experiment = store.client(), store.experiment_id("bench")
    mlflow.set_tracking_uri(store.address)
    rng = np.random.default_rng(0)
    steps = [
        {f"metric_{name}": float(rng.random()) for name in range(NAMES)} for _ in range(2 if quick else STEPS)
    ]
    count = sum(map(len, steps))

    def one_by_one(runs: _Runs) -> str:
        given = [(*pair, step) for step, values in enumerate(runs.steps) for pair in values.items()]
        for name, value, step in given[:ONE_BY_ONE]:
            mlflow.log_metric(name, value, step=step, run_id=runs.others["one by one"])
        return runs.others["one by one"]

    def by_step(runs: _Runs) -> str:
        for step, values in enumerate(runs.steps):
            mlflow.log_metrics(values, step=step, run_id=runs.others["by step"])
        return runs.others["by step"]

    def at_once(runs: _Runs) -> str:
        entries = [
            Metric(*pair, 0, step) for step, values in enumerate(runs.steps) for pair in values.items()
        ]
        client.log_batch(runs.others["at once"], metrics=entries)
        return runs.others["at once"]

    def ours(runs: _Runs) -> str:
        runs.ours.history(runs.steps)
        return str(runs.ours.run_id)

    def problem(number: int) -> _Runs:
        others = {
            name: client.create_run(experiment).info.run_id for name in ("one by one", "by step", "at once")
        }
        return _Runs(store.start("bench", f"run {number}", {}), others, steps)

    def lost(runs: _Runs, run_id: str) -> float:
        kept = {
            (name, point.step): point.value
            for name in runs.steps[0]
            for point in client.get_metric_history(run_id, name)
        }
        given = {
            (name, step): value for step, values in enumerate(runs.steps) for name, value in values.items()
        }
        if run_id == runs.others["one by one"]:
            given = dict(list(given.items())[:ONE_BY_ONE])
        if run_id == runs.ours.run_id:
            runs.ours.end("FINISHED")
        return float(sum(kept.get(key) != value for key, value in given.items()) + len(kept) - len(given))

    done = min(ONE_BY_ONE, count)
    return Claim(
        f"{count} values of metrics logged",
        f"{len(steps)} steps of {NAMES} metrics into one SQLite store that is there already",
        Side("RunWriter.history", ours),
        lost,
        "values that the store does not have afterwards, or has wrong",
        0.0,
        [
            Side(
                f"mlflow.log_metric one by one ({done} of them, times {count // done})",
                one_by_one,
                version_of("mlflow"),
                count / done,
            ),
            Side("mlflow.log_metrics step by step", by_step, version_of("mlflow")),
            Side("MlflowClient.log_batch, all at once", at_once, version_of("mlflow")),
        ],
        problem,
        1 if quick else 5,
        remarks=["All are MLflow in the end: ours is one batch, kept for a server that is away, too."],
    )


def phantom_network(work: Path, quick: bool) -> Path:
    """A small network for simulated frames, trained in a minute or two and kept in a folder.

    Parameters
    ----------
    work : Path
        Folder that keeps it.
    quick : bool
        Whether a few epochs on a few frames are enough.

    Returns
    -------
    Path
        Its file.
    """
    path = work / ("network_quick" if quick else "network") / "fold-0" / "model.pt"
    if not path.is_file():
        words = [
            "study=segmentation",
            "dataset=phantom",
            f"dataset.sweeps={2 if quick else 3}",
            f"dataset.frames_per_sweep={10 if quick else 20}",
            "trainer=demo",
            f"trainer.max_epochs={4 if quick else 20}",
            f"trainer.patience={4 if quick else 20}",
            "split.folds=2",
            f"out={path.parents[1]}",
            *(["dataset.size_px=128"] if quick else []),
        ]
        if called([*CTUS, *words, "quiet=true"], [], folder=work):
            raise SystemExit(f"{path}: expected a network of study=segmentation, received a failure")
    return path


def pipeline_words(work: Path, quick: bool, out: Path) -> list[str]:
    """The call of the pipeline."""
    small = ["phantom.motion.frames=12", "phantom.scanner.height_px=128", "phantom.scanner.width_px=128"]
    return [
        "study=pipeline",
        "phantom=artery",
        f"model_path={phantom_network(work, quick)}",
        *(small if quick else []),
        f"out={out}",
    ]


def pipeline(quick: bool) -> Claim:
    """From a simulated sweep to the registered, displaced model, by one call; nobody else does this."""
    work = Path(os.environ["CTUS_BENCH_WORK"])
    expected = ["Dashboard"] if not quick else []

    def call(more: Sequence[str]) -> float:
        folder = Path(tempfile.mkdtemp())
        lacking = called([*CTUS, *pipeline_words(work, quick, folder), *more], expected, folder=work)
        there = all((folder / name).is_file() for name in ("surface.ply", "registration.json", "scene.html"))
        found = json.loads((folder / "metrics.json").read_text()) if there else {}
        shutil.rmtree(folder)
        return math.inf if lacking else float(found.get("tre_mm", math.inf))

    phantom_network(work, quick)
    return Claim(
        "Pipeline",
        "ctus study=pipeline: a new process, a sweep of an artery simulated, segmented, reconstructed, registered, the "
        "model displaced, pages and run written",
        Side("ctus study=pipeline", lambda number: call([])),
        lambda number, tre_mm: tre_mm,
        "TRE of the rigid registration, mm; infinite where the call fails or leaves a file out",
        2.0,
        rounds=1 if quick else 3,
        warm_up=False,
        remarks=["No peer: no other program was found that does all of this."],
    )
