"""What the robustness study shows: rates with intervals, one table, two figures, plain sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from experiments.statistics import Proportion, summary, wilson_interval
from experiments.studies.robustness_trial import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ANGLE_BIN_DEG = 30.0
# Errors of failed and of perfect trials are drawn at the edge of logarithmic axes.
SMALLEST_SHOWN_MM, LARGEST_SHOWN_MM = 1e-3, 1e3


def success_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Both success rates with their Wilson bounds, and how many trials the method failed to answer."""
    found: dict[str, float] = {}
    for column in ("success", "success_tre"):
        share = _rate(cases, column)
        found |= {
            f"{column}_rate": share.rate,
            f"{column}_rate_low": share.low,
            f"{column}_rate_high": share.high,
        }
    return found | {"trials": float(len(cases)), "trials_failed": float((cases["error"] != "").sum())}


def table(cases: pd.DataFrame) -> pd.DataFrame:
    """Success, RMSE and TRE by method and overlap."""
    import pandas as pd

    rows = []
    for method, overlap, group in _groups(cases):
        share = success_metrics(group)
        rmse, tre = summary("rmse_mm", group["rmse_mm"].tolist()), summary("tre_mm", group["tre_mm"].tolist())
        rows.append(
            {
                "method": method,
                "overlap": overlap,
                "trials": len(group),
                "success_rate": share["success_rate"],
                "success_tre_rate": share["success_tre_rate"],
                "success_tre_rate_low": share["success_tre_rate_low"],
                "success_tre_rate_high": share["success_tre_rate_high"],
                "rmse_mm_median": rmse["rmse_mm_median"],
                "rmse_mm_p95": rmse["rmse_mm_p95"],
                "tre_mm_median": tre["tre_mm_median"],
                "tre_mm_p95": tre["tre_mm_p95"],
                "runtime_s_mean": float(group["runtime_s"].mean()),
            }
        )
    return pd.DataFrame(rows)


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """One sentence for each method at each overlap."""
    sentences = []
    for method, overlap, group in _groups(cases):
        share = _rate(group, "success_tre")
        sentences.append(
            f"{method} at overlap {overlap:g}: {share.successes} of {share.trials} trials within "
            f"{SUCCESS_TRE_MM:g} mm of the truth ({share.rate:.0%}, Wilson 95 % interval {share.low:.0%} to "
            f"{share.high:.0%}), {_rate(group, 'success').rate:.0%} with RMSE up to {SUCCESS_RMSE_MM:g} mm, "
            f"{group['runtime_s'].mean():.2f} s a trial."
        )
        unanswered = group.loc[group["error"] != "", "error"]
        if len(unanswered):
            sentences.append(
                f"{method} at overlap {overlap:g} gave no answer in {len(unanswered)} of {len(group)} trials, which "
                f"count as failed (first: {unanswered.iloc[0]})."
            )
    return tuple(sentences)


def figures(cases: pd.DataFrame) -> dict[str, Figure]:
    """Success against the angle of the perturbation, and RMSE against TRE."""
    return {"success_by_angle": _success_by_angle(cases), "rmse_tre": _rmse_tre(cases)}


def _success_by_angle(cases: pd.DataFrame) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    edges_deg = np.arange(
        0.0, max(float(cases["angle_deg"].max()), ANGLE_BIN_DEG) + ANGLE_BIN_DEG, ANGLE_BIN_DEG
    )
    groups = list(_groups(cases))
    for place, (method, overlap, group) in enumerate(groups):
        bins = np.clip(np.digitize(group["angle_deg"], edges_deg) - 1, 0, len(edges_deg) - 2)
        filled = np.unique(bins)
        shares = [_rate(group[bins == number], "success_tre") for number in filled]
        rates = np.array([share.rate for share in shares])
        reach = np.array([[share.rate - share.low, share.high - share.rate] for share in shares]).T
        # Side by side within a bin, so that intervals do not hide each other.
        aside_deg = (place - (len(groups) - 1) / 2) * ANGLE_BIN_DEG / (2 * max(len(groups), 2))
        middles_deg = edges_deg[filled] + ANGLE_BIN_DEG / 2 + aside_deg
        label = f"{method}, overlap {overlap:g}"
        axes.errorbar(middles_deg, rates, np.maximum(reach, 0), fmt="o-", capsize=3, label=label)
    axes.set(
        xlabel="angle_deg",
        ylabel=f"share of trials with tre_mm <= {SUCCESS_TRE_MM:g}",
        ylim=(-0.03, 1.03),
        xticks=edges_deg,
        title="Success by angle of perturbation (Wilson 95 %)",
    )
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def _rmse_tre(cases: pd.DataFrame) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 4.4), layout="constrained")
    axes = figure.subplots()
    for method, overlap, group in _groups(cases):
        rmse_mm, tre_mm = (
            group[name].clip(SMALLEST_SHOWN_MM, LARGEST_SHOWN_MM) for name in ("rmse_mm", "tre_mm")
        )
        axes.scatter(tre_mm, rmse_mm, s=14, alpha=0.6, label=f"{method}, overlap {overlap:g}")
    axes.axhline(SUCCESS_RMSE_MM, color="grey", linestyle=":")
    axes.axvline(SUCCESS_TRE_MM, color="grey", linestyle=":")
    axes.set(
        xscale="log", yscale="log", xlabel="tre_mm", ylabel="rmse_mm", title="Residual against true error"
    )
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def _groups(cases: pd.DataFrame) -> Iterator[tuple[str, float, pd.DataFrame]]:
    pairs = cases[["method", "overlap"]].drop_duplicates()
    for method, overlap in pairs.itertuples(index=False):
        yield str(method), float(overlap), cases[(cases["method"] == method) & (cases["overlap"] == overlap)]


def _rate(cases: pd.DataFrame, column: str) -> Proportion:
    return wilson_interval(int(cases[column].sum()), len(cases))
