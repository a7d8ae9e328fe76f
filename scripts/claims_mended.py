"""What was mended after profiles: this project beside its earlier self, whose tree git still has."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from claims_framework import CTUS, called_side
from quick_budget import REPOSITORY
from side_by_side import Claim, Side

# The last commit before calls composed their configuration once instead of twice, with YAML parsed in C, and before
# masks were described within their boxes.
BEFORE_COMPOSING = "2093132^"
BEFORE_FIGURES, BEFORE_BORDERS = "94ab39d^", "7ae7e7b^"
REMARK = "What was mended: the peer is this project's earlier self."


def composing(quick: bool) -> Claim:
    """A call that composes its configuration, beside the same call before that was mended."""
    words = ["-m", "+preset=robustness_ablation", "target=vessel.ply", "--cfg", "job"]
    before = earlier_tree(BEFORE_COMPOSING)
    peers = (
        []
        if before is None
        else [called_side("before", [*CTUS, *words], ["multistart"], _commit(BEFORE_COMPOSING), before)]
    )
    return Claim(
        "Mended: composing a configuration",
        "a new process: ctus " + " ".join(words),
        called_side("ctus", [*CTUS, *words], ["multistart"]),
        lambda number, lacking: lacking,
        "words that are not in the output, or the exit code",
        0.0,
        peers,
        rounds=1 if quick else 9,
        remarks=_remarks(before, BEFORE_COMPOSING),
    )


def contours(quick: bool) -> Claim:
    """Masks checked against their neighbours, their contours and filters, beside the same before masks had boxes."""
    return beside_earlier(
        "Mended: contours and filters",
        "40 masks checked, their contours extracted and filtered" if not quick else "20 masks",
        "gather",
        20 if quick else 40,
        BEFORE_COMPOSING,
        1 if quick else 7,
    )


def borders(quick: bool) -> Claim:
    """The borders of a rough surface, beside the same before each looked up its own triangles."""
    rings = 20 if quick else 75
    return beside_earlier(
        "Mended: borders of a rough surface",
        f"a tube of {rings} rings of 48 that has lost a tenth of its triangles",
        "rough_borders",
        rings,
        BEFORE_BORDERS,
        1 if quick else 9,
    )


def figures(quick: bool) -> Claim:
    """A figure in two formats, beside the same before it was laid out once for both."""
    panels = 2 if quick else 5
    return beside_earlier(
        "Mended: a figure in two formats",
        f"{panels} panels drawn and written as PNG and SVG; the pictures of PNG are compared",
        "figure_files",
        panels,
        BEFORE_FIGURES,
        1 if quick else 9,
    )


def beside_earlier(title: str, work: str, job: str, size: int, commit: str, rounds: int) -> Claim:
    """Time a job of ``earlier_worker`` with the code of today and with that of a commit.

    Parameters
    ----------
    title, work : str
        Of the claim.
    job : str
        Name of the job.
    size : int
        What the job takes.
    commit : str
        Commit whose code is the peer.
    rounds : int
        Number of rounds.

    Returns
    -------
    Claim
        Both sides; the error is the difference of their results.
    """
    tree = earlier_tree(commit)
    today = Worker(REPOSITORY, job, size)
    known = today(0)
    peers = [] if tree is None else [Side("before", Worker(tree, job, size), _commit(commit))]
    return Claim(
        title,
        work,
        Side("now", today),
        lambda number, found: max(abs(one - other) for one, other in zip(found, known, strict=True)),
        "greatest difference from the results of today's code",
        1e-6,
        peers,
        rounds=rounds,
        remarks=_remarks(tree, commit),
    )


class Worker:
    """A process that imports the project from a tree and does a job each time it is called.

    Parameters
    ----------
    root : Path
        Tree whose ``src`` is imported.
    job : str
        Name of a function of ``earlier_worker``.
    size : int
        What it takes.
    """

    def __init__(self, root: Path, job: str, size: int) -> None:
        scripts = REPOSITORY / "scripts"
        self._process = subprocess.Popen(
            [sys.executable, str(scripts / "earlier_worker.py"), job, str(size)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(root / "src")},
        )

    def __call__(self, number: object) -> list[float]:
        """Do the job and return what describes its result."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        found: list[float] = json.loads(self._process.stdout.readline())
        return found


def earlier_tree(commit: str) -> Path | None:
    """Unpack an earlier commit into a folder of its own.

    Parameters
    ----------
    commit : str
        Name of the commit.

    Returns
    -------
    Path or None
        The folder; None where git does not have the commit.
    """
    folder = Path(tempfile.mkdtemp())
    packed = subprocess.run(
        ["git", "archive", commit, "src", "conf", "pyproject.toml"],
        cwd=REPOSITORY,
        capture_output=True,
        check=False,
    )
    if packed.returncode:
        shutil.rmtree(folder)
        return None
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed.stdout, check=True)
    return folder


def _commit(name: str) -> str:
    return f"commit {name}"


def _remarks(tree: Path | None, commit: str) -> Sequence[str]:
    return (
        [REMARK] if tree is not None else [REMARK, f"Commit {commit} is not in this checkout: not measured."]
    )
