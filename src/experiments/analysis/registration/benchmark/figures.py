"""Figures of a benchmark: risk against coverage, predicted against true error, and success by kind of case."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.registration.benchmark.metrics import RIGHT, own_vessel
from experiments.analysis.registration.risk_coverage import risk_coverage
from experiments.reporting.labels import axis_label, method_label, method_styles
from experiments.statistics import wilson_interval
from registration.metrics.surface_distance import SUCCESS_TRE_MM
from registration.rigid.result import VERDICTS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MIN_SHOWN_MM, MAX_SHOWN_MM = 5e-2, 2e2
ORDER_LABELS = {"tre_high_mm": "predicted TRE", "ambiguity_gap": "ambiguity gap"}
ORDERS = (("tre_high_mm", 1.0, "-"), ("ambiguity_gap", -1.0, "--"))
COLORS = dict(zip(VERDICTS, ("#0072B2", "#E69F00", "#D55E00", "#999999"), strict=True))


def benchmark_figures(cases: pd.DataFrame) -> dict[str, Figure]:
    """Draw risk against coverage, predicted against true error, and success by kind of case.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, as ``score_result`` gives them, with a column ``method``.

    Returns
    -------
    dict
        One figure with three parts, by its file stem; the middle part is empty if no method predicts its
        error.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 5.2), layout="constrained")
    simulated = " (simulated)" if "simulated" in cases and bool(np.all(cases["simulated"])) else ""
    figure.suptitle(f"Rigid benchmark{simulated}: {cases['case'].nunique()} cases")
    left, middle, right = figure.subplots(1, 3)
    _risk(left, cases)
    _predicted(middle, cases)
    _by_kind(right, cases)
    return {"rigid_benchmark": figure}


def _risk(axes: Axes, cases: pd.DataFrame) -> None:
    looks = method_styles([str(name) for name in cases["method"].drop_duplicates()])
    for name, own in cases.groupby("method", sort=False):
        wrong = ~own[RIGHT].to_numpy(bool)
        color = looks[str(name)]["color"]
        known = [order for order in ORDERS if own[order[0]].notna().any()]
        for column, sign, style in known:
            curve = risk_coverage(wrong, sign * own[column].to_numpy(float))
            label = f"{method_label(str(name))} by {ORDER_LABELS[column]}, area {curve.area:.4f}"
            axes.plot(curve.coverage, curve.risk, style, color=color, label=label)
        accepted = (own["verdict"] == "accepted").to_numpy()
        if accepted.any():
            label = f"{method_label(str(name))}, as accepted"
            axes.plot(accepted.mean(), wrong[accepted].mean(), "o", color=color, label=label)
    axes.set(
        xlabel=axis_label("acceptance_rate"),
        ylabel=f"Share of these with TRE above {SUCCESS_TRE_MM:g} mm",
        xlim=(0, 1.02),
        title="Risk against coverage",
    )
    axes.set_ylim(bottom=-0.005)
    axes.grid(alpha=0.3)
    # Below the axes: the curves fill them.
    if axes.get_legend_handles_labels()[0]:  # none where no result is judged
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)


def _predicted(axes: Axes, cases: pd.DataFrame) -> None:
    known = cases[cases["tre_high_mm"].notna() & cases["tre_symmetric_mm"].notna()]
    for verdict, own in known.groupby("verdict", sort=False):
        predicted, true = (
            own[name].clip(MIN_SHOWN_MM, MAX_SHOWN_MM) for name in ("tre_high_mm", "tre_symmetric_mm")
        )
        axes.scatter(
            predicted, true, s=14, alpha=0.6, color=COLORS[str(verdict)], label=str(verdict).capitalize()
        )
    line = [MIN_SHOWN_MM, MAX_SHOWN_MM]
    axes.plot(line, line, color="grey", linewidth=0.8)
    axes.axhline(SUCCESS_TRE_MM, color="grey", linestyle=":")
    axes.axvline(SUCCESS_TRE_MM, color="grey", linestyle=":")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="Predicted TRE, upper end of the 90 % interval (mm)",
        ylabel=axis_label("tre_symmetric_mm"),
        title="Predicted against true error",
    )
    axes.grid(alpha=0.3)
    if len(known):
        axes.legend(fontsize=8)


def _by_kind(axes: Axes, cases: pd.DataFrame) -> None:
    # More than one block has too many kinds to draw.
    column = "kind" if len(cases["block"].drop_duplicates()) == 1 else "block"
    cases = own_vessel(cases)
    kinds = cases[column].drop_duplicates().tolist()
    looks = method_styles([str(name) for name in cases["method"].drop_duplicates()])
    methods = list(cases.groupby("method", sort=False))
    for number, (name, own) in enumerate(methods):
        shown = [(place, own[own[column] == kind]) for place, kind in enumerate(kinds)]
        shares = [
            (place, wilson_interval(int(part[RIGHT].sum()), len(part))) for place, part in shown if len(part)
        ]
        places = np.array([place for place, _ in shares], dtype=float)
        places += (number - (len(methods) - 1) / 2) * 0.6 / max(len(methods), 2)
        rates = np.array([share.rate for _, share in shares])
        reach = np.array([[share.rate - share.low, share.high - share.rate] for _, share in shares]).T
        axes.errorbar(
            places,
            rates,
            np.maximum(reach, 0),
            linestyle="",
            capsize=3,
            label=method_label(str(name)),
            **looks[str(name)],
        )
    axes.set_xticks(
        range(len(kinds)), [str(kind).replace("_", " ") for kind in kinds], rotation=30, ha="right"
    )
    axes.set(
        ylim=(-0.03, 1.03),
        ylabel=axis_label("success_tre_rate"),
        title=f"Success by {'kind of case' if column == 'kind' else 'block'} (Wilson 95 %)",
    )
    axes.grid(alpha=0.3)
    # Outside the axes: six methods leave no room within.
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0))
