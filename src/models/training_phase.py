"""From which epoch to which a training goes: the training itself, or the extension of a finished one.

In place of Lightning's EarlyStopping: the same rule must tell from a saved history whether a training is finished,
before there is a trainer, and patience counts anew in an extension.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from models.trainer_settings import EXTENSION_FACTOR, TrainerSettings

History = Sequence[Mapping[str, float]]


def best_epoch(history: History) -> int:
    """The first epoch with the highest validation DSC; -1 before the first epoch."""
    dsc = [epoch["validation_dsc"] for epoch in history]
    return dsc.index(max(dsc)) if dsc else -1


@dataclass(frozen=True)
class Phase:
    """The epochs from ``first`` (0, or where an extension begins) to before ``end``."""

    first: int
    end: int
    settings: TrainerSettings

    @staticmethod
    def whole(settings: TrainerSettings) -> Phase:
        """A training from its first epoch on."""
        return Phase(0, settings.max_epochs, settings)

    def extension(self, history: History) -> Phase:
        """What follows on this phase, which is over with ``history``."""
        return Phase(len(history), len(history) + self.settings.extend_epochs, self.settings)

    def is_over(self, history: History) -> bool:
        """Whether the last epoch is done, or the validation DSC has not risen for ``patience`` epochs."""
        waited_since = max(best_epoch(history), self.first - 1)
        return len(history) >= self.end or len(history) - 1 - waited_since >= self.settings.patience

    def learning_rate_factor(self, step: int, steps_per_epoch: int) -> float:
        """The factor of the highest learning rate at a step of the training, counted from its very beginning."""
        return EXTENSION_FACTOR if self.first else self.settings.learning_rate_factor(step, steps_per_epoch)
