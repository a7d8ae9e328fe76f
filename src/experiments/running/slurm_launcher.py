"""The jobs of one call on a cluster that Slurm runs: sent as arrays, watched until each has ended, one sweep as ever.

The process that sent them waits for them. Ctrl-C or SIGTERM there has Slurm end them; where it is killed outright they
keep running (``experiments.running.sent_arrays``).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from experiments.masking import masked
from experiments.provenance import SLURM_TAG
from experiments.running import array_task, run_job, sent_arrays, slurm_queue, terminal, worker
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import Launched
from experiments.running.run_job import Report
from experiments.running.slurm_queue import SlurmState
from experiments.running.slurm_settings import SlurmSettings
from experiments.running.terminal import TerminalProgress, plain_console

# A network file system shows a report some seconds after the job that wrote it has ended.
LATE_S = 10.0
TIME_TO_END_S = 60.0


@dataclass
class Sent:
    """A job that is in the queue, or was.

    Parameters
    ----------
    job : Job
        The job.
    folder : Path
        Folder of the plan that it was sent with, where it leaves its report.
    id : str
        Its id in Slurm.
    missing_since : float or None, optional
        When it had first ended without a report, in s of the monotonic clock.
    """

    job: Job
    folder: Path
    id: str
    missing_since: float | None = None

    @property
    def report(self) -> Path:
        """File of its report."""
        return run_job.report_file(self.folder, self.job.hash)


@dataclass(frozen=True)
class SlurmLauncher:
    """Runs every job as a job of Slurm.

    Parameters
    ----------
    settings : SlurmSettings
        What each job asks for.
    progress : TerminalProgress, optional
        Where the state of the queue is shown.
    """

    settings: SlurmSettings
    progress: TerminalProgress = field(default_factory=lambda: TerminalProgress(plain_console()))

    def run(self, planned: Sequence[Job], plan: Plan) -> Launched:
        """Run all jobs to their end.

        Jobs that have a finished run and are resumed are not sent; those that an earlier call left in the queue are
        waited for.

        Parameters
        ----------
        planned : sequence of Job
            The jobs, in the order in which they are sent.
        plan : Plan
            The plan of the call.

        Returns
        -------
        Launched
            The report of every job, also of one that was killed.
        """
        reports = self._resumed(planned, plan)
        left = sent_arrays.of_orphans(planned)
        taken = [Sent(job, *left[job.hash]) for job in planned if job.hash in left]
        reports_of_taken, processes = self._watched(taken, plan) if taken else ({}, {})
        reports |= reports_of_taken
        rest = [job for job in planned if job.hash not in reports]
        size = self.settings.array_size
        for start in range(0, len(rest), size):
            more, known = self._sent(rest[start : start + size], plan)
            reports |= more
            processes |= known
        return Launched(reports, processes=processes)

    def _resumed(self, planned: Sequence[Job], plan: Plan) -> dict[str, Report]:
        """The jobs that have a finished run, which need not wait in a queue to find that out."""
        found = {}
        for job in planned:
            report = run_job.resumed(job, plan, worker.store_of(job.config))
            if report is not None:
                self.progress.note(f"{job.label}: already finished, run {str(report.run_id)[:8]}")
                found[job.hash] = report
        return found

    def _sent(
        self, jobs: Sequence[Job], plan: Plan
    ) -> tuple[dict[str, Report], dict[str, Mapping[str, str]]]:
        with sent_arrays.folder(plan) as folder:
            for job in jobs:
                worker.write_job(job, folder)
            secret = worker.tracker_secret(jobs[0].config)
            name = f"ctus-{plan.study}"
            ids = array_task.submit([job.hash for job in jobs], folder, self.settings, name, secret)
            try:
                sent_arrays.write(folder, {job.hash: one for job, one in zip(jobs, ids, strict=True)})
                sent = [Sent(job, folder, one) for job, one in zip(jobs, ids, strict=True)]
                return self._watched(sent, plan)
            except BaseException:
                _end(ids, self.settings.poll_s)
                raise

    def _watched(
        self, sent: Sequence[Sent], plan: Plan
    ) -> tuple[dict[str, Report], dict[str, Mapping[str, str]]]:
        """Wait until all have ended, and collect their reports."""
        reports: dict[str, Report] = {}
        said, last = "", -terminal.LINE_EVERY_S
        while waiting := [one for one in sent if one.job.hash not in reports]:
            states = slurm_queue.states(one.id for one in waiting)
            for one in waiting:
                report = _report(one, None if states is None else states[one.id], plan)
                if report is not None:
                    reports[one.job.hash] = report
            over, now = len(reports) == len(sent), _line(sent, reports, states)
            if now != said and (over or time.monotonic() - last >= terminal.LINE_EVERY_S):
                said, last = now, time.monotonic()
                self.progress.note(said)
            if not over:
                time.sleep(self.settings.poll_s)
        return reports, {one.job.hash: {SLURM_TAG: one.id} for one in sent}


def _report(one: Sent, state: SlurmState | None, plan: Plan) -> Report | None:
    """The report of a job that has ended; written here of one that could not write it."""
    if one.report.is_file():
        report = Report.read(one.report)
        if report.message:
            print(f"{one.job.label or plan.study}: {report.message}", file=sys.stderr)
        return report
    if state is None or not state.ended:
        one.missing_since = None
        return None
    now = time.monotonic()
    one.missing_since = now if one.missing_since is None else one.missing_since
    if now - one.missing_since < LATE_S:
        return None
    last = array_task.last_words(one.folder, one.id)
    message = masked(f"Slurm job {one.id} ended before the job did: {state}" + (f"\n{last}" if last else ""))
    print(f"{one.job.label or plan.study}: {message}", file=sys.stderr)
    where = str(plan.folder_of(one.job.hash))
    return Report(one.job.hash, one.job.label, "failed", where, message=message)


def _line(
    sent: Sequence[Sent], reports: Mapping[str, Report], states: Mapping[str, SlurmState] | None
) -> str:
    arrays = ", ".join(dict.fromkeys(one.id.split("_")[0] for one in sent))
    if states is None:
        return f"Slurm {arrays}: no answer, waiting for {len(sent) - len(reports)} of {len(sent)} jobs"
    open_ids = [one.id for one in sent if one.job.hash not in reports]
    words = [states[one].state.lower() for one in open_ids]
    counts = [f"{words.count(word)} {word}" for word in sorted(set(words))]
    return f"Slurm {arrays}: {', '.join([f'{len(reports)} of {len(sent)} jobs over', *counts])}"


def _end(ids: Sequence[str], poll_s: float) -> None:
    """Have Slurm end jobs, and give them the time to end their runs as FAILED."""
    print(f"Cancelling {len(ids)} jobs of Slurm ({ids[0].split('_')[0]}).", file=sys.stderr)
    slurm_queue.cancel(list(dict.fromkeys(one.split("_")[0] for one in ids)))
    deadline = time.monotonic() + TIME_TO_END_S
    while time.monotonic() < deadline:
        states = slurm_queue.states(ids)
        if states is not None and all(state.ended for state in states.values()):
            return
        time.sleep(min(poll_s, 1.0))
