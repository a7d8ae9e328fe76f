"""Faults on purpose: commands killed at random, disks full, stores locked or read-only, servers away, clocks set back.

    python scripts/faults.py [--attempts 100] [--seed 0] [--only NAME ...] [--out results/reliability.md] [--quick]

Every command runs in a process of its own, forked from one that has all imports behind it. After each fault the same
command is called again, and files, numbers, store and processes are compared with those of a call that nothing
disturbed.
``make faults`` writes results/reliability.md.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import shlex
import sys
import tempfile
import time
from pathlib import Path

from fault_kills import HARMS, PHASES, SHARES, Campaign, Outcome, kill_phase
from fault_processes import load_all, plugin
from fault_server import server_gone
from fault_surroundings import FAULTS, NotTried
from quick_budget import parsed
from reliability_page import page_of, with_faults

from experiments.provenance import running_commit

# Of these there is one row; the row of a server counts attempts of three kinds.
SERVER = ("server away", 3, "away from the start; killed in the middle and back; back only after the end")
EXPLAINED = (
    "*Took effect*: killed before the command had ended; of other faults, the command met it. *Lost runs*: a job whose",
    "run is missing, unfinished or twice in the tracker. *Leftovers*: temporary files after the next call. *Refused",
    "afterwards*: the next call did not succeed.",
)
CALLS = ("SIGKILL", *FAULTS, SERVER[0])


def main(arguments: list[str] | None = None) -> int:
    """Bring the faults about, write the page, and return 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--attempts", type=int, default=100, help="SIGKILLs in all")
    parser.add_argument(
        "--others", type=int, default=0, help="attempts of each other fault; 0: its own number"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="NAME", help=f"of {', '.join(CALLS)}, or a phase"
    )
    parser.add_argument("--out", type=Path, help="Markdown file that gets the page")
    given = parsed(parser, {"attempts": 2, "others": 1}, arguments)
    os.environ.update({"OMP_NUM_THREADS": "1", "MLFLOW_DISABLE_TELEMETRY": "true"})
    begun_s = time.monotonic()
    load_all()
    rows: dict[str, tuple[str, Outcome | str]] = {}
    with tempfile.TemporaryDirectory(prefix="ctus-faults-") as folder:
        plugin(Path(folder) / "plugin")
        campaign = Campaign(Path(folder), given.seed)
        campaign.prepare()
        for name, about, call in planned(campaign, given):
            began_s = time.monotonic()
            try:
                rows[name] = about, call()
            except NotTried as reason:
                rows[name] = about, f"not tried: {reason}"
            except (RuntimeError, OSError) as failure:
                rows[name] = about, f"stopped: {str(failure).splitlines()[-1][:200]}"
            print(f"{name}: {summary(rows[name][1])}, {time.monotonic() - began_s:.0f} s", flush=True)
            text = page(rows, given, time.monotonic() - begun_s)
            if given.out:
                given.out.write_text(with_faults(page_of(given.out), text), encoding="utf-8")
    print(text)
    return 1 if any(bad(found) for _, found in rows.values()) else 0


def bad(found: Outcome | str) -> bool:
    """Whether something was lost, or a fault could not be looked at to its end."""
    return found.startswith("stopped") if isinstance(found, str) else bool(found.counts.total())


def planned(campaign: Campaign, given: argparse.Namespace):
    """The faults that were asked for: name, what is done, and the call that does it."""
    for phase, share in zip(PHASES, shares(given.attempts), strict=True):
        if share and chosen(given.only, "SIGKILL", phase.name):
            about = f"`{' '.join(phase.words[:2])}` killed at random moments"
            yield f"SIGKILL, {phase.name}", about, lambda p=phase, n=share: kill_phase(campaign, p, n)
    for name, (fault, own, about) in FAULTS.items():
        if chosen(given.only, name):
            yield name, about, lambda f=fault, n=given.others or own: f(campaign, n)
    if chosen(given.only, SERVER[0]):
        yield SERVER[0], SERVER[2], lambda: server_gone(campaign, given.others or SERVER[1])


def chosen(only: list[str], *names: str) -> bool:
    """Whether a fault was asked for by one of its names, or none was."""
    return not only or any(name in only for name in names)


def shares(attempts: int) -> list[int]:
    """The attempts of each phase, as many in all as asked for."""
    exact = [attempts * share / sum(SHARES) for share in SHARES]
    whole = [int(each) for each in exact]
    for place in sorted(range(len(exact)), key=lambda at: whole[at] - exact[at])[: attempts - sum(whole)]:
        whole[place] += 1
    return whole


def summary(found: Outcome | str) -> str:
    """An outcome in a line."""
    if isinstance(found, str):
        return found
    harms = ", ".join(f"{name}: {count}" for name, count in found.counts.items()) or "nothing lost"
    return "\n  ".join([f"{found.attempts} attempts, {harms}", *found.said[:5]])


def page(rows: dict[str, tuple[str, Outcome | str]], given: argparse.Namespace, took_s: float) -> str:
    """The table of all faults."""
    command = shlex.join(["python", "scripts/faults.py", *sys.argv[1:]])
    lines = ["# Reliability", "",
             "Faults brought about on purpose, the same command after each, and what was then not as in a call that "
             "nothing disturbed. A page that a command writes; see docs/security.md.", "",
             f"- command: `{command}`", f"- commit: {running_commit()}",
             f"- date: {datetime.datetime.now(datetime.UTC):%Y-%m-%d}, "
             f"{took_s / 60:.0f} minutes on {os.cpu_count()} cores, {platform.system()}, "
             f"Python {platform.python_version()}",
             f"- seed: {given.seed}", "",
             f"| fault | attempts | took effect | {' | '.join(HARMS)} | identical numbers |",
             "|---|" + "---:|" * (len(HARMS) + 3)]  # fmt: skip
    done = [found for _, found in rows.values() if isinstance(found, Outcome)]
    for name, (_, found) in rows.items():
        lines.append(_row(name, found))
    kills = [
        each for name, (_, each) in rows.items() if name.startswith("SIGKILL") and isinstance(each, Outcome)
    ]
    if kills:
        lines.append(_row("**all SIGKILLs**", _sum(kills)))
    lines.append(_row("**all**", _sum(done)))
    lines += ["", *(f"- *{name}*: {about}" for name, (about, _) in rows.items())]
    lines += ["", *EXPLAINED]
    said = [f"- {name}: {each}" for name, (_, found) in rows.items() if isinstance(found, Outcome)
            for each in found.said[:10]]  # fmt: skip
    return "\n".join([*lines, *(["", "## What was lost", "", *said] if said else []), ""])


def _row(name: str, found: Outcome | str) -> str:
    if isinstance(found, str):
        return f"| {name} | 0 | {found} |" + " |" * (len(HARMS) + 1)
    counts = [found.attempts, found.before_end, *(found.counts[harm] for harm in HARMS)]
    same = "yes" if not found.counts["other numbers"] and not found.counts["refused afterwards"] else "no"
    return f"| {name} | {' | '.join(map(str, counts))} | {same} |"


def _sum(outcomes: list[Outcome]) -> Outcome:
    total = Outcome()
    for each in outcomes:
        total.attempts += each.attempts
        total.before_end += each.before_end
        total.counts += each.counts
    return total


if __name__ == "__main__":
    sys.exit(main())
