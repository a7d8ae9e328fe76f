"""How well a network segments the vessel in groups of frames that it has not seen, fold by fold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import registry
from experiments.errors import InputError
from experiments.outcome import CellResult, InputData, Outcome, Progress
from experiments.splits import GroupFolds
from experiments.studies.segmentation_report import (
    describe,
    overlays,
    pooled_metrics,
    spread,
    table,
    training_curves,
)
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    from models.augmentation import Augmentation
    from models.losses import DiceCrossEntropy
    from models.networks import NetworkRecipe
    from models.trainer_settings import TrainerSettings


def cells(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One cell for each fold, or for the one that ``fold`` names.

    A data set whose folder is not there is refused here, once, before any fold starts.
    """
    folds, fold = config.get("folds"), config.get("fold")
    if isinstance(folds, bool) or not isinstance(folds, int) or folds < 2:
        raise InputError(f"folds: expected a whole number of at least 2, received {folds!r}")
    require_root = getattr(registry.build(config.get("dataset"), "dataset"), "require_root", None)
    if require_root is not None:
        require_root()
    if fold is None:
        return [{"fold": number} for number in range(folds)]
    if isinstance(fold, bool) or not isinstance(fold, int) or not 0 <= fold < folds:
        raise InputError(f"fold: expected 0 to {folds - 1}, or null for all, received {fold!r}")
    return [{"fold": fold}]


def run(
    *,
    dataset: Callable[[], LabelledFrames],
    model: NetworkRecipe,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: DiceCrossEntropy,
    folds: int,
    fold: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train one fold and score the cases that it has not seen at their native resolution.

    Leaves ``model.pt`` (the weights of the best epoch) and ``split.json`` in ``workspace``. Raises InputError for a
    data set that can't be read or divided, or a network that doesn't take the image size.
    """
    import pandas as pd

    from models.evaluation import predict, score_cases
    from models.predictor import Predictor
    from models.training import train_fold

    frames = dataset()
    name = dataset_name(dataset)
    split = GroupFolds(folds, seed)(frames)[fold]
    split.write(workspace / "split.json")
    # One step more than epochs: a bar advances when the next item is asked for.
    epochs = iter(progress.track(range(trainer.max_epochs), f"fold {fold}: epochs", trainer.max_epochs))
    next(epochs)

    def advance(_: Mapping[str, float]) -> None:
        next(epochs, None)

    trained = train_fold(
        model=model,
        train=split.of(frames, "train"),
        validation=split.of(frames, "validation"),
        trainer=trainer,
        augmentation=augmentation,
        loss=loss,
        seed=seed,
        fold=fold,
        directory=workspace,
        on_epoch=advance,
    )
    for _ in epochs:
        pass
    test = split.of(frames, "test")
    device = _device(trainer.accelerator)
    predictor = Predictor.load(trained.checkpoint, batch_size=trainer.batch_size, device=device)
    predictions = dict(progress.track(predict(predictor, test), f"fold {fold}: cases", len(test)))
    about = {"fold": fold, "model": model.name, "dataset": name, "seed": seed}
    cases = pd.DataFrame(score_cases(test, predictions, about))
    return Outcome(
        metrics={
            **pooled_metrics(cases),
            "validation_dsc_best": trained.best_validation_dsc,
            "best_epoch": float(trained.best_epoch),
            "epochs": float(len(trained.history)),
            "training_s": trained.runtime_s,
        },
        cases=cases,
        history=trained.history,
        tables={"segmentation": table(cases)},
        figures={
            "training_curves": training_curves(trained.history, trained.best_epoch, describe(cases)[0]),
            **overlays(test, predictions, cases),
        },
        findings=describe(cases),
        tags={"model": model.name, "dataset": name, "simulated": str(frames.simulated).lower()},
        inputs=(InputData(name, frames.digest(), str(getattr(dataset, "root", "simulator"))),),
    )


def summarise(cells: list[CellResult]) -> Outcome:
    """Pool the cases of all folds by model and data set: the table, the spread, a sentence for each."""
    import pandas as pd

    cases = pd.concat([cell.cases for cell in cells if cell.cases is not None], ignore_index=True)
    return Outcome(
        metrics=pooled_metrics(cases),
        cases=cases,
        tables={"segmentation": table(cases)},
        figures={"spread": spread(cases)},
        findings=describe(cases),
    )


def dataset_name(dataset: object) -> str:
    """The name that tables call a data set by."""
    return str(getattr(dataset, "name", type(dataset).__name__.lower()))


def _device(accelerator: str) -> str:
    import torch

    return "cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu"
