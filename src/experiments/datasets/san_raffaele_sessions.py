"""The sessions of San Raffaele: who was recorded when, by which scanner, and the frames of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.datasets.csv_tables import read_table
from experiments.datasets.group_table import SPACING, Spacing, spacing_pair
from experiments.datasets.images import image_files
from experiments.datasets.pairing import REFUSE, Pairing, pair
from experiments.datasets.pixel_cache import read_pairs
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.datasets.sweep_cache import SweepRecipe
from experiments.errors import InputError
from experiments.unicode_names import same_name
from registration.natural_order import natural_key

COLUMNS = ("session", "subject", "date", "scanner", "excluded")
YES, NO = ("1", "yes", "true"), ("", "0", "no", "false")
# Of the simulated substitute: the first session is longer, so that it can stand alone, and one in four is poor.
LONG = 4
POOR_EVERY = 4


@dataclass(frozen=True)
class Session:
    """One visit: its frames in order of time.

    Parameters
    ----------
    name : str
        Name of the session.
    group : str
        The subject, else the session.
    date : str
        As the table has it.
    scanner : str
        As the table has it.
    reasons : mapping of int to str
        A sentence for each excluded frame, by its place.
    cases : tuple of str
        Name of each frame in the data set.
    images : tuple of ndarray of uint8, shape (h, w)
        Grey values.
    masks : tuple of ndarray of bool, shape (h, w)
        The vessel.
    spacing_mm : (float, float) or None
        Pixel size (vertical, horizontal); None: not known.
    """

    name: str
    group: str
    date: str
    scanner: str
    reasons: Mapping[int, str]
    cases: tuple[str, ...]
    images: tuple[np.ndarray, ...]
    masks: tuple[np.ndarray, ...]
    spacing_mm: Spacing | None

    def __len__(self) -> int:
        return len(self.cases)

    @property
    def excluded(self) -> bool:
        """Whether all of it is on the list."""
        return len(self.reasons) == len(self)


def read_sessions(root: Path, cache: str | None, unpaired: str = REFUSE) -> tuple[Session, ...]:
    """Read all sessions that have labelled frames.

    Parameters
    ----------
    root : Path
        The folder of sessions and tables.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Returns
    -------
    tuple of Session
        Sessions in order of name.

    Raises
    ------
    InputError
        If a row, folder or file is not as expected; the message names it.
    """
    rows = _session_rows(root)
    found = _paired(root, rows)
    pairing_of(found).settled(unpaired, root)
    listed = _listed_frames(root / "excluded.csv", found)
    frames = {name: dict(one.pairs) for name, one in found.items() if one.pairs}
    rows = {name: rows[name] for name in frames}
    pairs = [one for of_session in frames.values() for one in of_session.values()]
    images, masks = read_pairs([one for one, _ in pairs], [two for _, two in pairs], (1, 255), (0,), cache)
    image_files.require_vessel(root, masks)
    sessions: list[Session] = []
    start = 0
    for name, row in rows.items():
        end = start + len(frames[name])
        reasons = dict(listed.get(name, {}))
        if _marked(root, row):
            reasons = dict.fromkeys(range(end - start), "excluded in sessions.csv")
        sessions.append(
            Session(
                name,
                row["subject"] or name,
                row["date"],
                row["scanner"],
                reasons,
                tuple(f"{name}_{frame}" for frame in frames[name]),
                images[start:end],
                masks[start:end],
                _spacing(root, row),
            )
        )
        start = end
    return tuple(sessions)


def session_files(root: Path) -> tuple[Path, ...]:
    """List all files that decide what ``read_sessions`` returns.

    Parameters
    ----------
    root : Path
        The folder of sessions and tables.

    Returns
    -------
    tuple of Path
        The tables, which may be missing, images and masks.
    """
    return (root / "sessions.csv", root / "excluded.csv", *left_over(root).files)


def left_over(root: Path) -> Pairing:
    """Pair all frames of all sessions.

    Parameters
    ----------
    root : Path
        The folder of sessions and tables.

    Returns
    -------
    Pairing
        The pairs, and what has no partner among them.
    """
    return pairing_of(_paired(root, _session_rows(root)))


def pairing_of(sessions: Mapping[str, Pairing]) -> Pairing:
    """Join the pairings of sessions.

    Parameters
    ----------
    sessions : mapping of str to Pairing
        Pairing of each session.

    Returns
    -------
    Pairing
        One pairing, whose cases are named by session and frame.
    """
    combined = Pairing({})
    for name, one in sessions.items():
        cases = {f"{name}_{frame}": files for frame, files in one.pairs.items()}
        combined += Pairing(cases, one.images, one.masks, one.others)
    return combined


def simulated_sessions(maker: SimulatedSubstitute) -> tuple[Session, ...]:
    """Simulate subjects with a vessel of their own, each session recorded by another scanner.

    Parameters
    ----------
    maker : SimulatedSubstitute
        Settings of the simulated substitute.

    Returns
    -------
    tuple of Session
        Sessions, one in four of them poor and excluded.
    """
    places, poor = _places(maker), _poor(maker)
    made = maker(simulated_recipes(maker))
    sessions = []
    for index, ((subject, number), recorded) in enumerate(zip(places, made, strict=True)):
        name, count = f"session_{index + 1:02d}", len(recorded.images)
        sessions.append(
            Session(
                name,
                f"subject_{subject + 1:02d}",
                f"2000-{1 + number % 12:02d}-{1 + subject % 28:02d}",
                f"simulated {index + 1}",
                dict.fromkeys(range(count), "excluded as simulated to be poor") if poor[index] else {},
                tuple(f"{name}_{frame:03d}" for frame in range(count)),
                tuple(recorded.images),
                tuple(recorded.masks),
                recorded.spacing_mm,
            )
        )
    return tuple(sessions)


def simulated_recipes(maker: SimulatedSubstitute) -> tuple[SweepRecipe, ...]:
    """List the recordings of the simulated sessions.

    Parameters
    ----------
    maker : SimulatedSubstitute
        Settings of the simulated substitute.

    Returns
    -------
    tuple of SweepRecipe
        One for each session.
    """
    return tuple(
        maker.recipe(subject, index, times=LONG if index == 0 else 1, poor=poor)
        for index, ((subject, _), poor) in enumerate(zip(_places(maker), _poor(maker), strict=True))
    )


def _places(maker: SimulatedSubstitute) -> list[tuple[int, int]]:
    """Subject and round of each session."""
    return [(subject, number) for number in range(maker.recordings) for subject in range(maker.subjects)]


def _poor(maker: SimulatedSubstitute) -> list[bool]:
    # Shifted by one from round to round, so that no subject has poor sessions alone.
    return [(subject + number) % POOR_EVERY == POOR_EVERY - 1 for subject, number in _places(maker)]


def _session_rows(root: Path) -> dict[str, dict[str, str]]:
    """Return the row of each session; every row must have its folder and every folder its row."""
    path = root / "sessions.csv"
    rows: dict[str, dict[str, str]] = {}
    for row in read_table(path, COLUMNS):
        name = row["session"]
        if not name or name in rows:
            raise InputError(
                f"{path}: expected one row for each session, received {name or 'an empty name'!r} twice"
            )
        rows[name] = row
    if not rows:
        raise InputError(f"{path}: expected a row for each session, found none")
    for folder in sorted(root.iterdir()):
        if (folder / "images").is_dir() and same_name(folder.name) not in rows:
            raise InputError(f"{path}: expected a row for session {folder.name!r}, found none")
    return dict(sorted(rows.items()))


def _paired(root: Path, sessions: Collection[str]) -> dict[str, Pairing]:
    """Image and mask of each frame of each session, in order of the numbers in their names."""
    folders = {same_name(folder.name): folder for folder in root.iterdir()}
    return {name: _frames(folders.get(name, root / name)) for name in sessions}


def _frames(folder: Path) -> Pairing:
    images = image_files.image_files(folder / "images")
    # A session that nobody has labelled yet has no masks.
    labelled = (folder / "masks").is_dir() and any((folder / "masks").iterdir())
    masks = image_files.image_files(folder / "masks") if labelled else {}
    others = image_files.other_files(folder / "images") + (
        image_files.other_files(folder / "masks") if labelled else ()
    )
    return pair({name: images[name] for name in sorted(images, key=natural_key)}, masks, others)


def _listed_frames(path: Path, sessions: Mapping[str, Pairing]) -> dict[str, dict[int, str]]:
    """Return the frames on the optional list ``excluded.csv`` (session, frame, reason), by session and place.

    Frames that are left out because they have no mask or image may be on it.
    """
    if not path.exists():
        return {}
    listed: dict[str, dict[int, str]] = {}
    for row in read_table(path, ("session", "frame")):
        session, frame = row["session"], row["frame"]
        own = sessions.get(session, Pairing({}))
        names = list(own.pairs)
        if frame in {same_name(file.stem) for file in (*own.images, *own.masks)}:
            continue
        if frame not in names:
            raise InputError(
                f"{path}: expected frames of the data set, received {frame!r} of session {session!r}"
            )
        reason = row.get("reason", "")
        listed.setdefault(session, {})[names.index(frame)] = "excluded in excluded.csv" + (
            f": {reason}" if reason else ""
        )
    return listed


def _marked(root: Path, row: Mapping[str, str]) -> bool:
    value = row["excluded"].lower()
    if value not in YES + NO:
        raise InputError(
            f"{root / 'sessions.csv'}: expected excluded to be {', '.join(YES)}, {', '.join(NO[1:])} or empty for "
            f"session {row['session']!r}, received {row['excluded']!r}"
        )
    return value in YES


def _spacing(root: Path, row: Mapping[str, str]) -> Spacing | None:
    """Return the pixel size where the row has values in columns vertical_mm and horizontal_mm."""
    sides = [row.get(side, "") for side in SPACING]
    return spacing_pair(sides, f"{root / 'sessions.csv'}: {row['session']}") if any(sides) else None
