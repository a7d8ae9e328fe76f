"""What a training step and a validation are, for Lightning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from torch import Tensor, nn

from models.losses import DiceCrossEntropy
from models.trainer_settings import TrainerSettings


class Segmenter(LightningModule):
    """A network with its loss and its optimiser; validation gives ``validation_dsc`` and ``validation_loss``.

    The validation DSC is the mean over images with a vessel at the network's size, thresholded at 0.5.
    """

    def __init__(
        self, network: nn.Module, loss: DiceCrossEntropy, settings: TrainerSettings, steps_per_epoch: int
    ) -> None:
        super().__init__()
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.loss = loss
        self.settings = settings
        self.steps_per_epoch = steps_per_epoch
        self._losses: dict[str, list[Tensor]] = {"train_loss": [], "validation_loss": []}
        self._dsc: list[Tensor] = []

    def training_step(self, batch: list[Tensor], batch_idx: int) -> Tensor:
        """The loss of a batch."""
        loss = self.loss(self.network(batch[0]), batch[1])
        self._losses["train_loss"].append(loss.detach())
        return loss

    def validation_step(self, batch: list[Tensor], batch_idx: int) -> None:
        """Collect each image's DSC, and the loss."""
        logits, masks = self.network(batch[0]), batch[1]
        self._losses["validation_loss"].append(self.loss(logits, masks))
        predicted = (logits > 0).float()
        overlap = (predicted * masks).sum(dim=(1, 2, 3))
        reference = masks.sum(dim=(1, 2, 3))
        dsc = 2 * overlap / (predicted.sum(dim=(1, 2, 3)) + reference).clamp_min(1)
        self._dsc.append(dsc[reference > 0])

    def on_validation_epoch_end(self) -> None:
        """Give early stopping its measure."""
        self.log("validation_dsc", torch.cat(self._dsc).mean())
        self._dsc = []

    def configure_optimizers(self) -> Any:
        """AdamW under a warm-up and a cosine, stepped batch by batch."""
        settings, steps = self.settings, self.steps_per_epoch
        optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimiser, lambda step: settings.learning_rate_factor(step, steps)
        )
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def take_losses(self) -> dict[str, float]:
        """The mean losses since the last call."""
        means = {name: float(torch.stack(values).mean()) for name, values in self._losses.items() if values}
        self._losses = {name: [] for name in self._losses}
        return means


class EpochReports(Callback):
    """Keeps each epoch's measures, saves the weights where the validation DSC is the best so far, and reports."""

    def __init__(
        self,
        save_best: Callable[[nn.Module, int, float], None],
        on_epoch: Callable[[Mapping[str, float]], None] | None,
    ) -> None:
        self.save_best = save_best
        self.on_epoch = on_epoch
        self.history: list[dict[str, float]] = []
        self.best_epoch = -1
        self.best_dsc = -1.0

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Called after the epoch's training and validation."""
        assert isinstance(pl_module, Segmenter)
        dsc = float(trainer.callback_metrics["validation_dsc"])
        report = {
            "learning_rate": float(trainer.optimizers[0].param_groups[0]["lr"]),
            **pl_module.take_losses(),
            "validation_dsc": dsc,
        }
        self.history.append(report)
        if dsc > self.best_dsc:
            self.best_epoch, self.best_dsc = trainer.current_epoch, dsc
            self.save_best(pl_module.network, self.best_epoch, dsc)
        if self.on_epoch is not None:
            self.on_epoch(report)
