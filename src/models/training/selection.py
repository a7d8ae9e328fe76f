"""Which epoch of a training is kept, and since when it has not got better."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from models.errors import InputError

SELECTIONS = ("best", "smoothed", "last")
History = Sequence[Mapping[str, float]]


@dataclass(frozen=True)
class EpochSelection:
    """Rule that chooses an epoch by the validation DSC of all epochs so far.

    The validation DSC of few cases is noisy, and the highest of many noisy values is too high. The median over the
    last epochs is less so; the last epoch of a schedule that ends at a rate of zero makes no choice at all.

    Parameters
    ----------
    rule : str, optional
        ``best`` keeps the first epoch with the highest DSC, ``smoothed`` that with the highest median over it and
        the epochs before it, ``last`` the last one.
    epochs : int, optional
        Number of epochs of the median.

    Raises
    ------
    InputError
        If the rule is unknown or there is no epoch in the median.
    """

    rule: str = "best"
    epochs: int = 5

    def __post_init__(self) -> None:
        if self.rule not in SELECTIONS:
            raise InputError(f"selection: expected one of {', '.join(SELECTIONS)}, received {self.rule!r}")
        if self.epochs < 1:
            raise InputError(f"selection_epochs: expected at least 1, received {self.epochs}")

    def kept(self, history: History) -> int:
        """Choose an epoch.

        Parameters
        ----------
        history : sequence of mapping
            Measures of each epoch.

        Returns
        -------
        int
            Number of the epoch, counted from 0; -1 for an empty history.
        """
        return len(history) - 1 if self.rule == "last" else self.last_rise(history)

    def last_rise(self, history: History) -> int:
        """Find the epoch after which the criterion was never higher, from which patience counts.

        Parameters
        ----------
        history : sequence of mapping
            Measures of each epoch.

        Returns
        -------
        int
            Number of the first epoch with the highest criterion, counted from 0; -1 for an empty history. With
            ``last``, the criterion is the DSC itself.
        """
        dsc = [epoch["validation_dsc"] for epoch in history]
        if self.rule == "smoothed":
            ends = range(1, len(dsc) + 1)
            dsc = [statistics.median(dsc[max(0, end - self.epochs) : end]) for end in ends]
        return dsc.index(max(dsc)) if dsc else -1
