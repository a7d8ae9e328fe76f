"""What each configuration of San Raffaele takes for training, and the test subjects that all of them share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.datasets.images.image_quality import QualityOutliers
from experiments.datasets.san_raffaele_sessions import Session
from experiments.errors import InputError

Row = Mapping[str, object]
LIST, QUALITY = "list", "quality"


@dataclass(frozen=True)
class Frame:
    """One frame of a configuration.

    Parameters
    ----------
    session : Session
        The session that it belongs to.
    place : int
        Its place in the session, from 0.
    group : str
        Its group in the configuration.
    """

    session: Session
    place: int
    group: str

    @property
    def case(self) -> str:
        """The frame's name in the data set."""
        return self.session.cases[self.place]


@dataclass(frozen=True)
class Chosen:
    """The frames of a configuration apart from the test.

    Parameters
    ----------
    frames : tuple of Frame
        The frames.
    left_out : tuple of mapping
        A row for each reason to leave a frame out.
    """

    frames: tuple[Frame, ...]
    left_out: tuple[Row, ...] = ()


def frames_of(sessions: Sequence[Session]) -> tuple[Frame, ...]:
    """List all frames of sessions, grouped by subject.

    Parameters
    ----------
    sessions : sequence of Session
        Sessions.

    Returns
    -------
    tuple of Frame
        Frames in their order.
    """
    return tuple(
        Frame(session, place, session.group) for session in sessions for place in range(len(session))
    )


def lone_session(sessions: Sequence[Session], name: str | None) -> Session:
    """Find the session of the configuration ``single_session``.

    Parameters
    ----------
    sessions : sequence of Session
        All sessions.
    name : str or None
        Its name; None: the largest that is not excluded, the first among equals.

    Returns
    -------
    Session
        The session.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name is None:
        kept = [session for session in sessions if not session.excluded] or list(sessions)
        return max(kept, key=len)
    found = next((session for session in sessions if session.name == name), None)
    if found is None:
        names = ", ".join(session.name for session in sessions[:5])
        raise InputError(
            f"session: expected one of the data set's sessions ({names}, ...), received {name!r}"
        )
    return found


def test_groups(
    sessions: Sequence[Session], alone: Session, wanted: Sequence[str] | None, share: float, seed: int
) -> tuple[str, ...]:
    """Choose the groups kept for the test of every configuration.

    Parameters
    ----------
    sessions : sequence of Session
        All sessions.
    alone : Session
        The session of ``single_session``, whose group is never chosen.
    wanted : sequence of str or None
        The groups to choose; None: drawn.
    share : float
        Share of all groups drawn.
    seed : int
        Seed of the draw.

    Returns
    -------
    tuple of str
        Sorted groups; never all others, as each configuration keeps some to train with.

    Raises
    ------
    InputError
        If there are too few groups, or those wanted are not possible.
    """
    groups = sorted({session.group for session in sessions})
    others = [group for group in groups if group != alone.group]
    if len(others) < 2:
        raise InputError(
            f"sessions.csv: expected at least 3 subjects, one to stand alone, one to test and one to train with, "
            f"received {len(groups)}"
        )
    if wanted is None:
        count = min(max(1, round(share * len(groups))), len(others) - 1)
        return tuple(sorted(np.random.default_rng([seed, 70]).choice(others, count, replace=False).tolist()))
    for group in wanted:
        if group not in groups:
            raise InputError(f"test_subjects: expected subjects of the data set, received {group!r}")
        if group == alone.group:
            raise InputError(
                f"test_subjects: expected none with the session that stands alone, received {group!r} "
                f"of session {alone.name!r}"
            )
    if not set(others) - set(wanted):
        raise InputError("test_subjects: expected subjects left to train with, received all of them")
    return tuple(sorted(set(wanted)))


def in_blocks(session: Session, blocks: int, gap_frames: int) -> Chosen:
    """Cut one session into contiguous blocks of similar length, each a group.

    Parameters
    ----------
    session : Session
        The session.
    blocks : int
        Number of blocks.
    gap_frames : int
        Frames left out between two blocks.

    Returns
    -------
    Chosen
        The frames of the blocks, and a row for each frame between them.

    Raises
    ------
    InputError
        If the session is too short.
    """
    kept = len(session) - (blocks - 1) * gap_frames
    if kept < blocks:
        raise InputError(
            f"blocks: expected at most as many as session {session.name!r} of {len(session)} frames has room for with "
            f"gap_frames={gap_frames}, received {blocks}"
        )
    frames: list[Frame] = []
    gaps: list[Row] = []
    start = 0
    for block, part in enumerate(np.array_split(np.arange(kept), blocks)):
        end = start + len(part)
        frames.extend(Frame(session, place, f"{session.name}_block_{block}") for place in range(start, end))
        between = range(end, min(end + gap_frames, len(session)))
        gaps.extend(_row(session, place, "gap between blocks", block, gap_frames) for place in between)
        start = end + gap_frames
    return Chosen(tuple(frames), tuple(gaps))


def without_listed(pool: Sequence[Frame]) -> Chosen:
    """Leave out the frames on the list of the excluded.

    Parameters
    ----------
    pool : sequence of Frame
        Frames outside the test.

    Returns
    -------
    Chosen
        The others, and a row for each frame left out.

    Raises
    ------
    InputError
        If none is on the list: pruned would then be full.
    """
    rows = tuple(
        _row(frame.session, frame.place, frame.session.reasons[frame.place], "excluded", "")
        for frame in pool
        if frame.place in frame.session.reasons
    )
    if not rows:
        raise InputError(
            "subset: expected sessions marked excluded in sessions.csv or frames in excluded.csv for pruned, "
            "found none outside the test; pass dataset.prune_by=quality to leave out outliers of image quality"
        )
    return Chosen(tuple(frame for frame in pool if frame.place not in frame.session.reasons), rows)


def without_outliers(pool: Sequence[Frame], limit: float) -> Chosen:
    """Leave out the frames that a measure of image quality separates from the rest.

    Parameters
    ----------
    pool : sequence of Frame
        Frames outside the test.
    limit : float
        Modified z-score beyond which a frame is an outlier.

    Returns
    -------
    Chosen
        The others, and a row for each reason to leave one out.
    """
    findings = QualityOutliers(limit)([frame.session.images[frame.place] for frame in pool])
    rows = tuple(
        _row(
            pool[one.index].session, pool[one.index].place, f"{one.measure} unlike the rest", one.score, limit
        )
        | {"measured": one.value}
        for one in findings
    )
    out = {one.index for one in findings}
    return Chosen(tuple(frame for index, frame in enumerate(pool) if index not in out), rows)


def sampled(pool: Sequence[Frame], size: int, seed: int) -> Chosen:
    """Draw frames, each with the same chance.

    Parameters
    ----------
    pool : sequence of Frame
        Frames outside the test.
    size : int
        Number of frames to draw.
    seed : int
        Seed of the draw.

    Returns
    -------
    Chosen
        The frames drawn, in the order of ``pool``; all of it if it has no more.
    """
    if size >= len(pool):
        return Chosen(tuple(pool))
    drawn = np.random.default_rng([seed, 71]).choice(len(pool), size, replace=False)
    return Chosen(tuple(pool[index] for index in sorted(drawn.tolist())))


def _row(session: Session, place: int, rule: str, value: object, limit: object) -> dict[str, object]:
    return {
        "case": session.cases[place],
        "session": session.name,
        "rule": rule,
        "value": value,
        "limit": limit,
    }
