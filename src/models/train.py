"""Training from files to files, with nothing but torch, lightning and scikit-image installed.

``python -m models.train config.yaml --out DIR`` trains one fold. The YAML file has ``frames`` (a file that
``LabelledFrames.save`` wrote), ``split`` (a JSON file with ``fold`` and the case ids of ``train``, ``validation`` and
``test``), both relative to it, ``dataset`` (a name), ``seed``, and the settings ``model`` (with the network's
``name``), ``preprocessing``, ``trainer``, and, where not the defaults, ``augmentation`` (a list of transforms, each
with its ``name``), ``loss`` (with a ``name``, if it is not Dice and cross-entropy) and ``init`` (with a ``name``:
``pretrained`` takes the ``path`` of a trained network's ``model.pt``). In DIR it leaves ``model.pt``,
``history.json``, ``cases.csv`` (the test cases' scores), ``metrics.json`` and a copy of the configuration.
``DIR/state`` is what ``--resume`` continues from after an interruption; it may be removed.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import torch

from models.atomic import atomic_write
from models.errors import InputError
from models.evaluation import predict, score_cases
from models.labelled_frames import LabelledFrames
from models.metrics.scoring import columns_for, summarise
from models.networks.registry import recipe_of
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing
from models.processor import fixed_threads
from models.settings_file import read_settings
from models.training.augmentation import augmentation_of
from models.training.fold import TrainedFold, train_fold
from models.training.initialisation import Initialisation, Pretrained, SharedRandom
from models.training.losses import DiceCrossEntropy, loss_of
from models.training.natural_images import NaturalImages
from models.training.settings import TrainerSettings
from models.training.spec import FoldTraining
from models.training.training_data import TrainingData
from models.value_types import mismatch, require_settings

SIDES = ("train", "validation", "test")
OUTSIDE = ("selection", "held_out")
STARTS: dict[str, type[Any]] = {each.name: each for each in (SharedRandom, Pretrained, NaturalImages)}
Part = TypeVar("Part")


@dataclasses.dataclass(frozen=True)
class TrainingPlan:
    """Content of a training's configuration file.

    Parameters
    ----------
    training : FoldTraining
        What is trained on what, and how.
    test : LabelledFrames
        Frames that score the network.
    dataset : str
        Name of the data set.
    """

    training: FoldTraining
    test: LabelledFrames
    dataset: str

    @staticmethod
    def read(path: Path, resume: bool = False) -> TrainingPlan:
        """Read a configuration file.

        Parameters
        ----------
        path : Path
            YAML file; paths in it are relative to it.
        resume : bool
            Whether an interrupted training is resumed.

        Returns
        -------
        TrainingPlan
            The training.

        Raises
        ------
        InputError
            If a setting is not as expected; names it.
        """
        config = read_settings(path)
        folder = path.parent
        try:
            model, loss = dict(config["model"]), dict(config.get("loss", {}))
            split = json.loads((folder / config["split"]).read_text(encoding="utf-8-sig"))
            frames = LabelledFrames.load(folder / config["frames"])
            sides = _sides(frames, split)
            training = FoldTraining(
                model=recipe_of(str(model.pop("name")), model),
                train=sides["train"],
                validation=sides["validation"],
                preprocessing=_part(Preprocessing, "preprocessing", config["preprocessing"]),
                trainer=_part(
                    TrainerSettings, "trainer", {**config["trainer"], **({"resume": True} if resume else {})}
                ),
                augmentation=augmentation_of(config.get("augmentation", {})),
                loss=loss_of(str(loss.pop("name", DiceCrossEntropy.name)), loss),
                fold=_whole("fold", split["fold"]),
                seed=_whole("seed", config["seed"]),
                initialisation=_start(folder, config.get("init", {})),
                data=(TrainingData(str(config["dataset"]), frames.digest(), frames.simulated),),
            )
            return TrainingPlan(training, sides["test"], str(config["dataset"]))
        except KeyError as missing:
            raise InputError(f"{path}: expected a value for {missing.args[0]}, received none") from missing
        except InputError:
            raise
        except (TypeError, ValueError, OSError) as refusal:
            raise InputError(
                f"{path}: expected settings of a training, received others ({refusal})"
            ) from refusal


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score and write results.

    Parameters
    ----------
    arguments : sequence of str, or None
        Command line; None for that of the process.

    Returns
    -------
    int
        Exit code: 0 if all went well, 2 if the input is at fault.
    """
    parser = argparse.ArgumentParser(
        prog="python -m models.train", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("config", type=Path, help="YAML file")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--resume", action="store_true", help="resume an interrupted training")
    given = parser.parse_args(arguments)
    try:
        plan = TrainingPlan.read(given.config, given.resume)
        _require_folder(given.out)
        _run(plan, given.out)
        _write_text(given.out / "config.yaml", given.config.read_text(encoding="utf-8"))
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    return 0


def _require_folder(out: Path) -> None:
    """Make the folder for the results; InputError, before hours of training, if nothing can be written there."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out):
            pass
    except OSError as error:
        raise InputError(
            f"--out: expected a folder that can be written, received {out}: {error.strerror}"
        ) from error


def _run(plan: TrainingPlan, out: Path) -> None:
    settings = plan.training.trainer
    max_epochs = settings.max_epochs + settings.extend_epochs
    epoch = iter(range(1, max_epochs + 1))
    trained = train_fold(
        plan.training,
        directory=out,
        state_directory=out / "state",
        on_epoch=lambda report: print(
            f"epoch {next(epoch)} of {max_epochs}: validation DSC {report['validation_dsc']:.3f}", flush=True
        ),
    )
    rows = _scored(plan, trained)
    scores = {name: [row[name] for row in rows] for name in columns_for(plan.test.spacing_mm)}
    metrics = summarise(scores) | {
        "validation_dsc_best": trained.best_validation_dsc,
        "best_epoch": float(trained.best_epoch),
        "epochs": float(len(trained.history)),
        "training_s": trained.runtime_s,
    }
    _write_table(out / "cases.csv", rows)
    _write_json(out / "history.json", [dict(epoch) for epoch in trained.history])
    _write_json(out / "metrics.json", metrics)
    print(
        f"mean DSC {metrics['dsc_mean']:.3f} over {metrics['dsc_n']:.0f} unseen cases with a vessel; files: {out}"
    )


def _scored(plan: TrainingPlan, trained: TrainedFold) -> list[dict[str, Any]]:
    """One row for each test case, with the columns that the segmentation study has."""
    training = plan.training
    device = "cuda" if training.trainer.accelerator != "cpu" and torch.cuda.is_available() else "cpu"
    predictor = Predictor.load(trained.checkpoint, training.trainer.batch_size, device)
    with fixed_threads(training.trainer.threads):
        predictions = dict(predict(predictor, plan.test))
    about = {
        "fold": training.fold,
        "model": training.model.name,
        "dataset": plan.dataset,
        "seed": training.seed,
    }
    return score_cases(plan.test, predictions, about)


def _start(folder: Path, settings: Mapping[str, Any]) -> Initialisation:
    """The weights to start from; a path is relative to the configuration file."""
    given = dict(settings)
    name = str(given.pop("name", SharedRandom.name))
    if name not in STARTS:
        raise InputError(f"init: expected one of {', '.join(STARTS)}, received {name!r}")
    if isinstance(given.get("path"), str):
        given["path"] = folder / given["path"]
    return _part(STARTS[name], "init", given)


def _part(kind: type[Part], name: str, settings: Mapping[str, Any]) -> Part:
    """One of the parts of a training; TypeError for settings that it has not, or of other types."""
    try:
        require_settings(kind, settings, name)
    except InputError as refusal:
        raise TypeError(str(refusal)) from refusal
    return kind(**settings)


def _whole(name: str, value: object) -> int:
    if (wrong := mismatch(name, value, int)) is not None or not isinstance(value, int):
        raise TypeError(wrong)
    return value


def _sides(frames: LabelledFrames, split: Mapping[str, Any]) -> dict[str, LabelledFrames]:
    place = {case: index for index, case in enumerate(frames.case_ids)}
    missing = next((case for side in SIDES for case in split[side] if case not in place), None)
    if missing is not None:
        raise InputError(f"split: expected cases of the frames file, received {missing!r}, which it has not")
    _require_apart(split, dict(zip(frames.case_ids, frames.groups, strict=True)))
    return {side: frames.subset(place[case] for case in split[side]) for side in SIDES}


def _require_apart(split: Mapping[str, Any], group_of: Mapping[str, str]) -> None:
    """Raise InputError for a side without cases, and for a case or a group that stands on two sides or twice on one."""
    side_of_case: dict[str, str] = {}
    side_of_group: dict[str, str] = {}
    for side in (*SIDES, *OUTSIDE):
        cases = split[side] if side in SIDES else split.get(side, ())
        if not cases and side in SIDES:
            raise InputError(f"split: expected at least one case in {side}, received none")
        for case in cases:
            if case in side_of_case:
                raise InputError(
                    f"split: expected case {case!r} once, received it in {side_of_case[case]} and in {side}"
                )
            side_of_case[case] = side
            # Cases outside the fold may not be in the frames file.
            group = group_of.get(case)
            if group is not None and side_of_group.setdefault(group, side) != side:
                raise InputError(
                    f"split: expected group {group!r} on one side, received it in {side_of_group[group]} and in {side}"
                )


def _write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _write_json(path: Path, content: object) -> None:
    # A number that is not defined is null in JSON, which has no NaN.
    _write_text(path, json.dumps(content).replace("NaN", "null"))


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
