"""Faults of what a command stands on: the disk, the store's folder and database, the clock, and many writers."""

from __future__ import annotations

import random
import shutil
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fault_checks import half_written, numbers, tracked
from fault_kills import Campaign, Outcome, compared

SWEEP = ("study=faults", "parts=[1,2,3]", "seconds=0.1", "out={home}/out")
BIG = (*SWEEP, "size_kb=500")
WRITERS = 32


class NotTried(RuntimeError):  # noqa: N818
    """The fault can't be brought about here."""


def _shell(*words: object) -> None:
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotTried(f"{words[0]}: {done.stderr.strip()[:120]}")


@contextmanager
def mounted(place: Path, *options: object) -> Iterator[None]:
    """A mount that is taken away again; ``NotTried`` where that needs rights that are not there."""
    _shell("mount", *options, place)
    try:
        yield
    finally:
        _shell("umount", "-l", place)


def expected(campaign: Campaign, words: tuple[str, ...]) -> tuple[dict[str, str], dict]:
    """Numbers and tracked metrics of a sweep that nothing disturbs."""
    campaign.fill("store")
    command = campaign.command(words)
    if command.run() != 0:
        raise RuntimeError(command.said()[-2000:])
    return numbers(campaign.home / "out"), tracked(campaign.state())


def after(campaign: Campaign, words: tuple[str, ...], truth: tuple, outcome: Outcome, where: str) -> None:
    """Call once more with ``resume=true`` and count what is not as if nothing had happened."""
    command = campaign.command([*words, "resume=true"])
    if (code := command.run()) != 0:
        outcome.harm("refused afterwards", f"{where}: {code}, {command.said()[-300:]!r}")
        return
    compare(campaign, truth, outcome, where)


def compare(campaign: Campaign, truth: tuple, outcome: Outcome, where: str) -> None:
    """Count what is not as in an undisturbed call."""
    state = compared(campaign, "out", truth[0], outcome, where)
    if state is not None and tracked(state) != truth[1]:
        outcome.harm("lost runs", f"{where}: {sorted(tracked(state))} are not {sorted(truth[1])}")


def full_disk(campaign: Campaign, attempts: int) -> Outcome:
    """The project on a small file system that is full at some point; then it gets room."""
    truth, outcome = expected(campaign, BIG), Outcome()
    chance = random.Random(f"disk {campaign.seed}")
    used_kb = sum(path.stat().st_size for path in campaign.home.rglob("*") if path.is_file()) // 1024
    campaign.fill("store")
    least_kb = sum(path.stat().st_size for path in campaign.home.rglob("*") if path.is_file()) // 1024
    for number in range(attempts):
        campaign.fill("empty")
        size_kb = chance.randint(least_kb + 100, used_kb)
        with mounted(campaign.home, "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs"):
            shutil.copytree(campaign.work / "templates" / "store", campaign.home, dirs_exist_ok=True)
            command = campaign.command(BIG)
            code = command.run()
            outcome.attempts += 1
            outcome.before_end += code != 0 or "efused" in command.said()
            where = f"{number}, {size_kb} kB"
            if "Traceback" in command.said() and "No space left" not in command.said():
                outcome.harm("refused afterwards", f"{where}: {command.said()[-200:]!r}")
            for name in half_written(campaign.home / "out"):
                outcome.harm("half-written files", f"{where}: {name}")
            _shell("mount", "-o", "remount,size=500m", campaign.home)
            after(campaign, BIG, truth, outcome, where)
    return outcome


def read_only(campaign: Campaign, attempts: int) -> Outcome:
    """The folder of the store is mounted so that nobody can write there; then it can be written again."""
    truth, outcome = expected(campaign, SWEEP), Outcome()
    for number in range(attempts):
        campaign.fill("store")
        place = campaign.home / "mlruns"
        with mounted(place, "--bind", place):
            _shell("mount", "-o", "remount,ro,bind", place)
            command = campaign.command(SWEEP)
            code = command.run()
            outcome.attempts += 1
            outcome.before_end += code != 0 or "efused" in command.said()
            if "Traceback" in command.said():
                outcome.harm("refused afterwards", f"{number}: {command.said()[-200:]!r}")
        after(campaign, SWEEP, truth, outcome, str(number))
    return outcome


def locked(campaign: Campaign, attempts: int) -> Outcome:
    """Another process holds the database's lock for some seconds in the middle of a sweep."""
    truth, outcome = expected(campaign, SWEEP), Outcome()
    chance = random.Random(f"lock {campaign.seed}")
    for number in range(attempts):
        campaign.fill("store")
        command = campaign.command(SWEEP).start()
        time.sleep(chance.uniform(0.3, 1.5))
        held_s = chance.choice((2.0, 12.0))
        other = sqlite3.connect(campaign.home / "mlruns" / "ctus.db", timeout=5, isolation_level=None)
        try:
            other.execute("BEGIN EXCLUSIVE")
            outcome.before_end += command.wait(0.01) is None
            time.sleep(held_s)
            other.execute("ROLLBACK")
        finally:
            other.close()
        command.finish()
        outcome.attempts += 1
        after(campaign, SWEEP, truth, outcome, f"{number}, held {held_s:g} s, {command.said()[-200:]!r}")
    return outcome


def clock(campaign: Campaign, attempts: int) -> Outcome:
    """The clock is set back by hours in the middle of a sweep that is then killed, and before it is resumed."""
    truth, outcome = expected(campaign, SWEEP), Outcome()
    chance = random.Random(f"clock {campaign.seed}")
    for number in range(attempts):
        campaign.fill("store")
        back_s = chance.uniform(600, 40_000)
        command = campaign.command(SWEEP, before=set_back(back_s, chance.uniform(0.0, 1.0))).start()
        if number % 2:
            time.sleep(chance.uniform(0.5, 1.5))
            if command.wait(0.01) is None:
                command.kill()
        else:
            command.finish()
        outcome.before_end += 1
        outcome.attempts += 1
        again = campaign.command([*SWEEP, "resume=true"], before=set_back(2 * back_s, 0.0))
        if (code := again.run()) != 0:
            outcome.harm("refused afterwards", f"{number}: {code}, {again.said()[-300:]!r}")
            continue
        compare(campaign, truth, outcome, f"{number}, {back_s:.0f} s back")
    return outcome


def set_back(by_s: float, after_s: float) -> Callable[[], None]:
    """What sets the clock of a process back, some time after it has begun."""

    def patch() -> None:
        real, begun_s = time.time, time.monotonic()
        time.time = lambda: real() - (by_s if time.monotonic() - begun_s >= after_s else 0.0)

    return patch


def writers(campaign: Campaign, attempts: int) -> Outcome:
    """So many commands at the same time, all into one SQLite file; each logs its run and its metrics."""
    outcome = Outcome()
    for number in range(attempts):
        campaign.fill("store")
        commands = [
            campaign.command(["study=faults", f"parts=[{part}]", "seconds=0.2", f"out={{home}}/out/{part}"])
            for part in range(WRITERS)
        ]
        for command in commands:
            command.start()
        for part, command in enumerate(commands):
            if command.wait(300.0) != 0 or "efused" in command.said():
                outcome.harm("lost runs", f"{number}, part {part}: {command.said()[-200:]!r}")
        outcome.attempts += 1
        outcome.before_end += 1
        state = campaign.state()
        complete = [run for run in state["runs"] if run["status"] == "FINISHED" and whole(run)]
        if len(complete) != WRITERS + 1:  # the store has one run of before
            bad = [run for run in state["runs"] if run not in complete]
            shown = [(run["kind"], run["status"], run["steps"], run["files"]) for run in bad]
            outcome.harm(
                "lost runs", f"{number}: {len(complete) - 1} of {WRITERS} runs are complete, not {shown}"
            )
    return outcome


def whole(run: dict) -> bool:
    """Whether every metric and every file of a run of the campaign's study is there."""
    return (
        run["steps"].get("train_loss") == 5
        and {"value_mean", "part_used"} <= set(run["metrics"])
        and {"cases.parquet", "config.yaml", "metrics.json", "numbers.bin"} <= set(run["files"])
    )


FAULTS = {
    "full disk": (full_disk, 6, "a tmpfs that is full at a random point, then enlarged"),
    "read-only store": (read_only, 2, "the folder of the store bind-mounted read-only, then writable again"),
    "locked database": (locked, 4, "BEGIN EXCLUSIVE by another process for 2 or 12 s"),
    "clock set back": (clock, 4, "by 10 minutes to 11 hours during a sweep, every second one killed; then twice that"),
    f"{WRITERS} jobs at once": (writers, 1, f"{WRITERS} commands into one SQLite file"),
}  # fmt: skip
