"""What calls have sent to Slurm: known to later calls, as jobs outlive a call that was killed.

Every array has a folder under the project's ``.cache/plans`` with the plan, the jobs' reports and logs, and the ids in
Slurm. The call that sent it removes it at the end. Where the call was killed, the array keeps running: with
``resume=true`` a call of the same jobs waits for it, any other is refused, so that no job is computed twice at a time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from experiments.errors import InputError
from experiments.files import write_text
from experiments.provenance import is_gone, process_tags
from experiments.running import slurm_queue
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import plan_folder, plans_folder, remove_plan

_PREFIX = "slurm-"
_IDS = "array.json"


@dataclass(frozen=True)
class SentArray:
    """An array that a call has sent.

    Parameters
    ----------
    folder : Path
        Its folder.
    jobs : mapping of str to str
        Ids in Slurm by the hash of the job.
    orphaned : bool
        Whether the call that sent it is gone.
    """

    folder: Path
    jobs: Mapping[str, str]
    orphaned: bool


def folder(plan: Plan) -> AbstractContextManager[Path]:
    """Make a folder for the plan of an array, which later calls know where this one was killed.

    Parameters
    ----------
    plan : Plan
        The plan, which is written into the folder.

    Returns
    -------
    AbstractContextManager of Path
        The folder; it is removed once the call has collected what the jobs left.
    """
    return plan_folder(plan, f"{_PREFIX}{plan.study}-")


def write(folder: Path, ids: Mapping[str, str]) -> None:
    """Record what was sent, and by which process.

    Parameters
    ----------
    folder : Path
        Folder of the array.
    ids : mapping of str to str
        Ids in Slurm by the hash of the job.
    """
    write_text(folder / _IDS, json.dumps({"jobs": dict(ids), "process": process_tags()}))


def require_free(planned: Sequence[Job], *, waits: bool) -> None:
    """Refuse a call of jobs that are in Slurm's queue already; tidy up after calls that are gone.

    Parameters
    ----------
    planned : sequence of Job
        Jobs of the call.
    waits : bool
        Whether the call waits for jobs that a call which is gone has left in the queue.

    Raises
    ------
    InputError
        If such a job is under way and is not waited for.
    """
    wanted = {job.hash for job in planned}
    for array in _living():
        common = [array.jobs[key] for key in array.jobs if key in wanted]
        if not common or (array.orphaned and waits):
            continue
        remedy = (
            "launcher=slurm resume=true waits for them"
            if array.orphaned
            else "the call that sent them waits for them"
        )
        raise InputError(
            f"{len(common)} of {len(planned)} jobs of this call are in the queue of Slurm (job "
            f"{common[0].split('_')[0]}): expected jobs that nobody computes; {remedy}, "
            f"scancel {common[0].split('_')[0]} ends them"
        )


def of_orphans(planned: Sequence[Job]) -> dict[str, tuple[Path, str]]:
    """Find the jobs of a call that a call which is gone has left in the queue.

    Parameters
    ----------
    planned : sequence of Job
        Jobs of the call.

    Returns
    -------
    dict of str to (Path, str)
        Folder of the array and id in Slurm by the hash of the job.
    """
    wanted = {job.hash for job in planned}
    return {
        key: (array.folder, one)
        for array in _living()
        if array.orphaned
        for key, one in array.jobs.items()
        if key in wanted
    }


def _living() -> Iterator[SentArray]:
    """The arrays with the jobs of each that have not ended; folders of those that are over are removed."""
    for path in sorted(plans_folder().glob(f"{_PREFIX}*/{_IDS}")):
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            jobs, process = dict(content["jobs"]), dict(content["process"])
        except (OSError, ValueError, KeyError, TypeError):  # removed by another call at this moment
            continue
        states = slurm_queue.states(jobs.values())
        if states is None:
            raise InputError(
                f"launcher: expected an answer of Slurm on the jobs that {path.parent} is of, received none; "
                "remove that folder if they are over"
            )
        gone = is_gone(process)
        living = {key: one for key, one in jobs.items() if not states[one].ended}
        if gone and not living:
            remove_plan(path.parent)
        elif living:
            yield SentArray(path.parent, living, gone)
