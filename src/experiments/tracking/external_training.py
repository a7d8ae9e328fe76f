"""A training done by ``python -m models.train`` on a machine without the tracker, read as a run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.errors import InputError
from experiments.files import digest
from experiments.tracking.headline import LEVEL_TAG, RESULT, curves, headline
from experiments.tracking.names import flatten
from experiments.tracking.run_record import RunRecord
from models.settings_file import parse_settings

EXPERIMENT = "segmentation"
# What the dashboard has columns for.
HEADLINE = (
    *("dsc_mean", "dsc_std", "hd95_mm_mean", "hd95_px_mean", "missed_rate", "false_alarm_rate"),
    "training_s",
)
_NAMES = ("case_id", "group", "model", "dataset")
_SHOWN = ("seed", "width", "image_size_px", "max_epochs", "batch_size", "learning_rate")
_FILES = ("model.pt", "metrics.json", "history.json", "cases.csv", "config.yaml")


def is_training(folder: Path) -> bool:
    """Whether ``folder`` looks like what a training leaves.

    Parameters
    ----------
    folder : Path
        Folder that may hold a training.

    Returns
    -------
    bool
        Whether ``folder`` looks like what a training leaves.
    """
    return (folder / "history.json").is_file()


def read_training(folder: Path) -> RunRecord:
    """The run of a training. Its id is made from the weights, so that the same training is never two runs.

    Raises InputError that names a file that is missing or can't be read.

    Parameters
    ----------
    folder : Path
        Folder of the training.

    Returns
    -------
    RunRecord
        The run.
    """
    for name in _FILES:
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: expected the files of a training ({', '.join(_FILES)}), found no {name}"
            )
    weights = digest(folder / "model.pt")
    text = (folder / "config.yaml").read_text(encoding="utf-8")
    cases = _cases(folder / "cases.csv")
    ended_ms = int((folder / "metrics.json").stat().st_mtime * 1000)
    metrics = _read_json(folder / "metrics.json")
    settings = flatten(parse_settings(text))
    fold = cases["fold"].iloc[0]
    named = {name: str(cases[name].iloc[0]) for name in ("model", "dataset")}
    return RunRecord(
        run_id=weights[:32],
        experiment=EXPERIMENT,
        name=f"trained elsewhere, fold={fold}",
        status="FINISHED",
        start_ms=ended_ms - int(1000 * (metrics.get("training_s") or 0.0)),
        end_ms=ended_ms,
        parent_id=None,
        tags={"ctus.kind": "job", LEVEL_TAG: RESULT, **named},
        params={**_parameters(settings), **named, "fold": str(fold)},
        config=text,
        history=_history(_read_json(folder / "history.json"), metrics, ended_ms),
        cases=cases,
        metrics={name: value for name, value in metrics.items() if value is not None},
    )


def _parameters(settings: dict[str, Any]) -> dict[str, str]:
    """The settings that the dashboard has columns for, where the training has them."""
    found = {name.rsplit(".", 1)[-1]: str(value) for name, value in settings.items()}
    return {name: found[name] for name in _SHOWN if name in found}


def _cases(path: Path) -> pd.DataFrame:
    """The table of cases; one called 010 or NA is no number, nor missing."""
    scores = [name for name in pd.read_csv(path, nrows=0).columns if name not in _NAMES]
    missing = {name: ["", "nan", "NaN"] for name in scores}
    text = dict.fromkeys(_NAMES, str)
    return pd.read_csv(path, dtype=text, keep_default_na=False, na_values=missing)


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, found {error}") from error


def _history(
    epochs: list[dict[str, float | None]], metrics: dict[str, float | None], at_ms: int
) -> pd.DataFrame:
    """A row a metric and step; what is not defined (null) has no row."""
    measured = [{name: value for name, value in epoch.items() if value is not None} for epoch in epochs]
    rows = [
        (name, step, value) for step, epoch in enumerate(curves(measured)) for name, value in epoch.items()
    ]
    defined = {name: value for name, value in metrics.items() if value is not None}
    rows += [(name, 0, value) for name, value in headline(defined, HEADLINE).items()]
    known = [(name, step, float(value), at_ms) for name, step, value in rows]
    return pd.DataFrame(known, columns=["metric", "step", "value", "timestamp_ms"])
