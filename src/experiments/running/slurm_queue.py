"""What Slurm says of jobs: where they stand in the queue, and why they ended.

The controller is asked first: it knows a job for some minutes after its end (MinJobAge), on every cluster. What it has
forgotten is looked up in the accounting, which not every cluster has.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from experiments.errors import InputError

# States in which a job is over and will not begin again by itself.
ENDED = frozenset(
    {
        *("BOOT_FAIL", "CANCELLED", "COMPLETED", "DEADLINE", "FAILED", "LAUNCH_FAILED", "NODE_FAIL"),
        *("OUT_OF_MEMORY", "PREEMPTED", "RECONFIG_FAIL", "REVOKED", "TIMEOUT"),
    }
)
# A job that neither the controller nor the accounting knows any more.
FORGOTTEN = "UNKNOWN"
_MEANING = {
    "OUT_OF_MEMORY": "it took more memory than launcher.memory_gb",
    "TIMEOUT": "it took longer than launcher.timeout_min",
    "NODE_FAIL": "its node failed",
    "BOOT_FAIL": "its node did not start",
    "CANCELLED": "somebody cancelled it",
    "PREEMPTED": "it had to give way to other jobs",
    "DEADLINE": "its deadline was over",
    FORGOTTEN: "Slurm no longer knows it",
}
_ANSWER_S = 60
_MOST_A_CALL = 100


@dataclass(frozen=True)
class SlurmState:
    """Where a job stands.

    Parameters
    ----------
    state : str
        Slurm's word, such as ``RUNNING`` or ``TIMEOUT``.
    exit_code : int, optional
        What its command returned.
    signal : int, optional
        Number of the signal that ended its command; 0 for none.
    """

    state: str
    exit_code: int = 0
    signal: int = 0

    @property
    def ended(self) -> bool:
        """Whether the job is over."""
        return self.state in ENDED or self.state == FORGOTTEN

    def __str__(self) -> str:
        """Slurm's word, and what it means."""
        # A shell, and srun with it, says 128 and the signal's number of a process that a signal ended.
        number = self.signal or (self.exit_code - 128 if self.exit_code > 128 else 0)
        meaning = _MEANING.get(self.state)
        how = f"killed by signal {number}" if number else f"exit code {self.exit_code}"
        return f"{self.state} ({meaning or how})"


def require_slurm() -> None:
    """Refuse to go on where there is no Slurm.

    Raises
    ------
    InputError
        If a command of Slurm is missing.
    """
    missing = [name for name in ("sbatch", "srun", "scontrol", "scancel") if shutil.which(name) is None]
    if missing:
        raise InputError(
            f"launcher: expected a machine that Slurm takes jobs from (sbatch, srun, scontrol, scancel), "
            f"found no {', '.join(missing)}"
        )


def states(ids: Iterable[str]) -> dict[str, SlurmState] | None:
    """Ask where jobs stand.

    Parameters
    ----------
    ids : iterable of str
        Ids of jobs, those of an array as ``<array>_<number>``.

    Returns
    -------
    dict of str to SlurmState or None
        The state of every job; None while Slurm does not answer.
    """
    wanted = set(ids)
    found: dict[str, SlurmState] = {}
    for main in sorted({each.split("_")[0] for each in wanted}):
        answer = _said(["scontrol", "--oneliner", "show", "job", main])
        if answer is None:
            return None
        found |= read_controller(answer)
    if missing := sorted(wanted - found.keys()):
        found |= read_accounting(_accounting(missing))
    return {each: found.get(each, SlurmState(FORGOTTEN)) for each in wanted}


def cancel(ids: Sequence[str]) -> None:
    """Have Slurm end jobs, those that wait and those that run.

    Parameters
    ----------
    ids : sequence of str
        Ids of jobs.
    """
    for start in range(0, len(ids), _MOST_A_CALL):
        words = ["scancel", *ids[start : start + _MOST_A_CALL]]
        subprocess.run(words, capture_output=True, timeout=_ANSWER_S, check=False)


def read_controller(text: str) -> dict[str, SlurmState]:
    """Read the answer of ``scontrol --oneliner show job``.

    Parameters
    ----------
    text : str
        A line a job; those of an array that still wait share one.

    Returns
    -------
    dict of str to SlurmState
        States by id.
    """
    found: dict[str, SlurmState] = {}
    for line in text.splitlines():
        fields = dict(re.findall(r"(?:^|\s)(JobId|ArrayJobId|ArrayTaskId|JobState|ExitCode)=(\S*)", line))
        if "JobId" not in fields or "JobState" not in fields:
            continue
        code, _, number = fields.get("ExitCode", "0:0").partition(":")
        state = SlurmState(fields["JobState"].split(",")[0], int(code or 0), int(number or 0))
        if "ArrayTaskId" not in fields:
            found[fields["JobId"]] = state
        for task in _numbers(fields.get("ArrayTaskId", "")):
            found[f"{fields['ArrayJobId']}_{task}"] = state
    return found


def read_accounting(text: str) -> dict[str, SlurmState]:
    """Read the answer of ``sacct --parsable2 --noheader --format=JobID,State,ExitCode``.

    Parameters
    ----------
    text : str
        A line a job and a line each of its steps.

    Returns
    -------
    dict of str to SlurmState
        States by id.
    """
    found = {}
    for line in text.splitlines():
        identity, state, code = (*line.split("|"), "", "")[:3]
        if not state or "." in identity:
            continue
        exit_code, _, number = code.partition(":")
        main, _, tasks = identity.partition("_")
        # "CANCELLED by 1000"
        read = SlurmState(state.split()[0], int(exit_code or 0), int(number or 0))
        for each in [f"{main}_{task}" for task in _numbers(tasks.strip("[]"))] or [main]:
            found[each] = read
    return found


def _numbers(text: str) -> list[int]:
    """The numbers of ``3``, ``0-2,5`` or ``4-7%2``."""
    found: list[int] = []
    for part in text.partition("%")[0].split(","):
        first, _, last = part.partition("-")
        if first.isdecimal():
            found += range(int(first), int(last or first) + 1)
    return found


def _accounting(ids: Sequence[str]) -> str:
    mains = ",".join(sorted({each.split("_")[0] for each in ids}))
    words = [
        "sacct",
        "--parsable2",
        "--noheader",
        "--array",
        "--format=JobID,State,ExitCode",
        f"--jobs={mains}",
    ]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=_ANSWER_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout if done.returncode == 0 else ""


def _said(words: Sequence[str]) -> str | None:
    """What the controller answers; empty where it no longer knows the job, None where it does not answer."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=_ANSWER_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    if done.returncode == 0:
        return done.stdout
    return "" if "Invalid job id" in done.stderr else None
