"""What the consistency study shows: pairs of sweeps next to each sweep's distance to the truth, by phantom."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from experiments.reporting.labels import axis_label, counted
from experiments.reporting.published import published
from experiments.statistics import Interval, summary

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Kinds of rows: two sweeps, one sweep and the truth, the mean of all sweeps and the truth.
PAIR, TRUTH, COMMON = "pair", "truth", "common"
RESAMPLES = 2000
PAIR_COLOR, TISSUE_COLOR, TRUTH_COLOR = "tab:blue", "tab:cyan", "tab:orange"


def metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise pairs under their own names, and sweeps against the truth under names with ``truth_`` before.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of pairs, of sweeps against the truth and of common errors.

    Returns
    -------
    dict
        Scalars by name; ``common_mm`` is the mean absolute error that all sweeps share, which no pair of them
        can show.
    """
    pairs, truths = cases[cases["kind"] == PAIR], cases[cases["kind"] == TRUTH]
    common = cases[cases["kind"] == COMMON]
    found: dict[str, float] = {}
    for name in ("msd_mm", "hd95_mm", "msd_covered_mm", "hd95_covered_mm", "msd_tissue_mm", "hd95_tissue_mm"):
        found |= summary(name, pairs[name].tolist())
    for name in ("msd_covered_mm", "hd95_covered_mm"):
        found |= summary(f"truth_{name}", truths[name].tolist())
    # Without a surface there is no bias and no coverage to speak of, good or bad.
    succeeded = truths["error"] == ""
    for name in ("bias_mm", "covered_second"):
        found |= summary(f"truth_{name}", truths.loc[succeeded, name].tolist())
    for name in ("frames_rejected", "pieces_left_out"):
        found[name] = float(truths.loc[succeeded, name].sum())
    found["gap_share_max"] = float(truths.loc[succeeded, "gap_share"].max())
    found |= {"common_mm": float(common["msd_covered_mm"].mean()), "sweeps_failed": float((~succeeded).sum())}
    return found | summary("runtime_s", truths.loc[succeeded, "runtime_s"].tolist())


def tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Tabulate pairs of sweeps, and sweeps against the truth.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of pairs, of sweeps against the truth and of common errors.

    Returns
    -------
    dict
        Two tables by title: one row per phantom, and one of all where there are several.
    """
    import pandas as pd

    groups = list(_phantoms(cases))
    if len(groups) > 1:
        groups.append(("all", cases))
    note = ", simulated" if _simulated(cases) else ""
    return {
        f"between sweeps{note}": pd.DataFrame([_between(name, group) for name, group in groups]),
        f"to the truth{note}": pd.DataFrame([_to_truth(name, group) for name, group in groups]),
    }


def _between(name: str, cases: pd.DataFrame) -> dict[str, object]:
    found = metrics(cases)
    # Sweeps of several phantoms are not exchangeable: their intervals stand in each phantom's own row.
    interval = median_of_pairs(cases, "hd95_mm") if len(list(_phantoms(cases))) == 1 else None
    return {
        "phantom": name,
        "pairs": int((cases["kind"] == PAIR).sum()),
        "msd_mm_mean": found["msd_mm_mean"],
        "hd95_mm_median": found["hd95_mm_median"],
        "hd95_mm_low": interval.low if interval else float("nan"),
        "hd95_mm_high": interval.high if interval else float("nan"),
        "hd95_mm_median published": published("consistency", "hd95_mm_median").text_for(_simulated(cases)),
        "hd95_covered_mm_median": found["hd95_covered_mm_median"],
        "hd95_tissue_mm_median": found["hd95_tissue_mm_median"],
    }


def _to_truth(name: str, cases: pd.DataFrame) -> dict[str, object]:
    found = metrics(cases)
    return {
        "phantom": name,
        "sweeps": int((cases["kind"] == TRUTH).sum()),
        "failed": int(found["sweeps_failed"]),
        "msd_covered_mm_mean": found["truth_msd_covered_mm_mean"],
        "hd95_covered_mm_median": found["truth_hd95_covered_mm_median"],
        "bias_mm_mean": found["truth_bias_mm_mean"],
        "common_mm": found["common_mm"],
        "covered_mean": found["truth_covered_second_mean"],
        "masks_left_out": found["frames_rejected"],
        "pieces_left_out": found["pieces_left_out"],
        "gap_share_max": found["gap_share_max"],
    }


def median_of_pairs(cases: pd.DataFrame, column: str, level: float = 0.95) -> Interval:
    """Estimate the median over pairs of sweeps of one phantom, with a bootstrap interval over sweeps.

    Sweeps are drawn with replacement, and all pairs of different sweeps among them count: pairs that share a
    sweep are not independent. Pairs with a failed sweep are infinitely far apart and rank worst.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one phantom.
    column : str
        Column of the pairs to take the median of.
    level : float, optional
        Level of the interval.

    Returns
    -------
    Interval
        Median and bounds; the bounds are NaN for fewer than 3 sweeps.

    References
    ----------
    Bootstrap of U-statistics: M. A. Arcones and E. Gine, Ann. Stat. 20(2), 1992.
    """
    pairs = cases[cases["kind"] == PAIR]
    count = int(pairs["second"].max()) + 1
    apart = np.full((count, count), np.nan)
    apart[pairs["first"], pairs["second"]] = apart[pairs["second"], pairs["first"]] = pairs[column]
    estimate = float(np.median(pairs[column]))
    if count < 3:
        return Interval(estimate, float("nan"), float("nan"), level, count)
    rng, upper = np.random.default_rng(0), np.triu_indices(count, 1)
    medians = []
    for _ in range(RESAMPLES):
        drawn = rng.integers(0, count, count)
        values = apart[np.ix_(drawn, drawn)][upper]
        if not np.isnan(values).all():
            medians.append(np.nanmedian(values))
    # Order statistics: between infinities there is nothing to interpolate.
    low, high = np.quantile(medians, [0.5 - level / 2, 0.5 + level / 2], method="nearest")
    return Interval(estimate, float(low), float(high), level, count)


def describe(cases: pd.DataFrame) -> tuple[str, ...]:
    """State the findings for each phantom, and what was published.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of pairs, of sweeps against the truth and of common errors.

    Returns
    -------
    tuple of str
        Sentences.
    """
    sentences = []
    for name, group in _phantoms(cases):
        found, interval = metrics(group), median_of_pairs(group, "hd95_mm")
        sentences.append(
            f"{name}: {_count(group, PAIR, 'pair')} of sweeps {_lie(group)} {found['msd_mm_mean']:.2f} mm apart on "
            f"average, with a median HD95 of {interval.estimate:.2f} mm ({_bounds(interval)}"
            f"{found['hd95_tissue_mm_median']:.2f} mm once the known deformation is taken out). A sweep is "
            f"{found['truth_msd_covered_mm_mean']:.3f} mm from the truth (median HD95 "
            f"{found['truth_hd95_covered_mm_median']:.2f} mm); {found['common_mm']:.3f} mm are common to all sweeps, "
            f"which no pair shows, and on average a surface lies {abs(found['truth_bias_mm_mean']):.3f} mm too far "
            f"{'out' if found['truth_bias_mm_mean'] > 0 else 'in'}."
        )
        if found["frames_rejected"] or found["pieces_left_out"] or found["gap_share_max"]:
            sentences.append(
                f"{name}: over all sweeps {found['frames_rejected']:.0f} masks that disagree with their neighbours and "
                f"{found['pieces_left_out']:.0f} pieces that do not continue the vessel were left out; gaps between "
                f"frames are up to {found['gap_share_max']:.1%} of a sweep's way."
            )
        if found["sweeps_failed"]:
            reason = group.loc[(group["kind"] == TRUTH) & (group["error"] != ""), "error"].iloc[0]
            sentences.append(
                f"{name}: {found['sweeps_failed']:.0f} of {int((group['kind'] == TRUTH).sum())} sweeps could not be "
                f"reconstructed and count as infinitely far from all others (first: {reason})."
            )
    value = published("consistency", "hd95_mm_median")
    sentences.append(
        f"Published: median HD95 {value.text} mm on {value.data} ({value.place})"
        + ("; these sweeps are simulated, so the two are not comparable." if _simulated(cases) else ".")
    )
    return tuple(sentences)


def _count(cases: pd.DataFrame, kind: str, what: str) -> str:
    return counted(int((cases["kind"] == kind).sum()), what)


def _lie(cases: pd.DataFrame) -> str:
    return "lies" if (cases["kind"] == PAIR).sum() == 1 else "lie"


def _bounds(interval: Interval) -> str:
    """The interval in words; two sweeps have none."""
    if np.isnan(interval.low):
        return "too few sweeps for an interval; "
    return f"95 % interval over {interval.units} sweeps {interval.low:.2f} to {interval.high:.2f}; "


def figures(cases: pd.DataFrame) -> dict[str, Figure]:
    """Draw boxes by phantom.

    They show pairs as tracked, pairs without the deformation, and each sweep against the truth.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of pairs, of sweeps against the truth and of common errors.

    Returns
    -------
    dict
        Figure by file stem.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.4), layout="constrained")
    note = " (simulated)" if _simulated(cases) else ""
    figure.suptitle(f"Repeated reconstructions of a phantom{note}: between sweeps, and to the truth")
    left, right = figure.subplots(1, 2)
    _boxes(left, cases, ("msd_mm", "msd_tissue_mm", "msd_covered_mm"), axis_label("msd_mm"))
    _boxes(right, cases, ("hd95_mm", "hd95_tissue_mm", "hd95_covered_mm"), axis_label("hd95_mm"))
    value = published("consistency", "hd95_mm_median")
    label = f"Published median {value.text} mm" + (", not comparable" if _simulated(cases) else "")
    right.axhline(value.value, color="0.5", linestyle=":", label=label)
    right.set_ylim(top=max(right.get_ylim()[1], 1.05 * value.value))
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return {"consistency": figure}


def _boxes(axes: Axes, cases: pd.DataFrame, columns: tuple[str, str, str], label: str) -> None:
    names = [name for name, _ in _phantoms(cases)]
    series = (
        (PAIR, columns[0], PAIR_COLOR, "Pairs, as tracked"),
        (PAIR, columns[1], TISSUE_COLOR, "Pairs, deformation taken out"),
        (TRUTH, columns[2], TRUTH_COLOR, "Each sweep to the truth, deformation taken out"),
    )
    for offset, (kind, column, color, text) in enumerate(series):
        places = np.arange(len(names)) + 0.27 * (offset - 1)
        groups = [group.loc[group["kind"] == kind, column].to_numpy() for _, group in _phantoms(cases)]
        # What failed is in the table; a box has no place for it.
        groups = [values[np.isfinite(values)] for values in groups]
        drawn = axes.boxplot(groups, positions=places, widths=0.2, patch_artist=True, showfliers=False)
        for box, middle in zip(drawn["boxes"], drawn["medians"], strict=True):
            box.set(facecolor=color, alpha=0.35)
            middle.set(color="black")
        for place, values in zip(places, groups, strict=True):
            aside = np.linspace(-0.07, 0.07, len(values)) if len(values) != 1 else np.zeros(1)
            axes.plot(place + aside, values, ".", color=color, markersize=4)
        axes.plot([], [], "s", color=color, label=text)
    axes.set_xticks(range(len(names)), names)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(label)
    axes.grid(axis="y", alpha=0.3)


def _phantoms(cases: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for name in cases["phantom"].drop_duplicates():
        yield str(name), cases[cases["phantom"] == name]


def _simulated(cases: pd.DataFrame) -> bool:
    return bool(cases["simulated"].all())
