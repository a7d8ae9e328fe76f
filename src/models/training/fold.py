"""Training of one fold: the same first weights for all folds, one epoch kept, resumed where it stopped."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from models.atomic import atomic_write
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.processor import fixed_threads
from models.seeds import TRAINING, seed_of
from models.training.phase import Phase, Progressed
from models.training.spec import FoldTraining
from models.training.state import TrainingFolder, TrainingState
from models.training.training_data import NOTE, as_note
from models.weights import Weights

if TYPE_CHECKING:
    from models.training.sampling import Share

OnEpoch = Callable[[Mapping[str, float]], None]


@dataclass(frozen=True)
class TrainedFold:
    """Result of a training.

    Parameters
    ----------
    checkpoint : Path
        File with the weights of the kept epoch.
    history : tuple of mapping
        Measures of each epoch.
    best_epoch : int
        Number of the kept epoch, counted from 0: the best by the rule of the settings.
    best_validation_dsc : float
        Its validation DSC, 0 to 1.
    runtime_s : float
        Time in s, including that before an interruption.
    """

    checkpoint: Path
    history: tuple[Mapping[str, float], ...]
    best_epoch: int
    best_validation_dsc: float
    runtime_s: float


def train_fold(
    training: FoldTraining,
    *,
    directory: Path,
    state_directory: Path | None = None,
    on_epoch: OnEpoch | None = None,
    on_wait: Callable[[], None] | None = None,
) -> TrainedFold:
    """Train a network and keep the weights of the epoch that ``training.trainer`` selects in ``directory/model.pt``.

    The first weights are those of ``training.start``, the same for every fold; shuffling, augmentation and dropout
    depend on the seed, the fold and the number of the epoch. The result does not depend on the number of cores, nor
    on what else runs on them: torch computes with ``training.trainer.threads`` threads meanwhile.

    The notes of the checkpoint are ``seed``, ``fold``, ``epoch``, ``validation_dsc``, ``late_weights``, ``init``,
    ``start`` (the digest of the weights that the training began from), ``start_source`` and, where known,
    ``training_data``.

    Parameters
    ----------
    training : FoldTraining
        What is trained on what, and how.
    directory : Path
        Folder for ``model.pt``.
    state_directory : Path or None
        Folder in which this very training keeps what ``resume`` and ``extend_epochs`` of ``training.trainer``
        continue from; None keeps nothing.
    on_epoch : callable or None
        Called with each epoch's measures; in a resumed training, with those of the earlier epochs first.
    on_wait : callable or None
        Called once where another process is at this very training in ``state_directory``. Its result is taken
        when it ends, and what it left is continued if it ends early.

    Returns
    -------
    TrainedFold
        The checkpoint and the history.

    Raises
    ------
    InputError
        If the state is of another training or there is no finished one to extend.
    RuntimeError
        If the training diverges.
    """
    with fixed_threads(training.trainer.threads):
        return _train(training, directory, state_directory, on_epoch, on_wait)


def _train(
    training: FoldTraining,
    directory: Path,
    state_directory: Path | None,
    on_epoch: OnEpoch | None,
    on_wait: Callable[[], None] | None,
) -> TrainedFold:
    settings = training.trainer
    path = directory / "model.pt"
    if state_directory is None:
        if settings.resume or settings.extend_epochs:
            raise InputError(
                "state_directory: expected the folder that the training keeps its state in, received none"
            )
        whole = Phase.whole(settings)
        return _trained(_run(training, whole, None, directory, partial(_always, path), None, on_epoch), path)
    folder = TrainingFolder(state_directory, training.fingerprint)
    with folder.locked(on_wait) as waited:
        phase, start, own = _where_to_begin(folder, training, afresh=not (settings.resume or waited))
        weights = {True: own.weights_path, False: folder.weights_path}
        done = _run(training, phase, start, directory, own.weights_path, own, on_epoch)
        kept = phase.kept(done.history)
        with atomic_write(path) as temporary:
            shutil.copyfile(weights[kept >= phase.first](kept), temporary)
    return _trained(done, path)


def _where_to_begin(
    folder: TrainingFolder, training: FoldTraining, *, afresh: bool
) -> tuple[Phase, TrainingState | None, TrainingFolder]:
    """The epochs to train, what they continue from, and the folder for their state, cleared if ``afresh``."""
    settings = training.trainer
    phase = Phase.whole(settings)
    if not settings.extend_epochs:
        if afresh:
            folder.clear()
        return phase, folder.load(), folder
    base = folder.load()
    if base is None or not phase.is_over(base.history):
        done = 0 if base is None else len(base.history)
        raise InputError(
            f"extend_epochs: expected a finished training of these settings in {folder.path}, "
            f"received one with {done} of {settings.max_epochs} epochs done"
        )
    extension = phase.extension(base.history)
    extended = folder.extended
    if afresh:
        extended.clear()
    start = extended.load()
    if start is None or len(start.history) > extension.end:
        start = base
    return extension, start, extended


def _run(
    training: FoldTraining,
    phase: Phase,
    start: TrainingState | None,
    directory: Path,
    weights_path: Callable[[int], Path],
    folder: TrainingFolder | None,
    on_epoch: OnEpoch | None,
) -> Progressed:
    """Train the epochs of a phase that are not done, on one device here, or on several in a process for each."""
    if training.trainer.devices == 1:
        return run_share(training, phase, start, directory, weights_path, folder, on_epoch)
    from models.training.distributed import run_shared

    arguments = (training, phase, start, directory, weights_path, folder)
    return run_shared(run_share, arguments, training.trainer.devices, on_epoch)


def run_share(
    training: FoldTraining,
    phase: Phase,
    start: TrainingState | None,
    directory: Path,
    weights_path: Callable[[int], Path],
    folder: TrainingFolder | None,
    on_epoch: OnEpoch | None,
    share: Share | None = None,
) -> Progressed:
    """Train the epochs of a phase that are not done, in this process.

    Parameters
    ----------
    training : FoldTraining
        What is trained on what, and how.
    phase : Phase
        Epochs to train.
    start : TrainingState or None
        State that the training is resumed from.
    directory : Path
        Lightning's default folder, to which nothing is written.
    weights_path : callable
        Gives the file for the weights of an epoch.
    folder : TrainingFolder or None
        Where the state is kept.
    on_epoch : callable or None
        Called with each epoch's measures.
    share : Share or None, optional
        Which part of each batch is this process's; only the first process writes. None for the whole.

    Returns
    -------
    Progressed
        The measures of all epochs.
    """
    # Lightning takes seconds to import: whoever only wants the settings' classes should not wait for it.
    from models.training.callback import TrainingCallback
    from models.training.datamodule import FoldData
    from models.training.sampling import WHOLE
    from models.training.segmenter import Segmenter
    from models.training.trainer import fit, lightning_trainer, quiet, reproducible

    settings, share = training.trainer, share or WHOLE
    data = FoldData(
        training.train,
        training.validation,
        training.preprocessing,
        training.augmentation,
        settings.batch_size,
        seed_of(training.seed, TRAINING, training.fold),
        settings.empty_weight,
        training.targets,
        share,
    )
    writes = share.number == 0
    save_weights = _writer(training, weights_path) if writes else _write_nothing
    save_state = folder.save if folder and writes else None
    callback = TrainingCallback(phase, data, start, save_weights, save_state, on_epoch)
    if not phase.is_over(callback.history):
        steps = data.steps_per_epoch
        network = training.start.network(training.model)
        if start is not None:
            network.load_state_dict(dict(start.weights))
        rate = partial(_rate, phase, steps)
        module = Segmenter(network, training.loss, settings, rate, step=len(callback.history) * steps)
        with reproducible(settings), quiet():
            trainer = lightning_trainer(settings, callback, phase.end - len(callback.history), directory)
            fit(trainer, module, data)
    return Progressed(phase, tuple(callback.history), callback.runtime_s)


def _rate(phase: Phase, steps_per_epoch: int, step: int) -> float:
    return phase.learning_rate_factor(step, steps_per_epoch)


def _write_nothing(weights: Weights, epoch: int, dsc: float) -> None:
    """Leave the weights to the first process."""


def _always(path: Path, epoch: int) -> Path:
    del epoch
    return path


def _writer(
    training: FoldTraining, weights_path: Callable[[int], Path]
) -> Callable[[Weights, int, float], None]:
    """Writes the weights of an epoch."""

    def write(weights: Weights, epoch: int, dsc: float) -> None:
        notes: dict[str, str | int | float] = {
            "seed": training.seed,
            "fold": training.fold,
            "epoch": epoch,
            "validation_dsc": dsc,
            "late_weights": training.trainer.late_weights,
            "init": training.initialisation.name,
            "start": training.start.digest,
            "start_source": training.start.source,
            **({NOTE: as_note(training.learnt_from)} if training.learnt_from else {}),
        }
        checkpoint = Checkpoint(training.model, weights, training.preprocessing, notes)
        checkpoint.save(weights_path(epoch))

    return write


def _trained(done: Progressed, path: Path) -> TrainedFold:
    kept = done.phase.kept(done.history)
    return TrainedFold(path, done.history, kept, done.history[kept]["validation_dsc"], done.runtime_s)
