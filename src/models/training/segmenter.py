"""What a training step and a validation are, for Lightning."""

from __future__ import annotations

from collections.abc import Callable

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from models.training.deep_supervision import training_loss
from models.training.losses import Loss
from models.training.settings import TrainerSettings


class Segmenter(LightningModule):
    """A network with its loss and its optimiser.

    ``learning_rate_at`` gives the rate of a step; ``step`` is the number of the next one, which is not 0 where a
    training goes on. The validation DSC is the mean over images with a vessel at the network's size, thresholded at
    0.5.
    """

    def __init__(
        self,
        network: nn.Module,
        loss: Loss,
        settings: TrainerSettings,
        learning_rate_at: Callable[[int], float],
        step: int = 0,
    ) -> None:
        super().__init__()
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.loss = loss
        self.settings = settings
        self.learning_rate_at = learning_rate_at
        self.step = step
        self._losses: dict[str, list[Tensor]] = {"train_loss": [], "validation_loss": []}
        self._dsc: list[Tensor] = []
        self._optimiser: torch.optim.Optimizer | None = None

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """AdamW; its learning rate is set before each step."""
        self._optimiser = torch.optim.AdamW(
            self.network.parameters(),
            lr=self.settings.learning_rate,
            weight_decay=self.settings.weight_decay,
        )
        return self._optimiser

    def on_train_batch_start(self, batch: list[Tensor], batch_idx: int) -> None:
        """Set the learning rate of the step."""
        assert self._optimiser is not None
        for group in self._optimiser.param_groups:
            group["lr"] = self.learning_rate_at(self.step)

    def training_step(self, batch: list[Tensor], batch_idx: int) -> Tensor:
        """The loss of a batch."""
        loss = training_loss(self.loss, self.network(batch[0]), batch[1])
        self._losses["train_loss"].append(loss.detach())
        self.step += 1
        return loss

    def validation_step(self, batch: list[Tensor], batch_idx: int) -> None:
        """Collect each image's DSC, and the loss."""
        logits, masks = self.network(batch[0]), batch[1]
        self._losses["validation_loss"].append(training_loss(self.loss, logits, masks))
        predicted = (logits > 0).float()
        overlap = (predicted * masks).sum(dim=(1, 2, 3))
        reference = masks.sum(dim=(1, 2, 3))
        dsc = 2 * overlap / (predicted.sum(dim=(1, 2, 3)) + reference).clamp_min(1)
        self._dsc.append(dsc[reference > 0])

    def take_measures(self) -> dict[str, float]:
        """The mean losses and the validation DSC since the last call: ``train_loss``, ``validation_loss``,
        ``validation_dsc``."""
        measures = {
            name: float(torch.stack(values).mean()) for name, values in self._losses.items() if values
        }
        if self._dsc:
            measures["validation_dsc"] = float(torch.cat(self._dsc).mean())
        self._losses = {name: [] for name in self._losses}
        self._dsc = []
        return measures
