"""What happens before, during and after each epoch of a training: random numbers, measures, kept weights, state.

In place of Lightning's ModelCheckpoint: a checkpoint here holds the network's recipe and its preprocessing and is read
without Lightning, and a state is not written where that would take a tenth of the time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from torch import Tensor

from models.seeds import DROPOUT, seed_of
from models.training.datamodule import FoldData
from models.training.distributed import shared_report
from models.training.late_weights import LateWeights
from models.training.phase import Phase
from models.training.segmenter import Segmenter
from models.training.state import TrainingState
from models.training.throughput import Throughput, peak_memory_mb
from models.weights import Weights

# A state is written after an epoch unless that would take more than this share of the time.
STATE_SHARE = 0.1


class TrainingCallback(Callback):
    """Lightning callback that takes a training through its phase.

    Parameters
    ----------
    phase : Phase
        Epochs to train.
    data : FoldData
        Batches, seeded before each epoch.
    start : TrainingState or None
        State that the training is resumed from; None for a new one.
    save_weights : callable
        Called with the validated weights, the epoch and the validation DSC whenever that epoch is the one to keep so
        far.
    save_state : callable or None
        Called with the state and the number of the kept epoch at the end of an epoch.
    on_epoch : callable or None
        Called with each epoch's measures, those of ``start`` first.
    """

    def __init__(
        self,
        phase: Phase,
        data: FoldData,
        start: TrainingState | None,
        save_weights: Callable[[Weights, int, float], None],
        save_state: Callable[[TrainingState, int], None] | None = None,
        on_epoch: Callable[[Mapping[str, float]], None] | None = None,
    ) -> None:
        self.phase = phase
        self.data = data
        self.start = start
        self.save_weights = save_weights
        self.save_state = save_state
        self.on_epoch = on_epoch
        self.late = LateWeights(phase.settings, data.steps_per_epoch)
        if start is not None:
            self.late.restore(start.late)
        self._validated: Weights = {}
        self._averaged = ExitStack()
        self.history: list[dict[str, float]] = list(start.history) if start else []
        self._begin_s = time.perf_counter() - (start.runtime_s if start else 0.0)
        self._written_s, self._writing_s = -math.inf, 0.0
        self._throughput = Throughput(torch.device("cpu"))
        self._learning_rate = math.nan
        for report in self.history:
            self._report_epoch(report)

    @property
    def runtime_s(self) -> float:
        """Time in s that the training has taken, including that before an interruption."""
        return time.perf_counter() - self._begin_s

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Restore the state of the optimiser and of the loss scaler.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        """
        self._throughput = Throughput(pl_module.device)
        if pl_module.device.type == "cuda":
            torch.cuda.reset_peak_memory_stats(pl_module.device)
        if self.start is not None:
            # The state of each weight alone: the learning rate is that of this training's schedule.
            groups = trainer.optimizers[0].state_dict()["param_groups"]
            trainer.optimizers[0].load_state_dict({**self.start.optimiser, "param_groups": groups})
            trainer.precision_plugin.load_state_dict(dict(self.start.scaler))

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Seed all random numbers of the epoch.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        """
        epoch = len(self.history)
        self.data.begin_epoch(epoch)
        # Processes that share a batch drop other units of their parts.
        own = (self.data.share.number,) if self.data.share.number else ()
        torch.manual_seed(seed_of(self.data.seed, DROPOUT, epoch, *own))
        self._throughput.start()

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: list[Tensor], batch_idx: int
    ) -> None:
        """Record the learning rate: the schedule advances as soon as a batch is done.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        batch : list of Tensor
            Images and masks.
        batch_idx : int
            Number of the batch in the epoch.
        """
        self._learning_rate = float(trainer.optimizers[0].param_groups[0]["lr"])

    def on_train_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: object,
        batch: list[Tensor],
        batch_idx: int,
    ) -> None:
        """Count the images of a batch.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        outputs : object
            Not used.
        batch : list of Tensor
            Images and masks.
        batch_idx : int
            Number of the batch in the epoch.
        """
        assert isinstance(pl_module, Segmenter)
        images = len(batch[0]) * self.data.share.processes
        self._throughput.count(images, last=batch_idx + 1 == self.data.steps_per_epoch)
        self.late.after_step(pl_module.network)

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Put the averaged weights into the network, where there are any.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        """
        assert isinstance(pl_module, Segmenter)
        network = pl_module.network
        self.late.after_epoch(network, len(self.history))
        images = self.data.plain_training_images
        self._averaged.enter_context(self.late.in_place(network, lambda: images(pl_module.device)))

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Remember the validated weights, and put those of the last step back.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.
        """
        assert isinstance(pl_module, Segmenter)
        self._validated = {
            name: tensor.detach().clone() for name, tensor in pl_module.network.state_dict().items()
        }
        self._averaged.close()

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Record an epoch: its measures, its weights if they are to be kept, and the state; stop after the last one.

        Parameters
        ----------
        trainer : Trainer
            Lightning's trainer.
        pl_module : LightningModule
            The segmenter.

        Raises
        ------
        RuntimeError
            If the validation loss is not finite.
        """
        assert isinstance(pl_module, Segmenter)
        report = {
            "learning_rate": self._learning_rate,
            **pl_module.take_measures(),
            "images_per_s": self._throughput.images_per_s,
            "peak_memory_mb": peak_memory_mb(pl_module.device),
        }
        if self.data.share.processes > 1:
            report = shared_report(report)
        self._require_finite(report["validation_loss"])
        self.history.append(report)
        if self.phase.kept(self.history) == len(self.history) - 1:
            self.save_weights(self._validated, len(self.history) - 1, report["validation_dsc"])
        trainer.should_stop = self.phase.is_over(self.history)
        self._write_state(trainer, pl_module)
        self._report_epoch(report)

    def _report_epoch(self, report: Mapping[str, float]) -> None:
        if self.on_epoch is not None:
            self.on_epoch(report)

    def _write_state(self, trainer: Trainer, module: Segmenter) -> None:
        now_s = time.perf_counter()
        due = STATE_SHARE * (now_s - self._written_s) >= self._writing_s
        if self.save_state is None or not (due or trainer.should_stop):
            return
        weights = {name: tensor.detach().cpu() for name, tensor in module.network.state_dict().items()}
        optimiser = trainer.optimizers[0].state_dict()
        scaler = trainer.precision_plugin.state_dict()
        late = self.late.state()
        state = TrainingState(tuple(self.history), weights, optimiser, scaler, self.runtime_s, late)
        self.save_state(state, self.phase.kept(self.history))
        self._written_s = time.perf_counter()
        self._writing_s = self._written_s - now_s

    def _require_finite(self, loss: float) -> None:
        if not math.isfinite(loss):
            raise RuntimeError(
                f"training diverged: expected a finite validation loss, received {loss} after "
                f"{len(self.history) + 1} epochs; a lower learning_rate may help"
            )
