"""A run apart from any store: what is exported, and how it is read from a store and restored to one."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from experiments.outcome import InputData
from experiments.provenance import process_tags
from experiments.tracking import CASES_FILE, METRICS_FILE, ORIGIN_TAG, PARENT_TAG, RunWriter, Store
from experiments.tracking.artifacts import run_file
from experiments.tracking.headline import NOTE_TAG, metrics_text, without_figures
from registration.brief import brief_repr

CONFIG_FILE = "config.yaml"
RESUMED_TAG, KIND_TAG, KINDS_ABOVE = "ctus.resumed", "ctus.kind", ("sweep", "variant")
# The tracker takes 8000 characters.
_IDS_A_TAG = 200


@dataclass(frozen=True)
class RunRecord:
    """Everything of a run that is worth keeping. ``history`` has the columns metric, step, value, timestamp_ms.

    Parameters
    ----------
    run_id : str
        Id of the run.
    experiment : str
        Name of the experiment.
    name : str
        Name of the run.
    status : str
        FINISHED, FAILED or KILLED.
    start_ms : int
        Start in ms since 1970.
    end_ms : int or None
        End in ms since 1970; None if unknown.
    parent_id : str or None
        Id of the run above; None if there is none.
    tags : dict[str, str]
        Tags by name.
    params : dict[str, str]
        Parameters by name.
    config : str
        Resolved configuration as YAML.
    history : pd.DataFrame
        One row a metric, step and value.
    cases : pd.DataFrame or None
        Table of cases; None if there is none.
    metrics : dict[str, float], optional
        All metrics by name, of those as well that the dashboard has no columns for; empty for runs of before.
    inputs : tuple[InputData, ...], optional
        Data sets that the run used, with the beginning of their digests; empty where none is known.
    """

    run_id: str
    experiment: str
    name: str
    status: str
    start_ms: int
    end_ms: int | None
    parent_id: str | None
    tags: dict[str, str]
    params: dict[str, str]
    config: str
    history: pd.DataFrame
    cases: pd.DataFrame | None
    metrics: dict[str, float] = field(default_factory=dict)
    inputs: tuple[InputData, ...] = ()

    __repr__ = brief_repr


def resumed_tags(run_ids: Sequence[str]) -> dict[str, str]:
    """Tags by which a sweep names jobs that an earlier sweep had finished: their runs stand below that one.

    Parameters
    ----------
    run_ids : Sequence[str]
        Ids of these runs.

    Returns
    -------
    dict[str, str]
        Tags; several where one is too short for all.
    """
    parts = [run_ids[first : first + _IDS_A_TAG] for first in range(0, len(run_ids), _IDS_A_TAG)]
    return {f"{RESUMED_TAG}.{number}": ",".join(part) for number, part in enumerate(parts)}


def resumed_ids(tags: Mapping[str, str]) -> list[str]:
    """Read what ``resumed_tags`` wrote.

    Parameters
    ----------
    tags : Mapping[str, str]
        Tags of a run.

    Returns
    -------
    list[str]
        Ids of runs of an earlier sweep that belong to this one as well.
    """
    named = sorted(name for name in tags if name.startswith(f"{RESUMED_TAG}."))
    return [run_id for name in named for run_id in tags[name].split(",") if run_id]


def config_of(text: str) -> dict[str, Any]:
    """Read the resolved configuration of a run.

    Parameters
    ----------
    text : str
        YAML; empty for a run that has lost its files.

    Returns
    -------
    dict[str, Any]
        The configuration as plain data; empty where there is none.
    """
    # In Python the parser is the slowest part of reading many runs; the one in C is not built everywhere.
    found = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return {str(key): value for key, value in found.items()} if isinstance(found, Mapping) else {}


def is_job(tags: Mapping[str, str]) -> bool:
    """Tell whether a run with no run below it computed something, or only stands above jobs of an earlier sweep.

    Parameters
    ----------
    tags : Mapping[str, str]
        Tags of the run.

    Returns
    -------
    bool
        Whether it is a job.
    """
    return tags.get(KIND_TAG) not in KINDS_ABOVE


def last_metrics(record: RunRecord) -> dict[str, float]:
    """Give every metric of a run: its last value in the tracker, and of all that its file has that one.

    Parameters
    ----------
    record : RunRecord
        The run.

    Returns
    -------
    dict[str, float]
        Scalars by name; the tracker has few metrics of a run, its file all, and runs of before have no such file.
    """
    ordered = record.history.sort_values(["step", "timestamp_ms"], kind="stable")
    points = zip(ordered["metric"], ordered["value"], strict=True)
    return {str(name): float(value) for name, value in points} | record.metrics


def read_run(store: Store, run_id: str, experiment: str) -> RunRecord:
    """Read a run of the store with every step of its metrics and its per-case table.

    Parameters
    ----------
    store : Store
        The tracker.
    run_id : str
        Id of the run.
    experiment : str
        Name of the experiment.

    Returns
    -------
    RunRecord
        The run.
    """
    client = store.client()
    run = client.get_run(run_id)
    tags = dict(run.data.tags)
    points = [
        (metric.key, metric.step, metric.value, metric.timestamp) for metric in _all_points(client, run)
    ]
    path = run_file(client, run, CONFIG_FILE)
    config = "" if path is None else path.read_text(encoding="utf-8")
    return RunRecord(
        run_id=tags.pop(ORIGIN_TAG, run_id),
        experiment=experiment,
        name=run.info.run_name,
        status=run.info.status,
        start_ms=run.info.start_time,
        end_ms=run.info.end_time,
        parent_id=store.origin(tags.pop(PARENT_TAG, None)),
        tags=tags,
        params=dict(run.data.params),
        config=config,
        history=pd.DataFrame(points, columns=["metric", "step", "value", "timestamp_ms"]),
        cases=store.cases(run),
        metrics=store.all_metrics(run),
        inputs=recorded_inputs(run),
    )


def _all_points(client: Any, run: Any) -> Iterator[Any]:
    """Every value of a run's metrics; one that stands at step 0 was logged once and is not asked for again."""
    newest = {metric.key: metric for metric in getattr(run.data, "_metric_objs", ())}
    for key in run.data.metrics:
        last = newest.get(key)
        if last is not None and last.step == 0:
            yield last
        else:
            yield from client.get_metric_history(run.info.run_id, key)


def recorded_inputs(run: Any) -> tuple[InputData, ...]:
    """Give the data sets that a run of the store used.

    Parameters
    ----------
    run : mlflow.entities.Run
        The run.

    Returns
    -------
    tuple[InputData, ...]
        The data sets, sorted by name.
    """
    used = run.inputs.dataset_inputs if run.inputs is not None else []
    found = [InputData(each.dataset.name, each.dataset.digest, _source(each.dataset.source)) for each in used]
    return tuple(sorted(found, key=lambda data: (data.name, data.digest, data.source)))


def _source(text: str) -> str:
    """The place of a data set as ``RunWriter.inputs`` wrote it; what another tool wrote stays as it is."""
    try:
        return str(json.loads(text)["uri"])
    except (ValueError, TypeError, KeyError):
        return text


def restore_run(store: Store, record: RunRecord, parent_id: str | None) -> str:
    """Write a run into the store and return its new id there; the tag ``ctus.run_id`` keeps the first one.

    Parameters
    ----------
    store : Store
        The tracker.
    record : RunRecord
        The run to write.
    parent_id : str or None
        Id of the run above; None if there is none.

    Returns
    -------
    str
        Id of the new run.
    """
    tags = {**record.tags, ORIGIN_TAG: record.run_id, **({PARENT_TAG: parent_id} if parent_id else {})}
    if NOTE_TAG in tags:
        tags[NOTE_TAG] = without_figures(tags[NOTE_TAG])
    writer = store.begin_copy(record.experiment, record.name, tags, record.start_ms)
    write_record(writer, record)
    # While it was copied, the run named this process; now it says again who ran it.
    names = process_tags().keys()
    writer.tags({name: record.tags[name] for name in names if name in record.tags})
    writer.drop_tags(name for name in names if name not in record.tags)
    writer.end(record.status, record.end_ms)
    return writer.run_id


def write_record(writer: RunWriter, record: RunRecord) -> None:
    """Log all of a record but its tags and its end.

    Parameters
    ----------
    writer : RunWriter
        The run that is being written.
    record : RunRecord
        The run that it is to become.
    """
    writer.params(record.params)
    columns = ("metric", "value", "timestamp_ms", "step")
    writer.inputs(record.inputs)
    writer.points(zip(*(record.history[column].tolist() for column in columns), strict=True))
    if record.config:
        writer.text(record.config, CONFIG_FILE)
    if record.metrics:
        writer.text(metrics_text(record.metrics), METRICS_FILE)
    if record.cases is not None:
        with tempfile.TemporaryDirectory() as folder:
            record.cases.to_parquet(Path(folder) / CASES_FILE, index=False)
            writer.files(Path(folder), [CASES_FILE])
