"""What the dashboard shows of a run: few metrics under plain names, curves over epochs, a description.

Everything else of a run lies in its files: ``metrics.json``, ``history.csv``, ``cases.parquet``, ``config.yaml``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence

# The place of a run: a sweep over several things, one thing that is compared (a model on a data set, a method on a
# piece of a vessel), or one of the folds, seeds or trials that it is repeated over.
LEVEL_TAG = "level"
SWEEP, RESULT, REPEAT = "sweep", "result", "repeat"
NOTE_TAG = "mlflow.note.content"
# As many columns as a person reads.
MOST_METRICS = 12
# The tracker takes 8000 characters.
LONGEST_NOTE = 7900
# What is measured at each epoch and belongs in no chart of how a training went.
_NO_CURVE = frozenset({"learning_rate", "images_per_s", "peak_memory_mb"})


def headline(metrics: Mapping[str, float], names: Sequence[str] = ()) -> dict[str, float]:
    """Choose the metrics that the dashboard has columns for.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Scalars by metric name.
    names : Sequence[str], optional
        Names that the study chooses; where it has none of them, the first ``MOST_METRICS`` metrics are taken.

    Returns
    -------
    dict[str, float]
        The chosen ones.

    Examples
    --------
    >>> headline({"tre_mm_p95": 3.0, "tre_mm_median": 1.0}, ["tre_mm_median"])
    {'tre_mm_median': 1.0}
    """
    chosen = [name for name in names if name in metrics] or list(metrics)[:MOST_METRICS]
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


def description(findings: Iterable[str], tables: str) -> str:
    """Write what the dashboard shows as the description of a run.

    Parameters
    ----------
    findings : Iterable[str]
        Results as plain sentences.
    tables : str
        Result tables as Markdown.

    Returns
    -------
    str
        Markdown: tables, then a list of the findings; lines that are too many for the tracker are left out.
    """
    text = "\n".join([tables.strip(), "", *(f"- {finding}" for finding in findings)]).strip()
    if len(text) <= LONGEST_NOTE:
        return text
    rest = "\n\n(The rest is in summary.md and in the findings of the terminal.)"
    kept = text[: LONGEST_NOTE - len(rest)]
    # A line of a table that is cut is no line of a table.
    return kept.rpartition("\n")[0] + rest


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
