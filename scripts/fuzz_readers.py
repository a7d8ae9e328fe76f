"""Damaged files for every reader, each in a process that may die: what is accepted, refused, and what must not happen.

Every reader gets files that the project's own writers make, changed at random by a seed. A worker reads them one after
the other under a limit of memory; one that crashes, or is over its time for a file, is counted and started anew after
it. ``make fuzz`` calls this; the tests try 300 files a reader.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from damage import ACCEPTED, REFUSED, alike, changes, flips, said
from reader_table import GROUPS, Reader, readers
from reliability_page import COUNTED, page_of, with_damaged

from experiments.provenance import running_commit

TIME_S, MEMORY_BYTES = 10.0, 1 << 30


def work(group: str, name: str, count: int, seed: int, first: int, answers: Connection) -> None:
    """Read the files from ``first`` on and answer for each; the process's own messages are nobody's."""
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    reader = next(each for each in readers(group) if each.name == name)
    with tempfile.TemporaryDirectory() as folder:
        path = reader.make(Path(folder))
        target = Path(folder) / reader.changed if reader.changed else path
        data = target.read_bytes()
        before = reader.read(path)  # what is loaded at the first call does not count
        limit = resident() + MEMORY_BYTES
        for number, content in enumerate(changes(reader, data, count, seed)):
            if number < first:
                continue
            target.write_bytes(content)
            answers.send((number, "", "", 0.0, False))
            began = time.monotonic()
            how, message = said(reader.read, path)
            took = time.monotonic() - began
            if how == ACCEPTED and number < flips(reader, count):
                how = ACCEPTED if alike(reader.read(path), before) else "changed values"
            over = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > limit
            answers.send((number, how, message, took, over))
            if over:  # the highest mark stays: the next file gets a process of its own
                os._exit(0)
    answers.send((count, "end", "", 0.0, False))


def resident() -> int:
    """Bytes of memory that this process holds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def fuzz(group: str, reader: Reader, count: int, seed: int) -> tuple[collections.Counter[str], list[str]]:
    """Counts of what became of the files, and what must not happen with its number."""
    counts: collections.Counter[str] = collections.Counter()
    bad: list[str] = []
    context, first = multiprocessing.get_context("spawn"), 0
    while first < count:
        own, theirs = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(group, reader.name, count, seed, first, theirs))
        process.start()
        theirs.close()
        first = follow(own, process, first, counts, bad)
        process.kill()
        process.join()
    return counts, bad


def follow(own: Connection, process, first: int, counts: collections.Counter[str], bad: list[str]) -> int:
    """Take a worker's answers until it ends; the number of the file to go on with."""
    at = None
    while True:
        # A worker imports everything before its first file.
        if not own.poll(TIME_S if at is not None else 120.0):
            counts["over 10 s"] += 1
            bad.append(f"{at}: over {TIME_S:g} s")
            return (first if at is None else at) + 1
        try:
            number, how, message, took, over = own.recv()
        except EOFError:
            with contextlib.suppress(Exception):
                process.join(5)
            if at is None:
                return first  # it ended after its last answer, for memory
            counts["crashed"] += 1
            bad.append(f"{at}: crashed with {process.exitcode}")
            return at + 1
        if how == "end":
            return number
        if not how:
            at = number
            continue
        known = {ACCEPTED: "accepted", REFUSED: "refused", "changed values": "changed values"}
        kind = known.get(how, "foreign")
        counts[kind] += 1
        if kind in ("foreign", "changed values"):
            bad.append(f"{number}: {how}: {message[:120]}")
        for name, there in (("over 10 s", took > TIME_S), ("over 1 GB", over)):
            if there:
                counts[name] += 1
                bad.append(f"{number}: {name}, {took:.1f} s")
        at, first = None, number + 1


def row(counts: collections.Counter[str], count: int, seed: int, commit: str) -> dict[str, str]:
    """A reader's row of the page."""
    numbers = {name: str(counts[name]) for name in COUNTED}
    return {**numbers, "files": str(count), "seed": str(seed), "commit": commit}


def main() -> int:
    """Change files, print what became of them, and return 1 where anything happened that must not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="files for each reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--groups", nargs="*", choices=sorted(GROUPS), default=[])
    parser.add_argument("--reader", default="", help="only readers whose name holds this")
    parser.add_argument("--without", nargs="*", default=[], help="no readers whose name holds one of these")
    parser.add_argument("--out", type=Path, help="the page that gets the rows (results/reliability.md)")
    given = parser.parse_args()
    asked = [(name, each) for name in given.groups or GROUPS for each in readers(name)
             if given.reader in each.name and not any(word in each.name for word in given.without)]  # fmt: skip
    rows: dict[str, dict[str, str]] = {}
    worst: list[str] = []
    commit = running_commit() or ""
    for group, reader in asked:
        began = time.monotonic()
        counts, bad = fuzz(group, reader, given.count, given.seed)
        rows[reader.name] = row(counts, given.count, given.seed, commit)
        worst += [f"{reader.name}: {each}" for each in bad]
        print(f"{reader.name}: {dict(counts)}, {time.monotonic() - began:.0f} s", flush=True)
        print("".join(f"  {each}\n" for each in bad[:5]), end="", flush=True)
        if given.out:  # after each, for whoever ends it early
            given.out.parent.mkdir(parents=True, exist_ok=True)
            given.out.write_text(with_damaged(page_of(given.out), rows), encoding="utf-8")
    print(with_damaged("", rows))
    return 1 if worst else 0


if __name__ == "__main__":
    sys.exit(main())
