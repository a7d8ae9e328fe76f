"""A claim of speed and its peers, timed in turn on the same problems, with the error of each side.

Sides take turns within a round, and the order is turned round from one round to the next, so that what else the machine
does meets all alike. A ratio is the median over rounds of the peer's seconds by ours within one round; fewer than three
rounds give none.
"""

from __future__ import annotations

import importlib.metadata
import math
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

# Of fewer rounds no ratio is given.
MIN_ROUNDS = 3
# Less processor time than this cannot be told from none: the clock has steps, and a side may work in another process.
CLEAR_S = 0.1
OURS_FASTER, PEER_FASTER, NO_DIFFERENCE = "ours faster", "peer faster", "no difference shown"


@dataclass(frozen=True)
class Side:
    """One way of doing the work.

    Parameters
    ----------
    name : str
        What it is, with what it does otherwise than ours.
    call : callable
        Does the work of a problem and returns its result; only this is timed.
    version : str, optional
        Name and version of the package.
    scale : float, optional
        By which the seconds are multiplied: a side may do a part of the work, which its name then says.
    """

    name: str
    call: Callable[[Any], Any]
    version: str = ""
    scale: float = 1.0


@dataclass(frozen=True)
class Claim:
    """What is claimed, who else does it, and how a result is checked.

    Parameters
    ----------
    title : str
        Name of the row.
    work : str
        What is done, with sizes.
    ours : Side
        This project's way.
    error_of : callable
        Error of a result, from the problem and the result; not timed.
    error_name : str
        What the error is, with its unit.
    max_error : float
        A result up to this error is right.
    peers : sequence of Side, optional
        Others that do the work; empty where there is none.
    problem : callable, optional
        The problem of a round, by the round's number from 1 on; 0 is the round that warms up.
    rounds : int, optional
        Number of rounds that count.
    warm_up : bool, optional
        Whether one round goes before them.
    remarks : sequence of str, optional
        What a reader must know of the row: missing packages, work that differs.
    """

    title: str
    work: str
    ours: Side
    error_of: Callable[[Any, Any], float]
    error_name: str
    max_error: float
    peers: Sequence[Side] = ()
    problem: Callable[[int], Any] = lambda number: number
    rounds: int = 5
    warm_up: bool = True
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class Times:
    """What a side took, and its errors, round by round.

    Parameters
    ----------
    name, version : str
        Of the side.
    seconds, cpu_s : list of float
        By the clock, and of processors, child processes that have ended included.
    errors : list of float
        Error of each result; infinite where there was none.
    """

    name: str
    version: str
    seconds: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Measured:
    """A claim that was measured.

    Parameters
    ----------
    title, work, error_name : str
        As in the claim.
    max_error : float
        As in the claim.
    sides : list of Times
        Ours, then the peers.
    remarks : list of str
        As in the claim.
    load : tuple of float
        Load average of the last minute before and after.
    commit, date : str, optional
        Commit of the code that was measured, and when.
    """

    title: str
    work: str
    error_name: str
    max_error: float
    sides: list[Times]
    remarks: list[str]
    load: tuple[float, float]
    commit: str = ""
    date: str = ""

    def as_plain(self) -> dict[str, Any]:
        """Return the same as a mapping of plain values, as JSON takes it."""
        return asdict(self)

    @classmethod
    def of_plain(cls, plain: dict[str, Any]) -> Measured:
        """Build it from such a mapping."""
        sides = [Times(**each) for each in plain["sides"]]
        return cls(**{**plain, "sides": sides, "load": tuple(plain["load"])})


@dataclass(frozen=True)
class Ratio:
    """A peer's seconds by ours: above 1 ours is faster.

    Parameters
    ----------
    median, low, high : float
        Over the rounds; the last two are the least and the greatest.
    by_cpu : float
        The same of the processor time of all rounds together; NaN where there is too little to tell.
    """

    median: float
    low: float
    high: float
    by_cpu: float

    @property
    def verdict(self) -> str:
        """Who is faster; nobody where some rounds say this and some that."""
        if self.low > 1:
            return OURS_FASTER
        return PEER_FASTER if self.high < 1 else NO_DIFFERENCE


def measure(claim: Claim) -> Measured:
    """Run a claim.

    Parameters
    ----------
    claim : Claim
        What is measured.

    Returns
    -------
    Measured
        Seconds and errors of each side in each round.
    """
    sides = [claim.ours, *claim.peers]
    times = [Times(side.name, side.version) for side in sides]
    before = _load()
    for number in range(0 if claim.warm_up else 1, claim.rounds + 1):
        problem = claim.problem(number)
        order = list(zip(sides, times, strict=True))
        for side, kept in order if number % 2 else reversed(order):
            seconds, cpu_s, result = _timed(side, problem)
            if number:
                kept.seconds.append(side.scale * seconds)
                kept.cpu_s.append(side.scale * cpu_s)
                kept.errors.append(math.inf if result is None else float(claim.error_of(problem, result)))
    load = (before, _load())
    return Measured(
        claim.title, claim.work, claim.error_name, claim.max_error, times, list(claim.remarks), load
    )


def ratio_of(ours: Times, peer: Times) -> Ratio | None:
    """Compare a peer with ours.

    Parameters
    ----------
    ours, peer : Times
        Times of the same rounds.

    Returns
    -------
    Ratio or None
        None for fewer than three rounds, of which no ratio is quoted.
    """
    if len(ours.seconds) < MIN_ROUNDS:
        return None
    ratios = [theirs / own for theirs, own in zip(peer.seconds, ours.seconds, strict=True)]
    # The clock of processor time has steps of a hundredth of a second: that of all rounds together is exact enough.
    spent, own_spent = sum(peer.cpu_s), sum(ours.cpu_s)
    return Ratio(
        statistics.median(ratios),
        min(ratios),
        max(ratios),
        spent / own_spent if min(spent, own_spent) >= CLEAR_S else math.nan,
    )


def correct(times: Times, max_error: float) -> int:
    """Count the results that are right.

    Parameters
    ----------
    times : Times
        What a side did.
    max_error : float
        Error up to which a result is right.

    Returns
    -------
    int
        Number of rounds.
    """
    return sum(error <= max_error for error in times.errors)


def conclusion(measured: Measured, peer: Times) -> str:
    """Say in words what a row shows.

    Parameters
    ----------
    measured : Measured
        The claim; its first side is ours.
    peer : Times
        The side that ours is compared with.

    Returns
    -------
    str
        Who is faster, and whose results are not right.
    """
    ours = measured.sides[0]
    ratio = ratio_of(ours, peer)
    said = "no ratio of so few rounds" if ratio is None else ratio.verdict
    for who, times in (("ours", ours), ("the peer", peer)):
        right, of = correct(times, measured.max_error), len(times.errors)
        if right < of:
            said += f"; {who} right in {right} of {of}"
    return said


def version_of(package: str) -> str:
    """Name a package and the version of it that is installed."""
    return f"{package} {importlib.metadata.version(package)}"


def installed(package: str) -> bool:
    """Tell whether a package is installed."""
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def missing(package: str, what: str) -> str:
    """Say that a peer is left out for want of a package."""
    return f"{what}: not measured, the package {package} is not installed (pip install {package})"


def _timed(side: Side, problem: Any) -> tuple[float, float, Any]:
    """Seconds, processor seconds, and the result; None for an input that a side refuses."""
    cpu_s, begin_s = _cpu_s(), time.perf_counter()
    try:
        result = side.call(problem)
    except ValueError:
        result = None
    return time.perf_counter() - begin_s, _cpu_s() - cpu_s, result


def _cpu_s() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _load() -> float:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan
