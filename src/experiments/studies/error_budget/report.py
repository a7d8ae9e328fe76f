"""What the error budget shows: the share of each source in the true error, and true error by the masks' quality."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.outcome import Outcome
from experiments.statistics.shapley import shapley_values
from experiments.studies.error_budget.figures import figures
from experiments.studies.error_budget.trial import MASKS, SEPARATOR, SUBSET
from registration.rigid.result import length_mm

if TYPE_CHECKING:
    import pandas as pd

# Errors whose shares are computed: after the rigid and after the deformable stage.
STAGES = {"rigid": "tre_mm", "deformable": "deformed_tre_mm"}


def sources_of(cases: pd.DataFrame) -> list[str]:
    """List the sources that were switched.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of registrations.

    Returns
    -------
    list of str
        Names in their order.
    """
    names = cases.loc[cases["kind"] == SUBSET, "on"]
    return str(max(names, key=lambda text: (text.count(SEPARATOR), len(text)))).split(SEPARATOR)


def shares(cases: pd.DataFrame) -> pd.DataFrame:
    """Compute the Shapley share of each source in the true error, for each sweep and stage.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of registrations.

    Returns
    -------
    pandas.DataFrame
        Columns ``phantom``, ``sweep``, ``stage``, ``source``, ``share_mm``; NaN where a registration failed.
    """
    import pandas as pd

    rows = []
    players = sources_of(cases)
    subsets = cases[cases["kind"] == SUBSET]
    for (phantom, sweep), own in subsets.groupby(["phantom", "sweep"], sort=False):
        for stage, column in STAGES.items():
            if own[column].isna().all():
                continue
            worth = {
                frozenset(filter(None, str(on).split(SEPARATOR))): float(value)
                for on, value in zip(own["on"], own[column], strict=True)
            }
            finite = bool(np.isfinite(list(worth.values())).all())
            values = shapley_values(players, worth) if finite else dict.fromkeys(players, float("nan"))
            about = {"phantom": phantom, "sweep": sweep, "stage": stage}
            rows += [{**about, "source": source, "share_mm": value} for source, value in values.items()]
    return pd.DataFrame(rows)


def metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Give the shares of one job's last stage, and the errors with no source and with all of them.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of registrations of one phantom.

    Returns
    -------
    dict
        Scalars by name.
    """
    found = shares(cases)
    last = found[found["stage"] == found["stage"].iloc[-1]]
    column = STAGES[str(found["stage"].iloc[-1])]
    subsets = cases[cases["kind"] == SUBSET]
    everything = SEPARATOR.join(sources_of(cases))
    return {
        **{f"share_{source}_mm": float(own.mean()) for source, own in last.groupby("source")["share_mm"]},
        "tre_mm": float(subsets.loc[subsets["on"] == everything, column].mean()),
        "tre_without_errors_mm": float(subsets.loc[subsets["on"] == "", column].mean()),
        "failed": float((cases["error"] != "").sum()),
    }


def shown(
    cases: pd.DataFrame, scalars: Mapping[str, float] | None = None, tags: Mapping[str, str] | None = None
) -> Outcome:
    """Make tables, the figure and findings of any rows of this study.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of registrations.
    scalars : Mapping[str, float] or None, optional
        Metrics to hand on.
    tags : Mapping[str, str] or None, optional
        Tags to hand on.

    Returns
    -------
    Outcome
        Metrics, cases, tables, figures and findings.
    """
    found = shares(cases)
    return Outcome(
        metrics=dict(scalars or {}),
        cases=cases,
        tables={
            "shares of the true error, simulated": _share_table(cases, found),
            "true error by masks, simulated": _mask_table(cases),
        },
        figures=figures(cases, found),
        findings=tuple(_findings(cases, found)),
        tags=dict(tags or {}),
    )


def _groups(
    cases: pd.DataFrame, found: pd.DataFrame
) -> Iterator[tuple[str, str, pd.DataFrame, pd.DataFrame]]:
    """Phantom and stage with the rows of subsets and the shares."""
    subsets = cases[cases["kind"] == SUBSET]
    for (phantom, stage), own in found.groupby(["phantom", "stage"], sort=False):
        yield str(phantom), str(stage), subsets[subsets["phantom"] == phantom], own


def _share_table(cases: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for phantom, stage, _, own in _groups(cases, found):
        mean_mm = own.groupby("source", sort=False)["share_mm"].mean()
        for source, values in own.groupby("source", sort=False)["share_mm"]:
            rows.append(
                {
                    "phantom": phantom,
                    "stage": stage,
                    "source": source,
                    "sweeps": int(values.notna().sum()),
                    "share_mm": values.mean(),
                    "low_mm": values.min(),
                    "high_mm": values.max(),
                    "share_%": 100 * values.mean() / mean_mm.sum() if mean_mm.sum() else float("nan"),
                }
            )
    return pd.DataFrame(rows)


def _mask_table(cases: pd.DataFrame) -> pd.DataFrame:
    masks = cases[cases["kind"] == MASKS]
    values = ["dsc", "rmse_mm", *STAGES.values()]
    means = masks.groupby(["phantom", "bias_mm", "deviation_mm"], sort=False)[values].mean()
    return means.reset_index().dropna(axis=1, how="all")


def _findings(cases: pd.DataFrame, found: pd.DataFrame) -> Iterator[str]:
    everything = SEPARATOR.join(sources_of(cases))
    for phantom, stage, rows, own in _groups(cases, found):
        column = STAGES[stage]
        mean_mm = own.groupby("source", sort=False)["share_mm"].mean()
        mean_mm = mean_mm.round(9).sort_values(ascending=False, kind="stable")
        if mean_mm.isna().any():
            failed = int((~np.isfinite(rows[column])).sum())
            yield f"{phantom}: {failed} of {len(rows)} registrations failed, so that their sweeps have no shares."
        if mean_mm.isna().all():
            continue
        before, after = (rows.loc[rows["on"] == on, column].mean() for on in ("", everything))
        parts = _parts(mean_mm.index.tolist()[:3], mean_mm.tolist()[:3])
        yield (
            f"{phantom}, after the {stage} stage: the true error rises from {length_mm(before)} without errors to "
            f"{length_mm(after)} with all; the largest shares are {parts}."
        )
    yield (
        "A share is the mean gain over all orders in which the sources are switched on (Shapley), for the sizes of the "
        "configuration, on simulated sweeps; low and high are over the sweeps of one phantom, which share its tissue."
    )


def _parts(sources: Sequence[str], shares_mm: Sequence[float]) -> str:
    return ", ".join(
        f"{source.replace('_', ' ')} {share_mm:.2f} mm"
        for source, share_mm in zip(sources, shares_mm, strict=True)
    )
