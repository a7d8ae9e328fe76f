"""From which epoch to which a training goes: the training itself, or the extension of a finished one.

In place of Lightning's EarlyStopping: the same rule must tell from a saved history whether a training is finished,
before there is a trainer, and patience counts anew in an extension.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from models.training.selection import History
from models.training.settings import EXTENSION_FACTOR, TrainerSettings


@dataclass(frozen=True)
class Phase:
    """Range of epochs to train.

    Parameters
    ----------
    first : int
        First epoch: 0, or where an extension begins.
    end : int
        Epoch after the last one.
    settings : TrainerSettings
        Settings of the training.
    """

    first: int
    end: int
    settings: TrainerSettings

    @staticmethod
    def whole(settings: TrainerSettings) -> Phase:
        """Create the phase of a training from its first epoch.

        Parameters
        ----------
        settings : TrainerSettings
            Settings of the training.

        Returns
        -------
        Phase
            All its epochs.
        """
        return Phase(0, settings.max_epochs, settings)

    def extension(self, history: History) -> Phase:
        """Create the phase that extends this one.

        Parameters
        ----------
        history : sequence of mapping
            Measures of all epochs of this phase, which is over.

        Returns
        -------
        Phase
            The epochs after it.
        """
        return Phase(len(history), len(history) + self.settings.extend_epochs, self.settings)

    def kept(self, history: History) -> int:
        """Choose the epoch whose weights are kept.

        Parameters
        ----------
        history : sequence of mapping
            Measures of the epochs so far.

        Returns
        -------
        int
            Number of the epoch, counted from 0; -1 for an empty history.
        """
        return self.settings.epoch_selection.kept(history)

    def is_over(self, history: History) -> bool:
        """Tell whether the last epoch is done, or the criterion of the epochs has not risen for ``patience`` epochs.

        Parameters
        ----------
        history : sequence of mapping
            Measures of the epochs so far.

        Returns
        -------
        bool
            True if there is nothing more to train.
        """
        waited_since = max(self.settings.epoch_selection.last_rise(history), self.first - 1)
        return len(history) >= self.end or len(history) - 1 - waited_since >= self.settings.patience

    def learning_rate_factor(self, step: int, steps_per_epoch: int) -> float:
        """Compute the factor of the highest learning rate at a step.

        Parameters
        ----------
        step : int
            Step, counted from the very beginning of the training.
        steps_per_epoch : int
            Number of batches in an epoch.

        Returns
        -------
        float
            Factor, 0 to 1.
        """
        return EXTENSION_FACTOR if self.first else self.settings.learning_rate_factor(step, steps_per_epoch)


@dataclass(frozen=True)
class Progressed:
    """How far a training has come.

    Parameters
    ----------
    phase : Phase
        Its epochs.
    history : tuple of mapping
        Measures of each epoch that is done.
    runtime_s : float
        Time in s that it has taken, including that before an interruption.
    """

    phase: Phase
    history: tuple[Mapping[str, float], ...]
    runtime_s: float
