"""What a training step and a validation are, for Lightning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR

from models.training.deep_supervision import training_loss
from models.training.losses import Loss
from models.training.settings import TrainerSettings


class Segmenter(LightningModule):
    """A network with its loss, its optimiser and its learning rate schedule.

    The validation DSC is the mean over images with a vessel at the network's size, thresholded at 0.5.

    Parameters
    ----------
    network : nn.Module
        Images (b, 1, h, w) to logits of the same shape, or in training to ``SideOutputs``.
    loss : Loss
        Loss of logits and masks.
    settings : TrainerSettings
        Highest learning rate and weight decay.
    learning_rate_factor : callable
        Factor of the highest learning rate at a step of the training, counted from its very beginning.
    step : int
        Number of the next step, which is not 0 where a training is resumed.
    """

    def __init__(
        self,
        network: nn.Module,
        loss: Loss,
        settings: TrainerSettings,
        learning_rate_factor: Callable[[int], float],
        step: int = 0,
    ) -> None:
        super().__init__()
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.loss = loss
        self.settings = settings
        self.learning_rate_factor = learning_rate_factor
        self.first_step = step
        self._losses: dict[str, list[Tensor]] = {"train_loss": [], "validation_loss": []}
        self._dsc: list[Tensor] = []

    def configure_optimizers(self) -> dict[str, Any]:
        """Set up AdamW, and the schedule that sets its learning rate before each step.

        Returns
        -------
        dict
            Optimiser and scheduler as Lightning takes them.
        """
        optimiser = torch.optim.AdamW(
            self.network.parameters(),
            lr=self.settings.learning_rate,
            weight_decay=self.settings.weight_decay,
        )
        schedule = LambdaLR(optimiser, lambda step: self.learning_rate_factor(self.first_step + step))
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def training_step(self, batch: list[Tensor], batch_idx: int) -> Tensor:
        """Compute the loss of a training batch.

        Parameters
        ----------
        batch : list of Tensor
            Images and masks, shape (b, 1, h, w), and the weight of their loss where they are part of a batch.
        batch_idx : int
            Not used.

        Returns
        -------
        Tensor, shape ()
            Loss.
        """
        loss = training_loss(self.loss, self.network(batch[0]), batch[1])
        if len(batch) > 2:
            loss = loss * batch[2]
        self._losses["train_loss"].append(loss.detach())
        return loss

    def validation_step(self, batch: list[Tensor], batch_idx: int) -> None:
        """Collect the DSC of each image and the loss of a validation batch.

        Parameters
        ----------
        batch : list of Tensor
            Images and masks, shape (b, 1, h, w).
        batch_idx : int
            Not used.
        """
        logits, masks = self.network(batch[0]), batch[1]
        self._losses["validation_loss"].append(training_loss(self.loss, logits, masks))
        predicted = (logits > 0).float()
        overlap = (predicted * masks).sum(dim=(1, 2, 3))
        reference = masks.sum(dim=(1, 2, 3))
        dsc = 2 * overlap / (predicted.sum(dim=(1, 2, 3)) + reference).clamp_min(1)
        self._dsc.append(dsc[reference > 0])

    def take_measures(self) -> dict[str, float]:
        """Return the mean losses and the validation DSC since the last call.

        Returns
        -------
        dict of str to float
            ``train_loss``, ``validation_loss`` and ``validation_dsc``, where there are any.
        """
        measures = {
            name: float(torch.stack(values).mean()) for name, values in self._losses.items() if values
        }
        if self._dsc:
            measures["validation_dsc"] = float(torch.cat(self._dsc).mean())
        self._losses = {name: [] for name in self._losses}
        self._dsc = []
        return measures
