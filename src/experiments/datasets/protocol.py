"""The interface of a data set. Only calling it for the frames is required; the rest is optional.

``name``, ``root`` and ``require_root()`` are those of a data set on disk; ``notes()`` are sentences that readers of
its results must know; ``left_out()`` counts images and masks without a partner; ``selection_groups()`` and
``test_groups()`` are groups that it keeps outside all folds; ``report()`` are tables of what it left out and why;
``licence`` names the licence of the data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.files import write_text
from experiments.outcome import InputData
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    from models.training.training_data import TrainingData

DataSet = Callable[[], LabelledFrames]
NOTES = "dataset_notes.txt"


def name_of(dataset: DataSet) -> str:
    """Return the name that tables use for a data set.

    Parameters
    ----------
    dataset : DataSet
        Any data set.

    Returns
    -------
    str
        Its ``name``, else its class in lower case.
    """
    return str(getattr(dataset, "name", type(dataset).__name__.lower()))


def reported_name(dataset: DataSet) -> str:
    """Return the name as results have it: marked where images or masks without a partner were left out.

    Parameters
    ----------
    dataset : DataSet
        Any data set.

    Returns
    -------
    str
        The name, with the number of unpaired files where there are some.
    """
    left_out = getattr(dataset, "left_out", None)
    count = 0 if left_out is None else int(left_out())
    return f"{name_of(dataset)} ({count} unpaired left out)" if count else name_of(dataset)


def label_of(dataset: DataSet, frames: LabelledFrames) -> str:
    """Return the name as results have it, marked where the frames are simulated.

    Parameters
    ----------
    dataset : DataSet
        Any data set.
    frames : LabelledFrames
        Its frames.

    Returns
    -------
    str
        The name with ``(simulated)``, else ``reported_name``.
    """
    return f"{name_of(dataset)} (simulated)" if frames.simulated else reported_name(dataset)


def require_root(dataset: DataSet) -> None:
    """Check that the data set's folder is there; one that is on no disk passes.

    Parameters
    ----------
    dataset : DataSet
        Any data set; its own ``require_root`` raises InputError for a missing folder.
    """
    if (check := getattr(dataset, "require_root", None)) is not None:
        check()


def notes_of(dataset: DataSet) -> tuple[str, ...]:
    """Return the sentences on what the groups of a data set are and what is not known of it.

    Parameters
    ----------
    dataset : DataSet
        A data set whose frames were read.

    Returns
    -------
    tuple of str
        Its notes; none where it has no ``notes``.
    """
    notes = getattr(dataset, "notes", None)
    return () if notes is None else tuple(notes())


def write_notes(folder: Path, *datasets: DataSet) -> None:
    """Write the notes of data sets, one a line after the data set's name and a tab, where there are any.

    Parameters
    ----------
    folder : Path
        A job's workspace, which gets ``dataset_notes.txt``.
    *datasets : DataSet
        Data sets whose frames were read.
    """
    lines = [f"{name_of(dataset)}\t{note}\n" for dataset in datasets for note in notes_of(dataset)]
    if lines:
        write_text(folder / NOTES, "".join(lines))


def read_notes(folders: Iterable[Path]) -> tuple[str, ...]:
    """Read the notes that the jobs of a study wrote.

    Parameters
    ----------
    folders : iterable of Path
        Workspaces of jobs; those of data sets without notes have no such file.

    Returns
    -------
    tuple of str
        Each note once, in the order in which it is first found; after the name where there are several data sets.
    """
    files = [folder / NOTES for folder in folders]
    lines = [line for file in files if file.is_file() for line in file.read_text("utf-8").splitlines()]
    notes = [line.split("\t", 1) for line in dict.fromkeys(lines)]
    several = len({name for name, _ in notes}) > 1
    return tuple(f"{name}: {note}" if several else note for name, note in notes)


def write_report(dataset: object, folder: Path) -> tuple[Path, ...]:
    """Write the tables of what a data set left out and why.

    Parameters
    ----------
    dataset : DataSet
        Any data set; one without ``report`` has no tables.
    folder : Path
        Where ``<name>.csv`` is written for each table.

    Returns
    -------
    tuple of Path
        The files written.
    """
    report = getattr(dataset, "report", None)
    if report is None:
        return ()
    written = []
    for name, table in report().items():
        path = folder / f"{name}.csv"
        write_text(path, table.to_csv(index=False))
        written.append(path)
    return tuple(written)


def outside_groups(dataset: DataSet) -> dict[str, tuple[str, ...]]:
    """Return the groups that the data set keeps outside all folds, as a split takes them.

    Parameters
    ----------
    dataset : DataSet
        Any data set.

    Returns
    -------
    dict of str to tuple of str
        ``selection_groups`` and ``test_groups``.
    """
    roles = {}
    for role in ("selection_groups", "test_groups"):
        groups = getattr(dataset, role, None)
        roles[role] = () if groups is None else tuple(groups())
    return roles


def training_data(dataset: DataSet, frames: LabelledFrames) -> TrainingData:
    """Describe the data set as a checkpoint keeps it.

    Parameters
    ----------
    dataset : DataSet
        Any data set; its own ``licence`` names the licence.
    frames : LabelledFrames
        All of its frames.

    Returns
    -------
    TrainingData
        Name, digest, whether it is simulated, and licence.
    """
    from models.training.training_data import TrainingData

    licence = "none (simulated)" if frames.simulated else str(getattr(dataset, "licence", "unknown"))
    return TrainingData(name_of(dataset), frames.digest(), frames.simulated, licence)


def input_data(dataset: DataSet, frames: LabelledFrames) -> InputData:
    """Describe the data set as the tracker logs it.

    Parameters
    ----------
    dataset : DataSet
        Any data set.
    frames : LabelledFrames
        Its frames, which the digest is of.

    Returns
    -------
    InputData
        Name, digest and folder; ``simulator`` where it is on no disk.
    """
    # A simulated substitute has the root of the real set, which it did not read.
    root = None if getattr(dataset, "simulate", False) else getattr(dataset, "root", None)
    return InputData(name_of(dataset), frames.digest(), "simulator" if root is None else str(root))
