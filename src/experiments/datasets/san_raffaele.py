"""San Raffaele: private recordings of one vessel in many sessions, in three configurations of growing variety."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.datasets import san_raffaele_subsets as subsets
from experiments.datasets.content_key import cached_while_unchanged, content_key
from experiments.datasets.images import image_files
from experiments.datasets.images.image_quality import QualityOutliers
from experiments.datasets.pairing import REFUSE, require_choice
from experiments.datasets.san_raffaele_sessions import (
    Session,
    left_over,
    read_sessions,
    session_files,
    simulated_recipes,
    simulated_sessions,
)
from experiments.datasets.san_raffaele_subsets import Chosen, Frame
from experiments.datasets.simulated import SimulatedSubstitute, variation_note
from experiments.errors import InputError
from experiments.paths import PathSetting
from experiments.unicode_names import text_names
from models.labelled_frames import LabelledFrames
from registration.checks import require_count

if TYPE_CHECKING:
    import pandas as pd

SINGLE, FULL, PRUNED, SUBSAMPLED = "single_session", "full", "pruned", "full_subsampled"


@dataclass(frozen=True)
class SanRaffaele:
    """One configuration of the private San Raffaele set, and the test subjects that all configurations share.

    Parameters
    ----------
    root : Path
        The folder of sessions and tables.
    subset : {'single_session', 'full', 'pruned', 'full_subsampled'}
        The configuration, see Notes.
    session : str or None
        The session of ``single_session``; None: the largest.
    blocks : int
        Contiguous blocks that the single session is cut into, each a group; at least 2.
    gap_frames : int
        Frames left out between two blocks.
    prune_by : {'list', 'quality'}
        What ``pruned`` leaves out: what sessions.csv or excluded.csv exclude, or outliers of image quality
        (see ``image_quality``).
    quality_limit : float
        Modified z-score beyond which a frame is an outlier.
    subsample_to : {'pruned', 'single_session'}
        The configuration whose number of frames ``full_subsampled`` has.
    subsample_seed : int
        Seed of that draw.
    test_subjects : sequence of str or None
        Test subjects; None: drawn.
    test_share : float
        Share of all subjects drawn for the test, above 0 and below 1.
    test_seed : int
        Seed of that draw.
    simulate : bool
        Make ``substitute`` instead of reading.
    substitute : SimulatedSubstitute
        Settings of the simulated substitute.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Raises
    ------
    InputError
        If a setting has another value than those above.

    Notes
    -----
    ``single_session`` is one session, ``full`` all of them, ``pruned`` full without what is excluded, and
    ``full_subsampled`` as many frames of full, drawn at random, as ``subsample_to`` has. The test subjects,
    with all their frames, do not depend on the subset. Groups are subjects, where none is known sessions.
    """

    root: PathSetting
    subset: str = FULL
    session: str | None = None
    blocks: int = 5
    gap_frames: int = 5
    prune_by: str = subsets.LIST
    quality_limit: float = 3.5
    subsample_to: str = PRUNED
    subsample_seed: int = 0
    test_subjects: Sequence[str] | None = None
    test_share: float = 0.2
    test_seed: int = 0
    simulate: bool = False
    substitute: SimulatedSubstitute = field(default_factory=SimulatedSubstitute)
    cache: str | None = None
    unpaired: str = REFUSE

    def __post_init__(self) -> None:
        require_choice(self.unpaired)
        if self.test_subjects is not None:
            names = text_names("test_subjects", self.test_subjects)
            object.__setattr__(self, "test_subjects", names)
        if self.session is not None:
            object.__setattr__(self, "session", *text_names("session", [self.session]))
        choices = {
            "subset": (SINGLE, FULL, PRUNED, SUBSAMPLED),
            "prune_by": (subsets.LIST, subsets.QUALITY),
            "subsample_to": (PRUNED, SINGLE),
        }
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise InputError(
                    f"{name}: expected one of {', '.join(known)}, received {getattr(self, name)!r}"
                )
        for name, minimum in {"blocks": 2, "gap_frames": 0, "test_seed": 0, "subsample_seed": 0}.items():
            require_count(name, getattr(self, name), minimum)
        if self.test_subjects == () or not 0 < self.test_share < 1:
            raise InputError(
                f"test_share: expected above 0 and below 1, and test_subjects null or some, "
                f"received {self.test_share} and {self.test_subjects}"
            )
        QualityOutliers(self.quality_limit)

    @property
    def name(self) -> str:
        """What tables call it: with the configuration."""
        return f"san_raffaele_{f'full_as_{self.subsample_to}' if self.subset == SUBSAMPLED else self.subset}"

    def require_root(self) -> Path | None:
        """Check that the folder is there.

        Returns
        -------
        Path or None
            The folder; None where the data set is simulated.

        Raises
        ------
        InputError
            If there is none; the message says what it must hold.
        """
        if self.simulate:
            return None
        return image_files.require_root(
            self.name,
            self.root,
            "San Raffaele, private, not published",
            "<session>/images/*.png with <session>/masks/*.png of the same names, 0 background, 1 or 255 vessel; "
            "sessions.csv with columns session, subject, date, scanner, excluded; excluded.csv if there is one with "
            "columns session, frame, reason",
        )

    def __call__(self) -> LabelledFrames:
        """Read or simulate the frames of the configuration, then those of the test subjects.

        Returns
        -------
        LabelledFrames
            All of them.

        Raises
        ------
        InputError
            If a file or folder is not as expected; the message names it.
        """
        return _labelled(self)

    def test_groups(self) -> tuple[str, ...]:
        """Return the groups that every configuration keeps for the test.

        Returns
        -------
        tuple of str
            Group names, sorted.
        """
        sessions = _sessions(self)
        alone = subsets.lone_session(sessions, self.session)
        return subsets.test_groups(sessions, alone, self.test_subjects, self.test_share, self.test_seed)

    def notes(self) -> tuple[str, ...]:
        """Return what a reader of the results must know of the data.

        Returns
        -------
        tuple of str
            Sentences on test subjects, configuration and what was left out.
        """
        tested = self.test_groups()
        notes = []
        if self.simulate:
            varied = variation_note(simulated_recipes(self.substitute))
            notes = [self.substitute.note("San Raffaele"), varied]
        notes.append(f"Subjects that all configurations are tested on: {', '.join(tested)}.")
        if self.subset == SINGLE:
            notes.append(
                f"Groups to train with are {self.blocks} contiguous blocks of one session, "
                f"{self.gap_frames} frames apart: folds are not independent."
            )
        if self.subset == PRUNED:
            out = len({row["case"] for row in _chosen(self).left_out})
            rule = "the list of the excluded" if self.prune_by == subsets.LIST else "image quality"
            notes.append(f"Frames left out by {rule}: {out}.")
        if self.subset == SUBSAMPLED:
            notes.append(f"Frames of full, drawn at random to the number that {self.subsample_to} has.")
        if (root := self.require_root()) is not None:
            notes += left_over(root).notes(root)
        return tuple(notes)

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        root = self.require_root()
        return 0 if root is None else left_over(root).unpaired

    def report(self) -> Mapping[str, pd.DataFrame]:
        """Return tables of what was left out and used.

        Returns
        -------
        mapping of str to DataFrame
            ``pruned``: each frame left out with the rule, its value and its limit; ``sessions``: the frames
            used of each session.
        """
        import pandas as pd

        chosen, tested = _chosen(self), self.test_groups()
        columns = ["case", "session", "rule", "value", "limit", "measured"]
        sessions = [
            {
                "session": session.name,
                "group": session.group,
                "date": session.date,
                "scanner": session.scanner,
                "excluded": len(session.reasons),
                "frames": len(session),
                "train_frames": sum(frame.session is session for frame in chosen.frames),
                "test_frames": len(session) if session.group in tested else 0,
            }
            for session in _sessions(self)
        ]
        return {"pruned": pd.DataFrame(chosen.left_out, columns=columns), "sessions": pd.DataFrame(sessions)}


def _sessions(dataset: SanRaffaele) -> tuple[Session, ...]:
    root = dataset.require_root()
    return (
        _simulated_once(dataset.substitute)
        if root is None
        else _read_once(root, dataset.cache, dataset.unpaired, content_key(session_files(root)))
    )


@lru_cache(maxsize=1)
def _read_once(root: Path, cache: str | None, unpaired: str, content: str) -> tuple[Session, ...]:
    """Read the sessions for all configurations, of which only the choice differs, until ``content`` changes."""
    del content
    return read_sessions(root, cache, unpaired)


_simulated_once = lru_cache(maxsize=1)(simulated_sessions)


def _files(dataset: SanRaffaele) -> tuple[Path, ...]:
    root = dataset.require_root()
    return () if root is None else session_files(root)


@cached_while_unchanged(_files, maxsize=4)
def _chosen(dataset: SanRaffaele) -> Chosen:
    """Return the frames of a configuration outside the test."""
    sessions, tested = _sessions(dataset), dataset.test_groups()
    pool = subsets.frames_of([session for session in sessions if session.group not in tested])
    if dataset.subset == FULL:
        return Chosen(pool)
    if dataset.subset == SUBSAMPLED:
        return subsets.sampled(
            pool, len(_part(dataset, dataset.subsample_to, pool).frames), dataset.subsample_seed
        )
    return _part(dataset, dataset.subset, pool)


def _part(dataset: SanRaffaele, subset: str, pool: tuple[Frame, ...]) -> Chosen:
    if subset == SINGLE:
        alone = subsets.lone_session(_sessions(dataset), dataset.session)
        return subsets.in_blocks(alone, dataset.blocks, dataset.gap_frames)
    if dataset.prune_by == subsets.LIST:
        return subsets.without_listed(pool)
    return subsets.without_outliers(pool, dataset.quality_limit)


@cached_while_unchanged(_files)
def _labelled(dataset: SanRaffaele) -> LabelledFrames:
    tested = dataset.test_groups()
    test = subsets.frames_of([session for session in _sessions(dataset) if session.group in tested])
    frames = (*_chosen(dataset).frames, *test)
    return LabelledFrames(
        images=tuple(frame.session.images[frame.place] for frame in frames),
        masks=tuple(frame.session.masks[frame.place] for frame in frames),
        case_ids=tuple(frame.case for frame in frames),
        groups=tuple(frame.group for frame in frames),
        spacing_mm=tuple(frame.session.spacing_mm for frame in frames),
        simulated=dataset.simulate,
    )
