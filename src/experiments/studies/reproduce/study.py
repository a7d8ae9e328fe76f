"""Study ``reproduce``: a tracked run, run again from its id in an empty store, and compared number by number."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.analysis.runs.difference import compare_records
from experiments.analysis.runs.rerun import run_again
from experiments.errors import InputError
from experiments.outcome import Outcome, Progress
from experiments.running.config_hash import job_config
from experiments.studies.reproduce import checks, report
from experiments.studies.reproduce.checks import Check
from experiments.studies.reproduce.configuration import (
    Prepared,
    configuration_of,
    prepared,
    with_own_caches,
)
from experiments.studies.reproduce.report import Reproduced, Reproduction
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_lookup import Family, find_family
from experiments.tracking.run_record import RunRecord

# What is run again has a store of its own, and the user's gets nothing.
TRACKED = False


def check(*, tolerance: float) -> None:
    """Check that the tolerance is one.

    Parameters
    ----------
    tolerance : float
        Largest difference that counts as equal.

    Raises
    ------
    InputError
        If it is negative or no number.
    """
    if not 0 <= tolerance < float("inf"):
        raise InputError(f"tolerance: expected a number from 0, received {tolerance!r}")


def run(
    *,
    run: str,
    archive: str | None,
    tolerance: float,
    data_root: str | None,
    force: bool,
    store: Store,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Run a tracked run again and compare it with what was tracked.

    Of a sweep all jobs are run again, and the numbers of the sweep compared as well. Everything is in a project of its
    own that is deleted afterwards: no result, image or training that was kept from before is taken.

    Parameters
    ----------
    run : str
        Id of a run, or the first characters of it.
    archive : str or None
        Folder of exported runs; None for the tracker.
    tolerance : float
        Largest difference that counts as equal: absolute up to a size of 1, relative above; 0 asks for the same bits.
    data_root : str or None
        Folder that holds what the run read, where it lies elsewhere now; None for the paths as they were.
    force : bool
        Whether to go on where code, packages or files are not those of the run.
    store : Store
        The tracker.
    workspace : Path
        Folder of the job; ``reproduction.json`` and the new runs under ``runs`` are left in it.
    progress : Progress
        Receives notes.

    Returns
    -------
    Outcome
        ``equal`` and counts, tables of what differs, findings; refused where a number is not the same.

    Raises
    ------
    InputError
        If there is no such run, it has no result, or it can't be run again here.
    """
    family = find_family(run, store, None if archive is None else Path(archive).expanduser())
    whole, originals = _complete(family)
    root = None if data_root is None else Path(data_root).expanduser().absolute()
    if root is not None and not root.is_dir():
        raise InputError(f"data_root: expected a folder, received {data_root}")
    jobs = [prepared(record, root) for record in originals]
    found = _checks_before(originals, jobs)
    if (differing := checks.differing(found)) and not force:
        raise InputError(
            f"run {family.run.run_id[:12]}: equal numbers can't be expected here: {'; '.join(differing)}. Check out "
            "that commit with those packages and that data, or pass force=true to go on and have it reported"
        )
    progress.note(
        f"running {len(jobs)} {'job' if len(jobs) == 1 else 'jobs'} of {family.run.experiment} again"
    )
    points = _points(jobs, workspace / ".project")
    sweep = whole and bool(family.below)
    again = run_again(points, workspace / ".project", sweep=sweep)
    matched = _matched(originals, [config for config, _ in points], again)
    if sweep:
        matched += _sums(family, again)
    pairs = [
        Reproduced(old, new, None if new is None else compare_records(old, new, tolerance))
        for old, new in matched
    ]
    found += _data_checks(family, again, matched)
    done = Reproduction(family, tuple(pairs), tuple(dict.fromkeys(found)), tolerance, whole)
    write_archive([again.run, *again.below], workspace / "runs")
    shutil.rmtree(workspace / ".project")
    return report.outcome(done)


def _complete(family: Family) -> tuple[bool, list[RunRecord]]:
    """Whether all jobs of a run finished, and those that did."""
    top = family.run
    if top.status != "FINISHED" and not family.below:
        raise InputError(
            f"run {top.run_id[:12]}: expected a run that finished, found one that is {top.status}: it has no result"
        )
    finished = [record for record in family.jobs if record.status == "FINISHED"]
    if not finished:
        raise InputError(f"run {top.run_id[:12]}: expected a sweep with finished jobs, found none below it")
    planned = report.last_value(top, "jobs")
    return top.status == "FINISHED" and planned in (None, len(finished)), finished


def _checks_before(originals: Sequence[RunRecord], jobs: Sequence[Prepared]) -> list[Check]:
    found = [check for record in originals for check in checks.code_checks(record)]
    found += [
        check
        for record, job in zip(originals, jobs, strict=True)
        for check in checks.configuration_checks(record, job)
    ]
    return found


def _data_checks(
    family: Family, again: Family, matched: Sequence[tuple[RunRecord, RunRecord | None]]
) -> list[Check]:
    return [
        check
        for old, new in matched
        if new is not None
        for check in checks.data_checks(
            checks.recorded_digests(old, family.digests.get(old.run_id, {})),
            checks.recorded_digests(new, again.digests.get(new.run_id, {})),
        )
    ]


def _points(jobs: Sequence[Prepared], project: Path) -> list[tuple[dict[str, Any], str]]:
    """The sweep points to run, with as many jobs at a time as they had, but no more than there are cores."""
    project.mkdir(parents=True)
    asked = jobs[0].config.get("jobs", 1)
    at_once = min(asked, os.cpu_count() or 1) if isinstance(asked, int) else 1
    return [({**with_own_caches(job.config, project / ".cache"), "jobs": at_once}, job.label) for job in jobs]


def _matched(
    originals: Sequence[RunRecord], configs: Sequence[dict[str, Any]], again: Family
) -> list[tuple[RunRecord, RunRecord | None]]:
    """Each original with the run that has its configuration; None where that did not finish."""
    new = {_key(configuration_of(record)): record for record in again.jobs if record.status == "FINISHED"}
    return [(old, new.get(_key(config))) for old, config in zip(originals, configs, strict=True)]


def _sums(family: Family, again: Family) -> list[tuple[RunRecord, RunRecord | None]]:
    """The sweep and, between it and its jobs, the runs that sum up some of them, each with its like by name."""
    new = {record.name: record for record in again.above}
    inner = [(old, new.get(old.name)) for old in family.above if old is not family.run]
    return [*inner, (family.run, again.run)]


def _key(config: dict[str, Any]) -> str:
    return json.dumps(job_config(config), sort_keys=True)
