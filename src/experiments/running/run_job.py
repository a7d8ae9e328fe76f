"""One job, tracked: run a job of a study, keep its results as files, log them, and say how it ended."""

from __future__ import annotations

import dataclasses
import inspect
import json
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from experiments import files
from experiments.errors import user_errors
from experiments.masking import masked, masked_values
from experiments.outcome import InputData, JobResult, Outcome
from experiments.reporting.figure_files import save_figure
from experiments.running import jobs, run_names, terminal
from experiments.running.cost import Cost, Meter, metered
from experiments.running.jobs import Job, Plan
from experiments.tracking import CASES_FILE, HASH_TAG, LABEL_TAG, METRICS_FILE, RunWriter, Store, ending
from experiments.tracking.headline import (
    LEVEL_TAG,
    NOTE_TAG,
    RESULT,
    curves,
    description,
    headline,
    metrics_text,
)

# What a folder of results says of the job that they are of.
JOB_FILE = "job.json"
# In place of a run's hash where its inputs changed under it: it is never taken for the result of any of them.
CHANGED = "inputs changed while it ran"


@dataclass(frozen=True)
class Report:
    """How a job ended, with the run's id and what went wrong.

    ``resumed``: a finished run of it was there. ``refused``: the user's input is at fault.

    Parameters
    ----------
    hash : str
        The job's hash.
    label : str
        The job's label.
    status : str
        ``finished``, ``resumed``, ``refused`` or ``failed``.
    folder : str
        Folder of its results.
    run_id : str or None, optional
        Id of its tracked run; None if there is none.
    message : str, optional
        What went wrong; empty if all is well.
    findings : tuple[str, ...], optional
        Results as plain sentences.
    refused : tuple[str, ...], optional
        Inputs that a finished job left out, a sentence each.
    cost : Cost or None, optional
        What it needed; None for a job that was not run, or whose process was killed.
    """

    hash: str
    label: str
    status: str
    folder: str
    run_id: str | None = None
    message: str = ""
    findings: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    cost: Cost | None = None

    def write(self, path: Path) -> None:
        """Write as JSON, so that the process that waits for all jobs can read it.

        Parameters
        ----------
        path : Path
            File of the report.
        """
        files.write_text(path, json.dumps(asdict(self)))

    @staticmethod
    def read(path: Path) -> Report:
        """Read what ``write`` wrote.

        Parameters
        ----------
        path : Path
            File of the report.

        Returns
        -------
        Report
            What was written.
        """
        content = json.loads(path.read_text(encoding="utf-8"))
        lists = {"findings": tuple(content["findings"]), "refused": tuple(content.get("refused", ()))}
        cost = content.get("cost")
        return Report(**{**content, **lists, "cost": None if cost is None else Cost(**cost)})


def report_file(folder: Path, key: str) -> Path:
    """Where the report of the job of that hash lies while a sweep is under way.

    Parameters
    ----------
    folder : Path
        Folder of the plan.
    key : str
        The job's hash.

    Returns
    -------
    Path
        The file.
    """
    return folder / f"{key}.json"


def is_tracked(study: str, store: Store) -> bool:
    """Whether the jobs of a study become runs: not if tracking is off, nor for studies that measure nothing.

    Parameters
    ----------
    study : str
        Name of the study.
    store : Store
        The tracker.

    Returns
    -------
    bool
        Whether the jobs of a study become runs.
    """
    return store.enabled and getattr(jobs.study_module(study), "TRACKED", True)


def run_job(
    job: Job, plan: Plan, store: Store, progress: terminal.TerminalProgress
) -> tuple[Report, Outcome | None]:
    """Run one job to its end, whatever that is; only a stop by signal or keyboard passes through.

    Parameters
    ----------
    job : Job
        The job.
    plan : Plan
        The plan of the call.
    store : Store
        The tracker.
    progress : terminal.TerminalProgress
        Where progress is shown.

    Returns
    -------
    tuple[Report, Outcome or None]
        How the job ended, and its result if it finished just now.
    """
    with metered(alone=job.config.get("jobs", 1) == 1) as meter:
        report, outcome = _run(job, plan, store, progress, meter)
        return dataclasses.replace(report, cost=None if report.status == "resumed" else meter.cost()), outcome


def _run(
    job: Job, plan: Plan, store: Store, progress: terminal.TerminalProgress, meter: Meter
) -> tuple[Report, Outcome | None]:
    tracked = is_tracked(plan.study, store)
    run_id = None
    try:
        if (done := resumed(job, plan, store)) is not None:
            return done, None
        arguments = jobs.arguments(job.config)
        if not tracked:
            outcome = _compute(job, plan, store, progress, arguments, None)
            return _report(job, plan, "finished", refused=outcome.refused), outcome
        run = start_job(job, plan, store)
        run_id = run.run_id
        try:
            with ending(run, user_errors()), _costed(run, meter):
                outcome = _compute(job, plan, store, progress, arguments, run)
        finally:
            place = plan.folder_of(job.hash) / "untracked"
            keep_for_later(run, store.undelivered, place, job.label or plan.study)
        said, refused = outcome.findings, outcome.refused
        return _report(job, plan, "finished", run_id=run_id, findings=said, refused=refused), outcome
    except user_errors() as refusal:
        return _report(job, plan, "refused", run_id=run_id, message=str(refusal)), None
    except Exception as failure:
        message = masked(f"{type(failure).__name__}: {failure}\n{traceback.format_exc()}")
        return _report(job, plan, "failed", run_id=run_id, message=message), None


def resumed(job: Job, plan: Plan, store: Store) -> Report | None:
    """The report of a job that need not be run again, as ``resume`` asks for and a finished run of it allows.

    Parameters
    ----------
    job : Job
        The job.
    plan : Plan
        The plan of the call.
    store : Store
        The tracker.

    Returns
    -------
    Report or None
        The report, with the job's files brought back; None for a job that is to be run.
    """
    if not (job.config.get("resume") and is_tracked(plan.study, store)):
        return None
    done = _resumable(job, plan, store)
    return None if done is None else _report(job, plan, "resumed", run_id=done)


@contextmanager
def _costed(run: RunWriter, meter: Meter) -> Iterator[None]:
    """Log what the block has needed, however it ends."""
    try:
        yield
    finally:
        log_results(run, Outcome(tags=meter.cost().tags()), Path(), ())


def start_job(job: Job, plan: Plan, store: Store) -> RunWriter:
    """Begin the run of a job, in its place among the runs of the call.

    Parameters
    ----------
    job : Job
        The job.
    plan : Plan
        The plan of the call.
    store : Store
        The tracker.

    Returns
    -------
    RunWriter
        The writer of the run.
    """
    tags = {HASH_TAG: job.hash, "ctus.kind": "job", LABEL_TAG: job.label, **source_tags(job.config)}
    tags[LEVEL_TAG] = plan.levels.get(job.hash, RESULT)
    name = plan.names.get(job.hash) or run_names.job_name(job, with_subject=True)
    return store.start(plan.study, name, tags, plan.parents.get(job.hash))


def source_tags(config: Mapping[str, Any]) -> dict[str, str]:
    """What the dashboard shows as the source of a run, and the whole command.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    dict[str, str]
        Tags by name.
    """
    # The dashboard shows of a source what follows its last slash.
    source = {"mlflow.source.name": f"ctus study={config['study']}", "mlflow.source.type": "LOCAL"}
    command = config.get("call", {}).get("command")
    return source if command is None else {**source, "ctus.command": str(command)}


def headline_names(study: str) -> tuple[str, ...]:
    """The metrics that a study has chosen for the dashboard, by its constant ``HEADLINE``.

    Parameters
    ----------
    study : str
        Name of the study.

    Returns
    -------
    tuple of str
        Names of metrics; none if the study has not chosen.
    """
    return tuple(getattr(jobs.study_module(study), "HEADLINE", ()))


def shown_outcome(outcome: Outcome, job: Job, run_id: str) -> Outcome:
    """What the dashboard shows of a result: few metrics, curves over epochs and a description.

    Parameters
    ----------
    outcome : Outcome
        The result of a job.
    job : Job
        The job.
    run_id : str
        Id of its run.

    Returns
    -------
    Outcome
        The result with its metrics, history and tags as the tracker gets them.
    """
    tables = terminal.markdown(dict(outcome.tables))
    note = description(outcome.findings, tables, outcome.figures, run_id)
    return dataclasses.replace(
        outcome,
        metrics=headline(outcome.metrics, headline_names(str(job.config["study"]))),
        history=curves(outcome.history),
        tags={**outcome.tags, NOTE_TAG: note} if note else outcome.tags,
    )


def read_inputs(folder: Path) -> list[InputData]:
    """The data sets that the job whose files a folder holds has used.

    Parameters
    ----------
    folder : Path
        Folder of the job's files.

    Returns
    -------
    list of InputData
        The data sets; none where the folder does not say.
    """
    record = folder / JOB_FILE
    if not record.is_file():
        return []
    return [InputData(**data) for data in json.loads(record.read_text(encoding="utf-8")).get("inputs", [])]


def keep_for_later(run: RunWriter, folder: Path, fallback: Path, name: str) -> None:
    """Keep a run of which the tracker lacks something as files, which a later call delivers.

    Parameters
    ----------
    run : RunWriter
        The run, which has ended.
    folder : Path
        Folder of waiting runs.
    fallback : Path
        Folder for it where that one can't be written; it is not delivered by itself from there.
    name : str
        What to call it.
    """
    from experiments.tracking.undelivered import keep

    if not run.incomplete or run.written.status is None:
        return
    why = (
        f"The tracker refused {', '.join(run.refused)}"
        if run.refused
        else "The tracking server did not come back"
    )
    try:
        try:
            kept = keep(run, folder)
            then = "a later call delivers it"
        except OSError:
            kept = keep(run, fallback)
            then = f"ctus study=import_runs archive={kept} delivers it"
    except Exception as failure:  # the job's own files are there all the same
        print(f"{name}: could not be kept for the tracker ({_first_line(failure)}).", file=sys.stderr)
        return
    print(f"{why}: {name} waits in {kept}; {then}.", file=sys.stderr)


def load_result(report: Report, job: Job, store: Store) -> JobResult:
    """A finished job as the summary sees it: from its folder where that is, else from the tracker.

    Parameters
    ----------
    report : Report
        How the job ended.
    job : Job
        The job.
    store : Store
        The tracker.

    Returns
    -------
    JobResult
        The result.
    """
    folder = Path(report.folder)
    table = folder / CASES_FILE
    if _holds(folder, job):
        metrics = _read_metrics(folder / METRICS_FILE)
        cases = files.read_table(table) if table.is_file() else None
    else:
        metrics, cases = store.metrics(str(report.run_id)), store.cases(str(report.run_id))
    return JobResult(job.config, metrics, cases, folder, report.run_id, job.choices)


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Keep metrics, per-case table, result tables, figures and further files in ``folder``.

    Parameters
    ----------
    outcome : Outcome
        The result.
    folder : Path
        Folder for the files.
    """
    files.write_text(folder / METRICS_FILE, metrics_text(outcome.metrics))
    if outcome.history:
        import pandas as pd

        files.write_text(folder / "history.csv", pd.DataFrame(outcome.history).to_csv(index_label="epoch"))
    if outcome.cases is not None:
        outcome.cases.to_parquet(folder / CASES_FILE, index=False)
    if outcome.tables:
        sentences = "".join(f"- {' '.join(each.splitlines())}\n" for each in outcome.findings)
        text = terminal.markdown(dict(outcome.tables)) + (
            f"\n### Findings\n\n{sentences}" if sentences else ""
        )
        files.write_text(folder / "summary.md", text)
    for name, figure in outcome.figures.items():
        save_figure(figure, folder / name)
    for name, write in outcome.files.items():
        write(folder / name)


def log_results(run: RunWriter, outcome: Outcome, folder: Path, names: Sequence[str]) -> None:
    """Log what the dashboard shows of an outcome, and the files ``names`` of ``folder``, which are written already.

    What the tracker refuses is reported and left out: by now the results are there, and nothing of them may be lost.

    Parameters
    ----------
    run : RunWriter
        The run that is being written.
    outcome : Outcome
        The result.
    folder : Path
        Folder that holds the files.
    names : Sequence[str]
        Names of the files, from that folder on.
    """
    parts: dict[str, Callable[[], None]] = {
        "the history": lambda: run.history(outcome.history),
        "the metrics": lambda: run.metrics(outcome.metrics),
        "the tags": lambda: run.tags(outcome.tags),
        "the data sets": lambda: run.inputs(outcome.inputs),
        "the files": lambda: run.files(folder, names),
    }
    for part, log in parts.items():
        try:
            log()
        except Exception as refusal:
            run.refused.append(part)
            print(
                f"The tracker refused {part} of run {run.run_id} ({_first_line(refusal)}); "
                f"all results are in {folder}.",
                file=sys.stderr,
            )


def log_beginning(run: RunWriter, config: Mapping[str, Any], params: Mapping[str, Any]) -> None:
    """Log the resolved configuration and parameters; that the tracker refuses them is no reason not to compute.

    Parameters
    ----------
    run : RunWriter
        The run that is being written.
    config : Mapping[str, Any]
        A resolved configuration.
    params : Mapping[str, Any]
        Parameters by name.
    """
    text = yaml.safe_dump(masked_values(config), sort_keys=False)
    parts: dict[str, Callable[[], None]] = {
        "the configuration": lambda: run.text(text, "config.yaml"),
        "the parameters": lambda: run.params(params),
    }
    for part, log in parts.items():
        try:
            log()
        except Exception as refusal:
            run.refused.append(part)
            print(
                f"The tracker refused {part} of run {run.run_id} ({_first_line(refusal)}).", file=sys.stderr
            )


def _compute(
    job: Job,
    plan: Plan,
    store: Store,
    progress: terminal.TerminalProgress,
    arguments: dict[str, Any],
    run: RunWriter | None,
) -> Outcome:
    """Run the study in a folder next to the final one; nothing appears under the final name unless all went well."""
    module = jobs.study_module(plan.study)
    if run is not None:
        log_beginning(run, job.config, run_names.parameters(job))
    folder = plan.folder_of(job.hash)
    earlier = _earlier_files(folder)
    with files.staged(folder) as workspace:
        arguments = {**arguments, **_injected(module.run, workspace, progress, store)}
        with jobs.naming_settings(job.config):
            outcome: Outcome = module.run(**arguments)
        write_outcome(outcome, workspace)
        inputs = [asdict(data) for data in outcome.inputs]
        written = sorted([*files.names_in(workspace), JOB_FILE])
        record = {"study": plan.study, "config_hash": job.hash, "inputs": inputs, "files": written}
        files.write_text(workspace / JOB_FILE, json.dumps(record))
    _settle_earlier(folder, earlier, written, job, plan.study)
    # Only now: whatever the tracker does with them, the files are where the user looks for them.
    if run is not None:
        changed = jobs.hash_now(job.config) != job.hash
        shown = shown_outcome(outcome, job, run.run_id)
        tags = {**shown.tags, **({HASH_TAG: CHANGED} if changed else {})}
        log_results(run, dataclasses.replace(shown, tags=tags), folder, written)
        if changed:
            print(
                f"{job.label or plan.study}: what it reads has changed since the call began; its result may mix old "
                "and new, and resume=true will run it again.",
                file=sys.stderr,
            )
    return outcome


def _earlier_files(folder: Path) -> tuple[str, list[str]]:
    """The study of the run that a folder holds the files of, and their names; empty where it doesn't say."""
    try:
        record = json.loads((folder / JOB_FILE).read_text(encoding="utf-8"))
        return str(record["study"]), [str(name) for name in record["files"]]
    except (OSError, ValueError, KeyError, TypeError):
        return "", []


def _settle_earlier(
    folder: Path, earlier: tuple[str, list[str]], written: Collection[str], job: Job, study: str
) -> None:
    """Deal with what another run had left in the folder: removed if it was of the same study, else named."""
    before, names = earlier
    if before == study:
        _remove_earlier(folder, set(names) - set(written), job)
        return
    if lost := sorted((set(names) & set(written)) - {JOB_FILE}):
        print(
            f"{folder}: replaced {', '.join(lost)} of study={before}, whose other files stay; "
            "out=<a folder for each study> keeps both.",
            file=sys.stderr,
        )


def _remove_earlier(folder: Path, names: Collection[str], job: Job) -> None:
    """Remove what an earlier run left and this one did not write again: beside new files they would be taken for its.

    What this job has read stays, and the list is a file like others: nothing outside the folder is touched for it.
    """
    read = [Path(each).expanduser().resolve() for each in jobs.read_paths(job.config)]
    removed = []
    for name in sorted(names):
        path = folder / name
        place = path.resolve()
        inside = place.is_relative_to(folder.resolve())
        if inside and path.is_file() and not any(place.is_relative_to(each) for each in read):
            path.unlink()
            removed.append(name)
    if removed:
        more = f" and {len(removed) - 5} more" if len(removed) > 5 else ""
        print(
            f"{folder}: removed what the run before had left: {', '.join(removed[:5])}{more}.",
            file=sys.stderr,
        )


def _injected(
    function: Any, workspace: Path, progress: terminal.TerminalProgress, store: Store
) -> dict[str, Any]:
    offered = {"workspace": workspace, "progress": progress, "store": store}
    return {name: offered[name] for name in inspect.signature(function).parameters if name in offered}


def _resumable(job: Job, plan: Plan, store: Store) -> str | None:
    """The finished run that a job need not repeat, with its files brought back where they are missing; or none.

    A run whose files can't be had any more is not one: what reads them would find an empty folder.
    """
    done = store.finished(plan.study, job.hash)
    folder = plan.folder_of(job.hash)
    if done is None or _holds(folder, job):
        return done
    try:
        with files.staged(folder) as stage:
            store.restore_files(done, stage)
            if not files.names_in(stage):
                raise LookupError("the tracker has none")
    except Exception as failure:
        print(
            f"{job.label or plan.study}: the files of its finished run {done} can't be brought back "
            f"({_first_line(failure)}); it is run again.",
            file=sys.stderr,
        )
        return None
    return done


def _holds(folder: Path, job: Job) -> bool:
    """Whether the files in ``folder`` are those of this very job, not of one that used the same folder before."""
    record = folder / JOB_FILE
    return record.is_file() and json.loads(record.read_text(encoding="utf-8"))["config_hash"] == job.hash


def _first_line(error: Exception) -> str:
    return masked((str(error).splitlines() or [type(error).__name__])[0])


def _report(
    job: Job,
    plan: Plan,
    status: str,
    *,
    run_id: str | None = None,
    message: str = "",
    findings: tuple[str, ...] = (),
    refused: tuple[str, ...] = (),
) -> Report:
    folder = str(plan.folder_of(job.hash))
    return Report(job.hash, job.label, status, folder, run_id, message, findings, refused)


def _read_metrics(path: Path) -> dict[str, float]:
    return {key: float(value) for key, value in json.loads(path.read_text(encoding="utf-8")).items()}
