"""One job of an array, as submitit carries it to its node: what is sent, and how it is run there, also once more."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError
from experiments.running import worker
from experiments.running.slurm_settings import SlurmSettings

if TYPE_CHECKING:
    from submitit.core.utils import DelayedSubmission

# Where submitit keeps what it sends and what the jobs print, in the folder of the plan.
LOGS = "slurm"
# What a call that is itself a job of Slurm must not hand on: its jobs would take its allocation for theirs.
_OF_A_JOB = ("SLURM_", "SLURMD_", "SRUN_", "SBATCH_", "SUBMITIT_")
_OF_THE_CLUSTER = ("SLURM_CONF",)


class TimeLimitError(RuntimeError):
    """Slurm is about to end a job, and it is not queued again."""


@dataclass(frozen=True)
class ArrayTask:
    """A job of a plan that lies in a folder which its node sees.

    Parameters
    ----------
    folder : str
        Folder of the plan.
    key : str
        The job's hash.
    """

    folder: str
    key: str

    def __call__(self) -> int:
        """Run the job; one that was queued again goes on with what it has done.

        Returns
        -------
        int
            The exit code of the worker: 0.
        """
        again = int(os.environ.get("SLURM_RESTART_COUNT", "0") or 0) > 0
        with _named_time_limit():
            return worker.main([self.folder, self.key], again=again)

    def checkpoint(self) -> DelayedSubmission:
        """Say what is to be run when the job is queued again: the same.

        Returns
        -------
        DelayedSubmission
            What submitit writes for the next attempt.
        """
        from submitit.core.utils import DelayedSubmission

        return DelayedSubmission(self)


def submit(
    keys: Sequence[str], folder: Path, settings: SlurmSettings, name: str, environment: Mapping[str, str]
) -> list[str]:
    """Send jobs to Slurm, several as an array.

    Parameters
    ----------
    keys : sequence of str
        Hashes of the jobs.
    folder : Path
        Folder of the plan, which holds their configurations.
    settings : SlurmSettings
        What each asks for.
    name : str
        Name of the jobs in the queue.
    environment : mapping of str to str
        What the jobs get besides the environment of the call.

    Returns
    -------
    list of str
        Id of each job.

    Raises
    ------
    InputError
        If submitit is not installed or Slurm takes no such jobs.
    """
    submitit = _submitit()
    with _environment_of_jobs(settings, environment):
        # -P: a folder called models where the call was made is none of ours.
        python = f"{shlex.quote(sys.executable)} -P"
        place, requeues = folder / LOGS, settings.timeout_requeues
        executor = submitit.SlurmExecutor(place, max_num_timeout=requeues, python=python)
        executor.update_parameters(**settings.parameters(name))
        try:
            # submitit prints what a refusal said; it is in the refusal too.
            with contextlib.redirect_stderr(io.StringIO()):
                sent = executor.submit_array([ArrayTask(str(folder), key) for key in keys])
        except submitit.core.utils.FailedJobError as refusal:
            said = [line for line in str(refusal).splitlines() if line.startswith("sbatch: error")]
            reason = "; ".join(said) or str(refusal).strip().splitlines()[-1]
            raise InputError(f"launcher: expected jobs that Slurm takes, received: {reason}") from refusal
    return [str(job.job_id) for job in sent]


def require_submitit() -> None:
    """Refuse to go on where submitit is not installed.

    Raises
    ------
    InputError
        If it is not.
    """
    _submitit()


def last_words(folder: Path, job_id: str, lines: int = 3) -> str:
    """Read the end of what a job and Slurm have written to its error log.

    Parameters
    ----------
    folder : Path
        Folder of the plan.
    job_id : str
        Id of the job.
    lines : int, optional
        How many lines at most.

    Returns
    -------
    str
        The lines; empty where there is no log.
    """
    try:
        text = (folder / LOGS / f"{job_id}_0_log.err").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    said = [line for line in text.splitlines() if line.strip() and not line.startswith("submitit ")]
    return "\n".join(said[-lines:])


def _submitit() -> Any:
    try:
        import submitit
        import submitit.core.utils
    except ImportError as missing:
        raise InputError(
            "launcher: expected submitit, which hands jobs to Slurm, to be installed (pip install 'ctus[slurm]'), "
            f"received: {missing}"
        ) from missing
    return submitit


@contextlib.contextmanager
def _environment_of_jobs(settings: SlurmSettings, more: Mapping[str, str]) -> Iterator[None]:
    """The environment that jobs get: that of the call, with as many threads as a job has cores."""
    before = dict(os.environ)
    inside = "SLURM_JOB_ID" in os.environ
    for name in before:
        if name == worker.PARENT or (inside and name.startswith(_OF_A_JOB) and name not in _OF_THE_CLUSTER):
            del os.environ[name]
    for name in worker.THREAD_SETTINGS:
        os.environ.setdefault(name, str(settings.cpus))
    os.environ.update(more)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextlib.contextmanager
def _named_time_limit() -> Iterator[None]:
    """Name the time limit where submitit's own handler of Slurm's warning gives a job up."""
    number = signal.SIGUSR2
    before = signal.getsignal(number)
    if not callable(before):
        yield
        return

    def warned(received: int, frame: Any) -> None:
        from submitit.core.utils import UncompletedJobError

        try:
            before(received, frame)
        except UncompletedJobError as over:
            raise TimeLimitError(
                "TIMEOUT: the job took longer than launcher.timeout_min and is not queued again "
                "(launcher.timeout_requeues)"
            ) from over

    signal.signal(number, warned)
    try:
        yield
    finally:
        signal.signal(number, before)
