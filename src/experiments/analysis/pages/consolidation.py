"""Page of the consolidation study on one data set, from exported runs: no training is repeated for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from experiments import files
from experiments.analysis.pages.page_parts import archived_result, finished_jobs, listed, save_page_figure
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.running.terminal import markdown
from experiments.tracking.run_record import RunRecord

HEAD = """# One model from the folds: {dataset}

Made by `ctus -m +sweep=consolidation_{name}`, with the trainings named below, and
`python scripts/consolidation_results.py {name}` from the runs in `results/runs`. Commit {commits}; {runs} runs
(seeds {seeds}); {machines}. Trainings: {trainings}.

Every choice is made on selection groups; test groups are scored once, after all choices. `mean fold` is the mean of the
single folds, `best fold` the one that is best on selection groups. Masks of the table of candidates are at a
probability of 0.5, without calibration. Intervals resample groups (95 %). Missed vessels and false alarms are mean
numbers over seeds. NLL and calibration errors are at the network's size; `ece_boundary` is that of a narrow band around
the boundary.

"""
TITLES = {
    "candidates": "Candidates on test groups",
    "ablation": "From probabilities to masks, step by step",
    "calibration": "Calibration on test groups",
    "barriers": "Interpolation barriers between the folds' networks",
}


def write_page(archive: Path, out: Path, name: str, summarise: Callable[[list[JobResult]], Outcome]) -> int:
    """Write ``consolidation_<name>.md`` with its tables (CSV), figures (PNG) and certificate.

    Parameters
    ----------
    archive : Path
        Folder of exported runs.
    out : Path
        Folder of the page.
    name : str
        Name of the data set; ``simulated`` for all simulated ones.
    summarise : callable
        What the study makes of its jobs.

    Returns
    -------
    int
        Number of runs.

    Raises
    ------
    InputError
        If the archive has no finished runs on the data set.
    """
    runs = [run for run in finished_jobs(archive, "consolidation") if _is_of(run, name)]
    if not runs:
        raise InputError(f"{archive}: expected finished runs of consolidation on {name}, found none")
    runs.sort(key=lambda run: run.start_ms)
    outcome = summarise([archived_result(run) for run in runs])
    stem = f"consolidation_{name}"
    parts = [_head(runs, name), listed(outcome.findings), ""]
    for title, table in outcome.tables.items():
        parts += [f"## {TITLES.get(title, title)}", "", _table(markdown({title: table})), ""]
        files.write_text(out / f"{stem}_{title}.csv", table.to_csv(index=False, float_format="%.6g"))
    for title, figure in outcome.figures.items():
        parts += [f"![{title}]({stem}_{title}.png)", ""]
        save_page_figure(figure, out / f"{stem}_{title}")
    if "certificate.md" in outcome.files:
        outcome.files["certificate.md"](out / f"{stem}_certificate.md")
        parts += [f"The certificates: [{stem}_certificate.md]({stem}_certificate.md).", ""]
    files.write_text(out / f"{stem}.md", "\n".join(parts).strip() + "\n")
    return len(runs)


def _is_of(run: RunRecord, name: str) -> bool:
    if name == "simulated":
        return run.tags.get("simulated") == "true"
    return run.tags.get("dataset") == name and run.tags.get("simulated") != "true"


def _head(runs: list[RunRecord], name: str) -> str:
    seeds = sorted({str(archived_result(run).config["training_seed"]) for run in runs})
    return HEAD.format(
        dataset=", ".join(sorted({run.tags.get("dataset", name) for run in runs})),
        name=name,
        commits=", ".join(sorted({run.tags.get("mlflow.source.git.commit", "unknown")[:12] for run in runs})),
        runs=len(runs),
        trainings="; ".join(sorted({_training(archived_result(run).config) for run in runs})),
        seeds=", ".join(seeds),
        machines=", ".join(sorted({run.tags.get("ctus.machine", "unknown") for run in runs})),
    )


def _training(config: Mapping[str, Any]) -> str:
    """What a training is that the preset alone does not tell: budget, size and start."""
    trainer, split = config["trainer"], config["split"]
    # Trainings of before the choice of a start began from random weights.
    start = str(config.get("init", {}).get("_target_", "SharedRandom")).rsplit(".", 1)[-1]
    outer = "" if split["outer_folds"] is None else f"{split['outer_folds']} outer folds of "
    kind = {"Pretrained": "pretrained weights", "SharedRandom": "random weights of the seed"}.get(
        start, start
    )
    return (
        f"{outer}{split['folds']} folds, at most {trainer['max_epochs']} epochs of batches of {trainer['batch_size']}, "
        f"{config['image_size_px']} px, from {kind}"
    )


def _table(text: str) -> str:
    """A table without the heading that it has elsewhere."""
    lines = text.splitlines()
    return "\n".join(line for line in lines if not line.startswith("#")).strip()
