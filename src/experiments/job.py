"""One job, tracked: run a cell of a study, keep its results as files, log them, and say how it ended."""

from __future__ import annotations

import inspect
import json
import math
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from experiments import cells, files, terminal
from experiments.cells import Cell, Plan
from experiments.errors import InputError
from experiments.identity import flatten
from experiments.outcome import CellResult, Outcome
from experiments.reporting.figure_files import save_figure
from experiments.tracking import HASH_TAG, RunWriter, Store, ending

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Report:
    """How a cell ended: ``finished``, ``resumed`` (a finished run of it was there), ``refused`` (the user's input is
    at fault) or ``failed``; with the run's id and what went wrong."""

    hash: str
    label: str
    status: str
    folder: str
    run_id: str | None = None
    message: str = ""
    findings: tuple[str, ...] = ()

    def write(self, path: Path) -> None:
        """Write as JSON, so that the process that waits for all jobs can read it."""
        files.write_text(path, json.dumps(self.__dict__))

    @staticmethod
    def read(path: Path) -> Report:
        """Read what ``write`` wrote."""
        content = json.loads(path.read_text(encoding="utf-8"))
        return Report(**{**content, "findings": tuple(content["findings"])})


def report_file(folder: Path, key: str) -> Path:
    """Where the report of the job of that hash lies while a sweep is under way."""
    return folder / f"{key}.json"


def user_errors() -> tuple[type[Exception], ...]:
    """The exceptions that mean the user's input is at fault, of every package."""
    import models.errors
    import registration.errors

    return InputError, models.errors.InputError, registration.errors.InputError


def is_tracked(study: str, store: Store) -> bool:
    """Whether the jobs of a study become runs: not if tracking is off, nor for studies that measure nothing."""
    return store.enabled and getattr(cells.study_module(study), "TRACKED", True)


def run_cell(
    cell: Cell, plan: Plan, store: Store, progress: terminal.TerminalProgress
) -> tuple[Report, Outcome | None]:
    """Run one cell to its end, whatever that is; only a stop by signal or keyboard passes through."""
    tracked = is_tracked(plan.study, store)
    if tracked and cell.config.get("resume") and (done := store.finished(plan.study, cell.hash)) is not None:
        _restore_files(cell, plan, done, store)
        return _report(cell, plan, "resumed", run_id=done), None
    run_id = None
    try:
        arguments = cells.arguments(cell.config)
        if not tracked:
            return _report(cell, plan, "finished"), _compute(cell, plan, store, progress, arguments, None)
        run = store.start(
            plan.study, cell.label or plan.study, {HASH_TAG: cell.hash, "ctus.kind": "job"}, plan.parent_id
        )
        run_id = run.run_id
        with ending(run):
            outcome = _compute(cell, plan, store, progress, arguments, run)
        if run.lost:
            _keep_for_later(cell, plan, run, outcome)
        return _report(cell, plan, "finished", run_id=run_id, findings=outcome.findings), outcome
    except user_errors() as refusal:
        return _report(cell, plan, "refused", run_id=run_id, message=str(refusal)), None
    except Exception as failure:
        message = f"{type(failure).__name__}: {failure}\n{traceback.format_exc()}"
        return _report(cell, plan, "failed", run_id=run_id, message=message), None


def _keep_for_later(cell: Cell, plan: Plan, run: RunWriter, outcome: Outcome) -> None:
    """Write a finished run that the tracking server did not get as files that ``study=import_runs`` reads."""
    from experiments.run_archive import write_archive
    from experiments.run_record import finished_run

    folder = plan.folder_of(cell.hash) / "untracked"
    write_archive([finished_run(run, cell.config, outcome)], folder)
    print(
        f"The tracking server did not come back. Once it answers, ctus study=import_runs archive={folder} tracks "
        f"{cell.label or plan.study}.",
        file=sys.stderr,
    )


def load_result(report: Report, cell: Cell, store: Store) -> CellResult:
    """A finished cell as the summary sees it: from its folder where that is, else from the tracker."""
    import pandas as pd

    folder = Path(report.folder)
    table = folder / "cases.parquet"
    if _holds(folder, cell):
        metrics = _read_metrics(folder / "metrics.json")
        cases = pd.read_parquet(table) if table.is_file() else None
    else:
        metrics, cases = store.metrics(str(report.run_id)), store.cases(str(report.run_id))
    return CellResult(cell.config, metrics, cases, folder, report.run_id)


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Keep metrics, per-case table, result tables and figures as files in ``folder``."""
    files.write_text(
        folder / "metrics.json", json.dumps({k: _json_number(v) for k, v in outcome.metrics.items()})
    )
    if outcome.cases is not None:
        outcome.cases.to_parquet(folder / "cases.parquet", index=False)
    if outcome.tables:
        files.write_text(folder / "summary.md", terminal.markdown(dict(outcome.tables)))
    for name, figure in outcome.figures.items():
        save_figure(figure, folder / name)


def log_outcome(run: RunWriter, outcome: Outcome) -> None:
    """Log what the dashboard shows of an outcome."""
    run.history(outcome.history)
    run.metrics(outcome.metrics)
    run.tags(outcome.tags)
    run.inputs(outcome.inputs)


def log_config(run: RunWriter, config: Mapping[str, Any]) -> None:
    """Log the resolved configuration as an artifact and as flat parameters."""
    run.text(yaml.safe_dump(dict(config), sort_keys=False), "config.yaml")
    run.params(flatten(config))


def _compute(
    cell: Cell,
    plan: Plan,
    store: Store,
    progress: terminal.TerminalProgress,
    arguments: dict[str, Any],
    run: RunWriter | None,
) -> Outcome:
    """Run the study in a folder beside the final one; nothing appears under the final name unless all went well."""
    module = cells.study_module(plan.study)
    if run is not None:
        log_config(run, cell.config)
    with files.staged(plan.folder_of(cell.hash)) as workspace:
        arguments = {**arguments, **_injected(module.run, workspace, progress, store)}
        outcome: Outcome = module.run(**arguments)
        write_outcome(outcome, workspace)
        files.write_text(workspace / "job.json", json.dumps({"study": plan.study, "config_hash": cell.hash}))
        if run is not None:
            log_outcome(run, outcome)
            run.folder(workspace)
    return outcome


def _injected(
    function: Any, workspace: Path, progress: terminal.TerminalProgress, store: Store
) -> dict[str, Any]:
    offered = {"workspace": workspace, "progress": progress, "store": store}
    return {name: offered[name] for name in inspect.signature(function).parameters if name in offered}


def _restore_files(cell: Cell, plan: Plan, run_id: str, store: Store) -> None:
    """Bring a finished run's files back where they are missing, so that what reads them finds them."""
    folder = plan.folder_of(cell.hash)
    if _holds(folder, cell):
        return
    with files.staged(folder) as stage:
        store.restore_files(run_id, stage)


def _holds(folder: Path, cell: Cell) -> bool:
    """Whether the files in ``folder`` are those of this very job, not of one that used the same folder before."""
    record = folder / "job.json"
    return record.is_file() and json.loads(record.read_text(encoding="utf-8"))["config_hash"] == cell.hash


def _report(
    cell: Cell,
    plan: Plan,
    status: str,
    *,
    run_id: str | None = None,
    message: str = "",
    findings: tuple[str, ...] = (),
) -> Report:
    return Report(cell.hash, cell.label, status, str(plan.folder_of(cell.hash)), run_id, message, findings)


def _json_number(value: float) -> float | str:
    # JSON has no NaN or infinity; as text they survive, and nobody takes them for a number.
    return float(value) if math.isfinite(value) else str(float(value))


def _read_metrics(path: Path) -> dict[str, float]:
    return {key: float(value) for key, value in json.loads(path.read_text(encoding="utf-8")).items()}
