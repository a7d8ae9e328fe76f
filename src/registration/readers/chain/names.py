"""Which coordinate frames the name of a transform links: ``TestToolToTracker`` is from TestTool to Tracker.

PLUS writes the names of both frames and "To" between them. Names of frames may hold "To" themselves.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

Pair = tuple[str, str]


def splits(name: str) -> list[Pair]:
    """List every (from, to) that the name of a transform may stand for.

    Parameters
    ----------
    name : str
        Name of a transform of PLUS, such as ``ToolToTracker``.

    Returns
    -------
    list of (str, str)
        One pair for each "To" with text on both sides of it.

    Examples
    --------
    >>> splits("ToolToTracker")
    [('Tool', 'Tracker')]
    """
    places = [at for at in range(1, len(name) - 2) if name.startswith("To", at)]
    return [(name[:at], name[at + 2 :]) for at in places]


def resolve(names: Iterable[str], known: Collection[str] = ()) -> dict[str, Pair]:
    """Find the coordinate frames that each transform links; names that stay ambiguous are left out.

    A name is read as two coordinate frames of ``known`` where it can be. Otherwise the name of a coordinate
    frame begins with no small letter, as PLUS requires: TorsoToProbe has one "To", HandToEyeToWorld two.
    Among several readings the one with more coordinate frames counts that ``known`` or the other names
    mention.

    Parameters
    ----------
    names : iterable of str
        Names of transforms.
    known : collection of str, optional
        Coordinate frames that settings or a device set name.

    Returns
    -------
    dict of str to (str, str)
        By name, the pair (from, to).
    """
    waiting = {name: splits(name) for name in dict.fromkeys(names)}
    found: dict[str, Pair] = {}
    mentioned = set(known)
    for name, readings in list(waiting.items()):
        proper = [pair for pair in readings if not pair[1][0].islower()] or readings
        both = [pair for pair in readings if pair[0] in known and pair[1] in known]
        sure = both if len(both) == 1 else proper
        waiting[name] = sure
        if len(sure) == 1:
            found[name] = sure[0]
    mentioned.update(frame for pair in found.values() for frame in pair)
    # Each name that is settled may settle another one.
    while True:
        settled = {
            name: best
            for name, readings in waiting.items()
            if name not in found and (best := _best(readings, mentioned)) is not None
        }
        if not settled:
            return found
        found |= settled
        mentioned.update(frame for pair in settled.values() for frame in pair)


def _best(readings: list[Pair], mentioned: set[str]) -> Pair | None:
    """The reading with most frames that are mentioned elsewhere; None for none or several such."""
    counts = [sum(frame in mentioned for frame in pair) for pair in readings]
    highest = max(counts, default=0)
    return readings[counts.index(highest)] if highest and counts.count(highest) == 1 else None
