"""Record of the data sets that a network has learnt from, which its checkpoint keeps among its notes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from models.errors import InputError

# Name of the note in a checkpoint.
NOTE = "training_data"


@dataclass(frozen=True)
class TrainingData:
    """Data set that a network was trained on, whole or in part.

    Parameters
    ----------
    name : str
        Name of the data set.
    digest : str
        ``LabelledFrames.digest`` of the whole data set.
    simulated : bool, optional
        Whether it is simulated.
    licence : str, optional
        Licence of the data, which results derived from it may inherit.
    """

    name: str
    digest: str
    simulated: bool = False
    licence: str = "unknown"

    @property
    def label(self) -> str:
        """Name as results have it: a simulated data set is marked."""
        return f"{self.name} (simulated)" if self.simulated else self.name

    def overlaps(self, other: TrainingData) -> bool:
        """Tell whether two records may be of the same cases: they share the name or the digest.

        Parameters
        ----------
        other : TrainingData
            The other record.

        Returns
        -------
        bool
            True if a network trained on one may have seen cases of the other.
        """
        return self.name == other.name or self.digest == other.digest


def as_note(data: Sequence[TrainingData]) -> str:
    """Write records as the text of a checkpoint's note.

    Parameters
    ----------
    data : sequence of TrainingData
        Data sets in the order of training, each once.

    Returns
    -------
    str
        JSON.
    """
    return json.dumps([dataclasses.asdict(each) for each in dict.fromkeys(data)])


def from_notes(notes: Mapping[str, object]) -> tuple[TrainingData, ...] | None:
    """Read the records from the notes of a checkpoint.

    Parameters
    ----------
    notes : mapping
        Notes of a checkpoint.

    Returns
    -------
    tuple of TrainingData, or None
        The data sets; None where the notes do not name any.

    Raises
    ------
    InputError
        If the note is there and is of another kind.
    """
    if NOTE not in notes:
        return None
    try:
        return tuple(TrainingData(**each) for each in json.loads(str(notes[NOTE]))) or None
    except (ValueError, TypeError) as refusal:
        raise InputError(
            f"{NOTE}: expected a list of data sets in the checkpoint's notes, received {notes[NOTE]!r}"
        ) from refusal
