"""What the dashboard shows of a run: few metrics under plain names, curves over epochs, a description.

Everything else of a run lies in its files: ``metrics.json``, ``history.csv``, ``cases.parquet``, ``config.yaml``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from urllib.parse import quote

# The place of a run: a sweep over several things, one thing that is compared (a model on a data set, a method on a
# piece of a vessel), or one of the folds, seeds or trials that it is repeated over.
LEVEL_TAG = "level"
SWEEP, RESULT, REPEAT = "sweep", "result", "repeat"
NOTE_TAG = "mlflow.note.content"
# As many columns as a person reads.
MOST_METRICS = 12
# What comes first of a study that has not chosen: the scores, errors and rates that studies share.
GENERAL = (
    *("dsc_mean", "dsc_std", "hd95_mm_mean", "hd95_px_mean", "success_rate", "success_tre_rate"),
    *("false_alarm_rate", "rmse_mm", "rmse_mm_median", "tre_mm", "tre_mm_median", "tre_mm_p95", "coverage"),
    *("points", "runtime_s", "runtime_s_median"),
)
# The tracker takes 8000 characters.
LONGEST_NOTE = 7900
MOST_FIGURES = 4
# Where the dashboard serves the files of a run.
_ARTIFACT = "get-artifact?path="
# What is measured at each epoch and belongs in no chart of how a training went.
_NO_CURVE = frozenset({"learning_rate", "images_per_s", "peak_memory_mb"})


def headline(metrics: Mapping[str, float], names: Sequence[str] = ()) -> dict[str, float]:
    """Choose the metrics that the dashboard has columns for.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Scalars by metric name.
    names : Sequence[str], optional
        Names that the study chooses; where it has none of them, ``MOST_METRICS`` are taken, those of ``GENERAL`` before
        others in their order.

    Returns
    -------
    dict[str, float]
        The chosen ones.

    Examples
    --------
    >>> headline({"tre_mm_p95": 3.0, "tre_mm_median": 1.0}, ["tre_mm_median"])
    {'tre_mm_median': 1.0}
    """
    chosen = [name for name in names if name in metrics]
    if not chosen:
        known = [name for name in GENERAL if name in metrics]
        chosen = list(dict.fromkeys([*known, *metrics]))[:MOST_METRICS]
    return {name: metrics[name] for name in chosen}


def curves(history: Iterable[Mapping[str, float]]) -> tuple[dict[str, float], ...]:
    """Choose and name what the dashboard draws over epochs: losses and validation scores, the same for every fold.

    Parameters
    ----------
    history : Iterable[Mapping[str, float]]
        Measures of each epoch.

    Returns
    -------
    tuple[dict[str, float], ...]
        ``train_loss``, ``val_loss``, ``val_dsc`` and whatever else is no speed, memory or learning rate.

    Examples
    --------
    >>> curves([{"train_loss": 1.0, "validation_dsc": 0.5, "learning_rate": 0.01}])
    ({'train_loss': 1.0, 'val_dsc': 0.5},)
    """
    return tuple(
        {_curve_name(name): value for name, value in epoch.items() if name not in _NO_CURVE}
        for epoch in history
    )


def _curve_name(name: str) -> str:
    return f"val_{name.removeprefix('validation_')}" if name.startswith("validation_") else name


def description(findings: Iterable[str], tables: str, figures: Iterable[str] = (), run_id: str = "") -> str:
    """Write what the dashboard shows as the description of a run.

    Parameters
    ----------
    findings : Iterable[str]
        Results as plain sentences.
    tables : str
        Result tables as Markdown.
    figures : Iterable[str], optional
        Stems of PNG files among the run's artifacts.
    run_id : str, optional
        Id of the run, by which the dashboard finds them.

    Returns
    -------
    str
        Markdown: tables, a list of the findings, figures; lines that are too many for the tracker are left out.
    """
    pictures = [f"![{name}]({_ARTIFACT}{quote(name)}.png&run_uuid={run_id})" for name in figures]
    text = "\n".join([tables.strip(), "", *(f"- {finding}" for finding in findings)]).strip()
    shown = "".join(f"\n\n{picture}" for picture in pictures[:MOST_FIGURES])
    if len(text) + len(shown) <= LONGEST_NOTE:
        return (text + shown).strip()
    rest = f"\n\n(The rest is in summary.md and in the findings of the terminal.){shown}"
    # A line of a table that is cut is no line of a table.
    return text[: LONGEST_NOTE - len(rest)].rpartition("\n")[0] + rest


def without_figures(note: str) -> str:
    """A description for a copy of the run, which has no figures.

    Parameters
    ----------
    note : str
        As ``description`` gives it.

    Returns
    -------
    str
        The description without its figures.
    """
    return "\n".join(line for line in note.splitlines() if _ARTIFACT not in line).rstrip()


def metrics_text(metrics: Mapping[str, float]) -> str:
    """All metrics of a run as the file that keeps them has them.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Scalars by metric name.

    Returns
    -------
    str
        JSON; a value that is not finite is text in it.

    Examples
    --------
    >>> metrics_text({"tre_mm": float("inf"), "coverage": 0.5})
    '{"tre_mm": "inf", "coverage": 0.5}'
    """
    # JSON has no NaN or infinity; as text they survive, and nobody takes them for a number.
    return json.dumps(
        {key: float(value) if math.isfinite(value) else str(float(value)) for key, value in metrics.items()}
    )
