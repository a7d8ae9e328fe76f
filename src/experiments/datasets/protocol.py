"""What a data set says of itself beside its frames. Only calling it for the frames is required; the rest is optional.

``name``, ``root`` and ``require_root()`` are those of a data set on disk; ``notes()`` are sentences that whoever reads
its results must know; ``left_out()`` counts images and masks without a partner; ``selection_groups()`` and
``test_groups()`` are groups that it keeps outside all folds.
"""

from __future__ import annotations

from collections.abc import Callable

from experiments.outcome import InputData
from models.labelled_frames import LabelledFrames

DataSet = Callable[[], LabelledFrames]


def name_of(dataset: DataSet) -> str:
    """The name that tables call a data set by."""
    return str(getattr(dataset, "name", type(dataset).__name__.lower()))


def reported_name(dataset: DataSet) -> str:
    """The name as results have it: marked where images or masks were left out because they had no partner."""
    left_out = getattr(dataset, "left_out", None)
    count = 0 if left_out is None else int(left_out())
    return f"{name_of(dataset)} ({count} unpaired left out)" if count else name_of(dataset)


def label_of(dataset: DataSet, frames: LabelledFrames) -> str:
    """The name as results have it, marked where the frames are simulated."""
    return f"{name_of(dataset)} (simulated)" if frames.simulated else reported_name(dataset)


def require_root(dataset: DataSet) -> None:
    """Raise InputError if the data set's folder is not there."""
    if (check := getattr(dataset, "require_root", None)) is not None:
        check()


def notes_of(dataset: DataSet) -> tuple[str, ...]:
    """Sentences on what its groups are and what can't be known of it; after its frames were read."""
    notes = getattr(dataset, "notes", None)
    return () if notes is None else tuple(notes())


def outside_groups(dataset: DataSet) -> dict[str, tuple[str, ...]]:
    """``selection_groups`` and ``test_groups`` as a split takes them: what the data set keeps outside all folds."""
    roles = {}
    for role in ("selection_groups", "test_groups"):
        groups = getattr(dataset, role, None)
        roles[role] = () if groups is None else tuple(groups())
    return roles


def input_data(dataset: DataSet, frames: LabelledFrames) -> InputData:
    """The data set as the tracker logs it."""
    # A simulated substitute has the root of the real set, which it did not read.
    root = None if getattr(dataset, "simulate", False) else getattr(dataset, "root", None)
    return InputData(name_of(dataset), frames.digest(), "simulator" if root is None else str(root))
