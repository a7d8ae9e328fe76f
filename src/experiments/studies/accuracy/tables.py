"""Tables and sentences of the accuracy study: each method against the rigid stage that it started from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.statistics import PairedComparison, PairedResult, wilson_interval
from experiments.studies.accuracy.published_values import published_text
from experiments.studies.accuracy.sweeps import DEFORMABLE, ERRORS, METHOD, PARTS, RIGID, column_of
from registration.rigid.result import length_mm

if TYPE_CHECKING:
    import pandas as pd

# Rows of one phantom, of which so much was swept.
GROUP = ("phantom", "share")


def tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Tabulate residuals, true errors and predictions by phantom and method, and compare each method with its start.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages, with the column ``method``.

    Returns
    -------
    dict
        Tables by title.
    """
    import pandas as pd

    rows = [(group, method, own, start) for group, method, own, start in by_method(cases)]
    return {
        "residuals, simulated": pd.DataFrame([_residuals(*row) for row in rows]),
        "true error at the targets, simulated": pd.DataFrame([_errors(*row) for row in rows]),
        "predicted errors and plausibility, simulated": pd.DataFrame([_predicted(*row[:3]) for row in rows]),
    }


def by_method(
    cases: pd.DataFrame,
) -> Iterator[tuple[dict[str, Any], str, pd.DataFrame, pd.DataFrame | None]]:
    """Split the rows by phantom and method, each with the rows of the rigid stage that it started from.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages, with the column ``method``.

    Yields
    ------
    tuple of dict, str, pandas.DataFrame, pandas.DataFrame or None
        Phantom (and share swept, where it varies), name of the method, its rows, and those of its start sweep by sweep;
        None for the rigid stage.
    """
    several = len(cases["share"].unique()) > 1
    for _, group in cases.groupby(list(GROUP), sort=False):
        label = {"phantom": group["phantom"].iloc[0]}
        if several:
            label["swept"] = f"{100 * group['share'].iloc[0]:.0f} %"
        for method, own in group.groupby(METHOD, sort=False):
            start = None
            if own["stage"].iloc[0] == DEFORMABLE:
                before = group[(group["stage"] == RIGID) & (group["rigid"] == own["rigid"].iloc[0])]
                start = before.drop_duplicates("sweep").set_index("sweep").loc[own["sweep"]].reset_index()
            yield label, str(method), own, start


def _residuals(
    label: dict[str, Any], method: str, own: pd.DataFrame, start: pd.DataFrame | None
) -> dict[str, Any]:
    return {
        **label,
        "method": method,
        "sweeps": len(own),
        "failed": int((own["error"] != "").sum()),
        "rmse_mm": own["rmse_mm"].median(),
        "hd95_mm": own["hd95_mm"].median(),
        "rmse_below_rigid_%": below(own, start, "rmse_mm"),
        "hd95_below_rigid_%": below(own, start, "hd95_mm"),
        "rmse_published": published_text(label["phantom"], RIGID if start is None else DEFORMABLE),
    }


def _errors(
    label: dict[str, Any], method: str, own: pd.DataFrame, start: pd.DataFrame | None
) -> dict[str, Any]:
    row = {**label, "method": method, **{name: own[name].median() for name in ERRORS}}
    row["covered_below_rigid_%"] = below(own, start, "tre_covered_mm")
    better = "" if start is None else f"{_better(own, start)}/{len(own)}"
    row["better"] = better
    test = _tested(own, start)
    row["p"], row["min_p"] = (test.test.p, test.test.min_attainable_p) if test else (np.nan, np.nan)
    return row


def _predicted(label: dict[str, Any], method: str, own: pd.DataFrame) -> dict[str, Any]:
    row: dict[str, Any] = {**label, "method": method}
    for part, title in zip(PARTS[1:], ("covered", "uncovered"), strict=True):
        holds = column_of(own, f"holds{part}").dropna()
        row[f"holds_{title}"] = f"{int(holds.sum())}/{len(holds)}" if len(holds) else ""
    for name in ("strain_p95", "jacobian_min"):
        row[name] = column_of(own, name).median()
    row["as_rigid"] = int((own["verdict"] == "rigid stands").sum())
    row["runtime_s"] = column_of(own, "runtime_s").median()
    return row


def below(own: pd.DataFrame, start: pd.DataFrame | None, name: str) -> float:
    """Compute by how many percent the mean lies below that of the rigid stage.

    Parameters
    ----------
    own, start : pandas.DataFrame
        Rows of a method and of its start; None where there is none.
    name : str
        Name of the metric.

    Returns
    -------
    float
        Percent; NaN where there is no start, or a failure.
    """
    if start is None:
        return float("nan")
    after, before = own[name].mean(), start[name].mean()
    return float(100 * (1 - after / before)) if np.isfinite([after, before]).all() else float("nan")


def _better(own: pd.DataFrame, start: pd.DataFrame) -> int:
    return int((own["tre_mm"].to_numpy() < start["tre_mm"].to_numpy()).sum())


def _tested(own: pd.DataFrame, start: pd.DataFrame | None) -> PairedResult | None:
    """The errors of a method against those of its start, sweep by sweep; None where they are the same or too few."""
    if start is None:
        return None
    try:
        return PairedComparison()(own["tre_mm"].to_numpy(), start["tre_mm"].to_numpy())
    except InputError:
        return None


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """State what each deformable method left of the rigid stage's error.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages, with the column ``method``.

    Returns
    -------
    tuple of str
        Sentences.
    """
    sentences = []
    for label, method, own, start in by_method(cases):
        failed = own.loc[own["error"] != "", "error"]
        where = ", ".join(f"{value} swept" if key == "swept" else str(value) for key, value in label.items())
        if len(failed):
            sentences.append(
                f"{where}: {method} failed on {len(failed)} of {len(own)} sweeps ({failed.iloc[0]})."
            )
        if start is not None and not len(failed):
            sentences.append(_compared(where, method, own, start))
    return tuple(sentences)


def _compared(where: str, method: str, own: pd.DataFrame, start: pd.DataFrame) -> str:
    holds = own["holds"].dropna()
    said = (
        f"{where}: {method} takes the RMSE from {start['rmse_mm'].median():.2f} to {own['rmse_mm'].median():.2f} mm "
        f"and the true error from {length_mm(start['tre_mm'].median())} to {length_mm(own['tre_mm'].median())} "
        f"(medians), lower in {_better(own, start)} of {len(own)} sweeps"
    )
    if len(holds):
        rate = wilson_interval(int(holds.sum()), len(holds))
        said += (
            f"; {int(holds.sum())} of {len(holds)} predicted 90 % intervals hold "
            f"({100 * rate.low:.0f} to {100 * rate.high:.0f} %)"
        )
    return f"{said}."
