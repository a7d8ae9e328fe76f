"""The rows of a robustness job: solved here or in several processes, kept as they come so that a job can go on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.paths import project_root
from experiments.process_pool import one_open3d_thread, process_pool

# A trial of a job: the number of its condition, and its own within that.
Key = tuple[int, int]
Row = dict[str, Any]
Solve = Callable[[Key], Row]


@dataclass(frozen=True)
class OneThread:
    """Solver that uses one thread of Open3D, in whichever process it is called.

    Parameters
    ----------
    solve : Solve
        Solves one trial.
    """

    solve: Solve

    def __call__(self, key: Key) -> Row:
        """Solve one trial.

        Parameters
        ----------
        key : Key
            Numbers of the condition and of the trial.

        Returns
        -------
        Row
            Row of the trial.
        """
        with one_open3d_thread():
            return self.solve(key)


@dataclass(frozen=True)
class KeptRows:
    """File of finished trials, one JSON line each, in the project's cache under a fingerprint of the job.

    Parameters
    ----------
    path : Path
        The file.
    """

    path: Path

    @classmethod
    def of(cls, identity: object) -> KeptRows:
        """Find the file of a job.

        Parameters
        ----------
        identity : object
            What identifies the job by its ``repr``.

        Returns
        -------
        KeptRows
            The file.
        """
        name = hashlib.sha256(repr(identity).encode()).hexdigest()[:16]
        return cls(project_root() / ".cache" / "robustness" / f"{name}.jsonl")

    def read(self) -> dict[Key, Row]:
        """Read the rows of the file; a last line that was cut off when the process died is left out.

        Returns
        -------
        dict
            Rows by the numbers of condition and trial.
        """
        found: dict[Key, Row] = {}
        if not self.path.is_file():
            return found
        for line in self.path.read_text(encoding="utf-8").splitlines():
            try:
                condition, number, row = json.loads(line)
            except ValueError:
                break
            found[condition, number] = row
        return found

    def append(self, key: Key, row: Row) -> None:
        """Add a finished trial.

        Parameters
        ----------
        key : Key
            Numbers of the condition and of the trial.
        row : Row
            Row of the trial.
        """
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps([*key, row]) + "\n")

    def begin(self, known: dict[Key, Row]) -> None:
        """Start the file with the rows that are known.

        Parameters
        ----------
        known : dict
            Rows by the numbers of condition and trial.
        """
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text("".join(json.dumps([*key, row]) + "\n" for key, row in known.items()))

    def drop(self) -> None:
        """Remove the file: the job has its own results now."""
        self.path.unlink(missing_ok=True)


def solved_rows(
    solve: Solve, keys: Sequence[Key], *, workers: int, kept: KeptRows, resume: bool
) -> Iterator[Row]:
    """Solve all trials in the order of their keys.

    Each process has one thread, also this one, so that times compare.

    Parameters
    ----------
    solve : Solve
        Solves one trial.
    keys : sequence of Key
        Numbers of condition and trial of each trial.
    workers : int
        Number of processes; the results do not depend on it.
    kept : KeptRows
        File of finished trials.
    resume : bool
        True not to solve again the trials that an interrupted job has left; False to forget them.

    Returns
    -------
    iterator of Row
        Rows of the trials in the order of ``keys``.
    """
    wanted = set(keys)
    known = {key: row for key, row in kept.read().items() if key in wanted} if resume else {}
    kept.begin(known)
    missing = [key for key in keys if key not in known]
    fresh = _solved(OneThread(solve), missing, workers)
    for key in keys:
        if key not in known:
            row = next(fresh)
            kept.append(key, row)
            yield row
        else:
            yield known[key]
    kept.drop()


def _solved(solve: Solve, keys: Sequence[Key], workers: int) -> Iterator[Row]:
    if workers == 1 or len(keys) < 2:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):
            yield from map(solve, keys)
        return
    count = min(workers, len(keys))
    with process_pool(count) as pool:
        # Chunks spare handing the surfaces over with every trial; small ones keep all processes busy to the end.
        yield from pool.map(solve, keys, chunksize=max(min(len(keys) // (8 * count), 10), 1))
