"""What a benchmark case shows of its sweep: all of it, a piece, a sweep with gaps, or one with outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64

from registration.checks import require_at_least, require_positive
from registration.errors import InputError

PLACES = ("start", "middle", "end")
# Half of the frames that are missing lie in so many gaps, the other half are scattered.
GAPS = 2


@dataclass(frozen=True)
class Kind:
    """One kind of case.

    Parameters
    ----------
    name : str
        Name of the kind.
    share : float, optional
        Share of the sweep's frames that is used, above 0 to 1.
    places : tuple of str, optional
        Parts of the sweep that may be used, of ``start``, ``middle`` and ``end``; one is drawn.
    missing_share : float, optional
        Share of these frames that is lost, half in two gaps and half one by one; at most 0.9.
    outlier_share : float, optional
        Share of the points that are outliers, at most 0.9.

    Raises
    ------
    InputError
        If a share is out of range or a place is unknown.
    """

    name: str
    share: float = 1.0
    places: tuple[str, ...] = ("middle",)
    missing_share: float = 0.0
    outlier_share: float = 0.0

    def __post_init__(self) -> None:
        require_positive("share", self.share, 1.0)
        require_at_least("missing_share", self.missing_share, 0.0)
        require_at_least("outlier_share", self.outlier_share, 0.0)
        if not self.places or not set(self.places) <= set(PLACES):
            raise InputError(f"places: expected some of {', '.join(PLACES)}, received {self.places!r}")
        if self.missing_share > 0.9 or self.outlier_share > 0.9:
            raise InputError(
                f"missing_share, outlier_share: expected at most 0.9, received {self.missing_share:g} "
                f"and {self.outlier_share:g}"
            )

    def choose(self, frames: int, rng: np.random.Generator) -> tuple[str, Int64[np.ndarray, " k"]]:
        """Draw the part of the sweep and the frames that a case of this kind uses.

        Parameters
        ----------
        frames : int
            Number of frames of the sweep.
        rng : numpy.random.Generator
            Random stream of the choice.

        Returns
        -------
        place : str
            Part of the sweep.
        kept : ndarray of int, shape (k,)
            Indices of the frames that are used, in increasing order.
        """
        place = str(self.places[int(rng.integers(len(self.places)))])
        length = round(self.share * frames)
        begin = round((frames - length) * PLACES.index(place) / 2)
        kept = np.arange(begin, begin + length, dtype=np.int64)
        lost = round(self.missing_share * length)
        return place, np.delete(kept, _missing(length, lost, rng)) if lost else kept


KINDS = (
    Kind("whole"),
    Kind("piece80", 0.8, PLACES),
    Kind("piece60_end", 0.6, ("start", "end")),
    Kind("piece60_middle", 0.6),
    Kind("piece40_end", 0.4, ("start", "end")),
    Kind("piece40_middle", 0.4),
    Kind("outliers", outlier_share=0.1),
    Kind("missing", missing_share=0.3),
)


def kind_named(name: str) -> Kind:
    """Return the kind of a name.

    Parameters
    ----------
    name : str
        Name of the kind.

    Returns
    -------
    Kind
        The kind.

    Raises
    ------
    InputError
        If no kind has that name; the message lists them.
    """
    found = next((kind for kind in KINDS if kind.name == name), None)
    if found is None:
        raise InputError(f"kind: expected one of {', '.join(kind.name for kind in KINDS)}, received {name!r}")
    return found


def _missing(frames: int, lost: int, rng: np.random.Generator) -> np.ndarray:
    """Which frames are lost: gaps that do not meet, one in each equal part of the sweep, and single ones between."""
    gone = np.zeros(frames, dtype=bool)
    part, gap = frames // GAPS, lost // (2 * GAPS)
    for number in range(GAPS):
        begin = number * part + int(rng.integers(0, max(part - gap, 0) + 1))
        gone[begin : begin + gap] = True
    scattered = rng.choice(np.flatnonzero(~gone), size=lost - int(gone.sum()), replace=False)
    gone[scattered] = True
    return np.flatnonzero(gone)
