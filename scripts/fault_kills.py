"""Commands killed by SIGKILL at random moments, called again, and compared with what was never disturbed."""

from __future__ import annotations

import random
import shutil
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fault_checks import half_written, leftovers, numbers, store_state, tracked
from fault_processes import Command, apart

TRAINING = (
    *("study=segmentation", "dataset=phantom", "dataset.subset=artery", "dataset.sweeps=3", "width=4"),
    *("split.folds=3", "dataset.frames_per_sweep=4", "dataset.size_px=48", "image_size_px=32"),
    *("trainer.max_epochs=3", "trainer.batch_size=4", "fold=0"),
)
# What must not happen, each counted over the attempts of a phase.
HARMS = (
    *("lost runs", "broken stores", "half-written files", "other numbers", "still RUNNING"),
    *("leftovers", "orphan processes", "refused afterwards"),
)


@dataclass(frozen=True)
class Phase:
    """A command to be killed: what stands there before it, its words, and the folder that holds its numbers."""

    name: str
    words: Sequence[str]
    result: str
    template: str = "store"


@dataclass
class Outcome:
    """What became of all attempts of a phase."""

    attempts: int = 0
    before_end: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    said: list[str] = field(default_factory=list)
    jobs_kept: int = 0

    def harm(self, name: str, what: str) -> None:
        """Count a harm and keep its first words."""
        self.counts[name] += 1
        self.said.append(f"{name}: {what}")


PHASES = (
    Phase("store creation", ("study=faults", "parts=[1]", "seconds=0.2"), "out", template="empty"),
    Phase("training", TRAINING, "out"),
    Phase("sweep, a job at a time", ("study=faults", "seconds=0.1"), "out"),
    Phase("sweep, two jobs at a time", ("study=faults", "parts=[1,2]", "seconds=0.3", "jobs=2"), "out"),
    Phase("export_runs", ("study=export_runs",), "results/runs", template="exported"),
    Phase("import_runs", ("study=import_runs",), "results/runs", template="archive"),
    Phase("report", ("study=report", "archive={home}/results/runs"), "results", "archive"),
)
# Attempts of each phase when a hundred are asked for.
SHARES = (10, 12, 26, 5, 18, 20, 9)


class Campaign:
    """The homes that the commands run in: one place, filled from templates, so that no path in a store changes."""

    def __init__(self, work: Path, seed: int) -> None:
        self.work = work
        self.home = work / "home"
        self.seed = seed
        self.logs = 0

    def command(
        self, words: Sequence[str], before: Callable[[], None] | None = None, **environment: str
    ) -> Command:
        """A command in the home, with a log of its own."""
        self.logs += 1
        # "{home}" is the only brace in a word.
        given = [word.replace("{home}", str(self.home)) for word in words]
        return Command(given, self.home, self.work / f"log-{self.logs}.txt", environment, before)

    def fill(self, template: str) -> None:
        """An empty home, or the copy of a template."""
        shutil.rmtree(self.home, ignore_errors=True)
        source = self.work / "templates" / template
        if template == "empty":
            self.home.mkdir(parents=True)
        else:
            shutil.copytree(source, self.home)

    def save(self, template: str) -> None:
        """Keep the home as a template."""
        shutil.rmtree(self.work / "templates" / template, ignore_errors=True)
        shutil.copytree(self.home, self.work / "templates" / template)

    def prepare(self) -> None:
        """Make the templates: a store, one with runs and an archive of some of them, and an archive alone."""
        self.fill("empty")
        self._must("study=faults", "parts=[9]", "seconds=0")
        self.save("store")
        self._must("study=export_runs")
        self._must("study=faults", "parts=[1,2,3]", "seconds=0.01", "out={home}/first")
        self._must(*TRAINING, "out={home}/second")
        self.save("exported")
        self._must("study=export_runs")
        archive = self.work / "archive"
        shutil.rmtree(archive, ignore_errors=True)
        shutil.copytree(self.home / "results" / "runs", archive)
        self.fill("store")
        shutil.copytree(archive, self.home / "results" / "runs")
        self.save("archive")

    def _must(self, *words: str) -> None:
        command = self.command(words)
        if command.run() != 0:
            raise RuntimeError(f"{' '.join(words)}: expected exit code 0, said\n{command.said()[-3000:]}")

    def state(self) -> dict[str, Any]:
        """The store of the home, looked at in another process."""
        return dict(apart(lambda: store_state(self.home), self.work))


def undisturbed(campaign: Campaign, phase: Phase) -> tuple[float, dict[str, str], dict[str, Any]]:
    """Seconds, numbers and tracked metrics of a phase that nothing disturbs."""
    campaign.fill(phase.template)
    command = campaign.command(_words(phase))
    if command.run() != 0:
        raise RuntimeError(f"{phase.name}: expected exit code 0, said\n{command.said()[-3000:]}")
    return command.took_s, numbers(campaign.home / phase.result), tracked(campaign.state())


def _words(phase: Phase) -> list[str]:
    return [*phase.words, *(["out={home}/out"] if phase.result == "out" else [])]


def kill_phase(campaign: Campaign, phase: Phase, attempts: int) -> Outcome:
    """Kill the command of a phase at ``attempts`` random moments, each followed by the same call."""
    took_s, expected, metrics = undisturbed(campaign, phase)
    chance = random.Random(f"{phase.name} {campaign.seed}")
    outcome = Outcome()
    for number in range(attempts):
        campaign.fill(phase.template)
        known = numbers(campaign.home / phase.result)
        command = campaign.command(_words(phase)).start()
        moment_s = chance.uniform(0, took_s)
        time.sleep(moment_s)
        if command.wait(0.01) is None:
            command.kill()
            outcome.before_end += 1
        outcome.attempts += 1
        where = f"{number}, killed at {moment_s:.2f} of {took_s:.2f} s"
        for pid in command.outliving():
            outcome.harm("orphan processes", f"{where}: {pid}")
        _after_kill(campaign, phase, known, outcome, where)
        _after_resume(campaign, phase, expected, metrics, outcome, where)
    return outcome


def _after_kill(
    campaign: Campaign, phase: Phase, known: dict[str, str], outcome: Outcome, where: str
) -> None:
    folder = campaign.home / phase.result
    for name in half_written(folder):
        outcome.harm("half-written files", f"{where}: {name}")
    # What was there before is there, as it was or as the command makes it.
    now = numbers(folder)
    for name in known:
        if name not in now:
            outcome.harm("half-written files", f"{where}: {name} is gone")


def _after_resume(
    campaign: Campaign,
    phase: Phase,
    expected: dict[str, str],
    metrics: dict[str, Any],
    outcome: Outcome,
    where: str,
) -> None:
    before = _finished(campaign)
    command = campaign.command([*_words(phase), "resume=true"])
    if (code := command.run()) != 0:
        outcome.harm("refused afterwards", f"{where}: {code}, {command.said()[-300:]!r}")
        return
    state = compared(campaign, phase.result, expected, outcome, where)
    if state is None:
        return
    found = tracked(state)
    for key in metrics.keys() - found.keys():
        outcome.harm("lost runs", f"{where}: job {key[:8]}")
    for key in metrics.keys() & found.keys():
        if metrics[key] != found[key]:
            outcome.harm("other numbers", f"{where}: metrics of job {key[:8]}")
    _kept_jobs(before, state, outcome, where)


def compared(
    campaign: Campaign, result: str, expected: dict[str, str], outcome: Outcome, where: str
) -> dict[str, Any] | None:
    """Count what is not as after an undisturbed call: numbers, files, store, runs; the store's state if it opens."""
    now = numbers(campaign.home / result)
    if differing := [name for name in sorted({*now, *expected}) if now.get(name) != expected.get(name)]:
        outcome.harm("other numbers", f"{where}: {', '.join(differing[:5])}")
    for name in half_written(campaign.home / result):
        outcome.harm("half-written files", f"{where}: {name} after the next call")
    for name in leftovers(campaign.home):
        outcome.harm("leftovers", f"{where}: {name}")
    try:
        state = campaign.state()
    except RuntimeError as failure:
        outcome.harm("broken stores", f"{where}: {str(failure)[-300:]!r}")
        return None
    if state["whole"] != "ok":
        outcome.harm("broken stores", f"{where}: {state['whole']}")
    for run in state["runs"]:
        if run["status"] == "RUNNING":
            outcome.harm("still RUNNING", f"{where}: {run['kind']} {run['id']}")
    return state


def _finished(campaign: Campaign) -> set[str]:
    """The ids of the finished jobs, if the store is there at all."""
    if not (campaign.home / "mlruns" / "ctus.db").exists():
        return set()
    try:
        runs = campaign.state()["runs"]
    except RuntimeError:
        return set()
    return {run["id"] for run in runs if run["status"] == "FINISHED" and run["kind"] == "job"}


def _kept_jobs(before: set[str], state: dict[str, Any], outcome: Outcome, where: str) -> None:
    """What had finished before the kill must be there, and must not have been computed again."""
    after = [run for run in state["runs"] if run["status"] == "FINISHED" and run["kind"] == "job"]
    for run_id in before - {run["id"] for run in after}:
        outcome.harm("lost runs", f"{where}: finished run {run_id}")
    hashes = Counter(run["hash"] for run in after)
    outcome.jobs_kept += len(before)
    for key, count in hashes.items():
        if count > 1:
            outcome.harm("lost runs", f"{where}: job {key[:8]} finished {count} times")
