"""The optional table of Mus-V that says whose a sequence is and where on the body it was taken."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from experiments.datasets.csv_tables import read_table
from experiments.errors import InputError

ALL = "all"
DISTRICTS = ("carotid", "femoral")


@dataclass(frozen=True)
class Volunteer:
    """Who was recorded in a sequence, and where on the body.

    Parameters
    ----------
    name : str
        The volunteer.
    district : {'carotid', 'femoral'}
        The part of the body.
    """

    name: str
    district: str


def read_volunteers(path: Path, sequences: Collection[str]) -> dict[str, Volunteer]:
    """Read the volunteer of each sequence.

    Parameters
    ----------
    path : Path
        CSV with columns seq, volunteer, district.
    sequences : collection of str
        Sequences that must be in the table; it may have more.

    Returns
    -------
    dict of str to Volunteer
        Volunteers by sequence.

    Raises
    ------
    InputError
        If a row is missing, twice there or not as expected; the message names the sequence.
    """
    found: dict[str, Volunteer] = {}
    for row in read_table(path.expanduser(), ("seq", "volunteer", "district")):
        sequence, volunteer, district = row["seq"], row["volunteer"], row["district"]
        if sequence in found:
            raise InputError(f"{path}: expected one row for sequence {sequence!r}, found two")
        if not volunteer:
            raise InputError(f"{path}: expected a volunteer for sequence {sequence!r}, received none")
        if district not in DISTRICTS:
            raise InputError(
                f"{path}: expected district {' or '.join(DISTRICTS)} for sequence {sequence!r}, "
                f"received {district!r}"
            )
        found[sequence] = Volunteer(volunteer, district)
    missing = next((sequence for sequence in sorted(sequences) if sequence not in found), None)
    if missing is not None:
        raise InputError(f"{path}: expected a row for sequence {missing!r}, found none")
    return found
