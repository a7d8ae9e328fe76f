"""Tables of the consolidation study over all jobs: candidates, ablation, calibration, barriers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.consolidation.calibrations import CALIBRATIONS, N_BINS, NONE
from experiments.analysis.consolidation.candidates import ENSEMBLE, ORDER
from experiments.analysis.consolidation.rows import (
    BARRIER,
    CANDIDATE,
    CASE,
    RELIABILITY,
    TEST,
    of_kind,
    raw_cases,
)
from experiments.analysis.consolidation.thresholds import STEPS
from experiments.analysis.segmentation.case_table import dataset_label, distance, once_each
from experiments.statistics import Bootstrap, Interval
from models.averaging import InterpolationPath

if TYPE_CHECKING:
    import pandas as pd

# What tells sweeps within one table apart.
PLACE = ("network", "dataset", "simulated")
JOB = ("seed", "outer_fold")


def places(cases: pd.DataFrame) -> Iterator[tuple[dict[str, str], pd.DataFrame]]:
    """Split the rows by network and data set.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Yields
    ------
    place : dict
        ``network`` and ``dataset``, the latter marked if simulated.
    part : pandas.DataFrame
        Their rows.
    """
    for (network, dataset, simulated), part in cases.groupby(list(PLACE), sort=False):
        yield (
            {"network": str(network), "dataset": dataset_label(str(dataset), bool(simulated))},
            part,
        )


def candidates_table(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate all candidates next to each other on test groups, masks at a probability of 0.5.

    Means are over cases, each once (its mean over seeds and, of the mean fold, over folds); intervals resample groups.
    Missed vessels and false alarms are mean numbers over seeds. NLL and ECE are those of all pixels at the network's
    size, without calibration.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Returns
    -------
    pandas.DataFrame
        One row for each network, data set and candidate.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for place, part in places(cases):
        raw, costs = raw_cases(part, TEST), of_kind(part, CANDIDATE)
        scored = {
            name: once_each(raw[raw["model"] == name]) for name in ORDER if (raw["model"] == name).any()
        }
        trust = reliability(of_kind(part, RELIABILITY, calibration=NONE))
        for name, each in scored.items():
            own = costs[costs["model"] == name]
            row: dict[str, Any] = {
                **place,
                "model": name,
                "groups": each["group"].nunique(),
                "cases": len(each),
            }
            row |= _interval("dsc", _bootstrap(each, "dsc"))
            if name != ENSEMBLE:
                row |= _interval("difference", difference(each, scored[ENSEMBLE], "dsc"))
            row[f"{distance(each)}_mean"] = float(each[distance(each)].mean())
            row |= {"missed": each["missed"].sum(), "vessels": int(each["missed"].notna().sum())}
            row |= {
                "false_alarms": each["false_alarm"].sum(),
                "empty": int(each["false_alarm"].notna().sum()),
            }
            row |= {key: trust.get((name, NONE, "everywhere"), {}).get(key, np.nan) for key in ("nll", "ece")}
            row |= {key: float(own[key].mean()) for key in ("seconds_per_frame", "megabytes")}
            rows.append(row)
    return pd.DataFrame(rows)


def ablation_table(cases: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Tabulate what calibration, thresholds and morphology add on test groups, step by step.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.
    names : sequence of str
        Candidates to tabulate.

    Returns
    -------
    pandas.DataFrame
        One row for each network, data set, candidate and step; ``gain`` is over the step before, with a bootstrap
        95 % interval over groups.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for place, part in places(cases):
        scored = of_kind(part, CASE, part=TEST)
        for name in (each for each in ORDER if each in names):
            before = None
            for step in STEPS:
                own = scored[(scored["model"] == name) & (scored["step"] == step)]
                if not len(own):
                    continue
                each = once_each(own)
                row: dict[str, Any] = {**place, "model": name, "step": step} | _interval(
                    "dsc", _bootstrap(each, "dsc")
                )
                if before is not None:
                    row |= _interval("gain", difference(each, before, "dsc"))
                row |= {f"{distance(each)}_mean": float(each[distance(each)].mean())}
                row |= {"missed": each["missed"].sum(), "false_alarms": each["false_alarm"].sum()}
                rows.append(row)
                before = each
    return pd.DataFrame(rows)


def calibration_table(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate calibration on test groups, without and with what was fitted on other groups.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Returns
    -------
    pandas.DataFrame
        One row for each network, data set, candidate and calibration: NLL, Brier score, ECE and ACE of all pixels,
        ECE in the band around the boundary with a bootstrap 95 % interval over groups. Bins are pooled over outer
        folds; scores are means over seeds (and folds, of the mean fold), as are ACE, temperature and bias.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for place, part in places(cases):
        found = of_kind(part, RELIABILITY)
        trust, means = reliability(found), found[found["group"] == ""]
        for name in ORDER:
            for calibration in CALIBRATIONS:
                own = means[(means["model"] == name) & (means["calibration"] == calibration)]
                if not len(own):
                    continue
                everywhere = trust[name, calibration, "everywhere"]
                row: dict[str, Any] = {**place, "model": name, "calibration": calibration}
                row |= {key: everywhere[key] for key in ("nll", "brier", "ece")}
                row["ace"] = float(own.loc[own["region"] == "everywhere", "ace"].mean())
                row |= {f"{key}": float(own[key].mean()) for key in ("temperature", "bias")}
                boundary = trust.get((name, calibration, "boundary"), {})
                row |= {
                    f"ece_boundary{end}": boundary.get(f"ece{end}", np.nan)
                    for end in ("", "_ci_low", "_ci_high")
                }
                rows.append(row)
    return pd.DataFrame(rows)


def barrier_table(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the interpolation barriers between the folds' networks on selection groups.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Returns
    -------
    pandas.DataFrame
        One row for each network, data set and pair of folds: mean and largest barrier of loss and DSC over jobs.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for place, part in places(of_kind(cases, BARRIER)):
        for (first, second), pair in part.groupby(["first", "second"], sort=False):
            found = [_barrier(line) for _, line in pair.groupby(list(JOB), dropna=False)]
            losses, dscs = np.array(found).T
            rows.append(
                {
                    **place,
                    "pair": f"{first}, {second}",
                    "jobs": len(found),
                    "loss_barrier_mean": losses.mean(),
                    "loss_barrier_max": losses.max(),
                    "dsc_barrier_mean": dscs.mean(),
                    "dsc_barrier_max": dscs.max(),
                }
            )
    return pd.DataFrame(rows)


def _barrier(line: pd.DataFrame) -> tuple[float, float]:
    """Barriers of loss and DSC of one pair in one job."""
    line = line.sort_values("alpha")
    alphas, losses, dscs = (line[name].to_numpy(dtype=np.float64) for name in ("alpha", "loss", "dsc"))
    path = InterpolationPath(str(line["first"].iloc[0]), str(line["second"].iloc[0]), alphas, losses, dscs)
    return path.loss_barrier, path.dsc_barrier


def reliability(rows: pd.DataFrame, resamples: int = 1000) -> dict[tuple[str, str, str], dict[str, float]]:
    """Compute calibration scores from bins that are pooled over outer folds, averaged over seeds and folds.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of reliability of one network and data set.
    resamples : int, optional
        Number of resamples of groups for the interval of the ECE.

    Returns
    -------
    dict
        By candidate, calibration and region: ``nll``, ``brier``, ``ece``, ``ece_ci_low``, ``ece_ci_high``.
    """
    found: dict[tuple[str, str, str], dict[str, float]] = {}
    binned = rows[rows["group"] != ""]
    for key, part in binned.groupby(["model", "calibration", "region"], sort=False):
        groups = sorted(part["group"].unique())
        weights = np.vstack([np.ones(len(groups)), _drawn(len(groups), resamples)])
        gaps = np.mean(
            [_gaps(one, groups, weights) for _, one in part.groupby(["seed", "fold"], sort=False)], axis=0
        )
        low, high = np.quantile(gaps[1:], (0.025, 0.975)) if len(groups) > 1 else (np.nan, np.nan)
        total = part["pixels"].sum()
        model, calibration, region = (str(each) for each in key)
        found[model, calibration, region] = {
            "nll": float(part["nll_sum"].sum() / total),
            "brier": float(part["brier_sum"].sum() / total),
            "ece": float(gaps[0]),
            "ece_ci_low": float(low),
            "ece_ci_high": float(high),
        }
    return found


def _gaps(rows: pd.DataFrame, groups: list[str], weights: np.ndarray) -> np.ndarray:
    """Expected calibration error of every weighting of the groups."""
    # A tenth of the time of a pivot table, of which there would be hundreds.
    places = np.searchsorted(groups, rows["group"].to_numpy(dtype=str)) * N_BINS + rows["bin"].to_numpy(
        dtype=int
    )
    pixels, probability, vessel = (
        np.bincount(places, rows[name].to_numpy(dtype=np.float64), len(groups) * N_BINS).reshape(-1, N_BINS)
        for name in ("pixels", "probability_sum", "vessel_pixels")
    )
    apart = np.abs(weights @ (probability - vessel)).sum(axis=1)
    return np.asarray(apart / np.maximum((weights @ pixels).sum(axis=1), 1.0))


def _drawn(groups: int, resamples: int) -> np.ndarray:
    """How often each group is in each resample."""
    return np.random.default_rng(0).multinomial(groups, np.full(groups, 1 / groups), size=resamples)


def difference(first: pd.DataFrame, second: pd.DataFrame, score: str) -> Interval:
    """Compute the mean paired difference over cases with its bootstrap 95 % interval over groups.

    Parameters
    ----------
    first, second : pandas.DataFrame
        Scores of the same cases, each case once.
    score : str
        Column of the score.

    Returns
    -------
    Interval
        First less second.
    """
    both = first.set_index("case_id")[[score, "group"]].join(
        second.set_index("case_id")[score].rename("other"), how="inner"
    )
    both = both.dropna(subset=[score, "other"])
    return Bootstrap("mean_of_cases")((both[score] - both["other"]).to_numpy(), both["group"].tolist())


def _bootstrap(cases: pd.DataFrame, score: str) -> Interval:
    defined = cases.dropna(subset=score)
    return Bootstrap("mean_of_cases")(defined[score], defined["group"].tolist())


def _interval(name: str, interval: Interval) -> dict[str, float]:
    stem = f"{name}_mean" if name == "dsc" else name
    return {stem: interval.estimate, f"{name}_ci_low": interval.low, f"{name}_ci_high": interval.high}
