"""Tables of the study of propagation: masks, surface and registration by configuration, correlations, comparisons."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.measured import SIMULATED
from experiments.statistics import Bootstrap, Interval, by_unit
from experiments.studies.propagation.networks import REFERENCE
from registration.metrics.surface_distance import SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd


# What a correlation is over: all sweeps and networks together, or the networks on each sweep alone.
ALL, SAME_SWEEP = "all", "same sweep"


@dataclass(frozen=True)
class Thing:
    """What is compared.

    Parameters
    ----------
    configuration : str
        What the network was trained on, or ``reference``.
    model : str
        The network; empty for the reference masks.
    name : str
        The configuration; with the network where a configuration has several.
    """

    configuration: str
    model: str
    name: str


def several_models(cases: pd.DataFrame) -> bool:
    """Tell whether a configuration has several kinds of networks.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.

    Returns
    -------
    bool
        True if one has.
    """
    return any(len(own["model"].unique()) > 1 for _, own in cases.groupby("configuration"))


def things(cases: pd.DataFrame) -> Iterator[tuple[Thing, pd.DataFrame]]:
    """Split the rows by what is compared.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.

    Yields
    ------
    tuple[Thing, pandas.DataFrame]
        Configuration and network with their rows, in the order of the table.
    """
    several = several_models(cases)
    for key, own in cases.groupby(["configuration", "model"], sort=False):
        configuration, model = map(str, key)
        name = f"{configuration}, {model}" if several and model else configuration
        yield Thing(configuration, model, name), own


def last_error(cases: pd.DataFrame) -> str:
    """Name the column of the error after the last stage.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.

    Returns
    -------
    str
        That of the deformable stage where there was one, else that of the rigid stage.
    """
    return "deformed_tre_mm" if cases["deformed_tre_mm"].notna().any() else "tre_mm"


def tables(cases: pd.DataFrame, correlated: pd.DataFrame, compared: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Make the tables.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.
    correlated : pandas.DataFrame
        As ``correlations`` gives it.
    compared : pandas.DataFrame
        As ``pairs`` gives it.

    Returns
    -------
    dict
        Tables by title.
    """
    import pandas as pd

    found = {
        "masks on the same sweeps": pd.DataFrame([_masks(thing, own) for thing, own in things(cases)]),
        "surface and registration with these masks": pd.DataFrame(
            [_errors(thing, own) for thing, own in things(cases)]
        ),
    }
    overall = correlated[correlated["over"].isin([ALL, SAME_SWEEP])]
    if len(overall):
        found["rank correlation of masks and errors (Spearman)"] = pd.DataFrame(
            [_correlated(row) for row in overall.to_dict("records")]
        )
    if len(compared):
        found["comparison, vessel by vessel"] = pd.DataFrame(
            [_compared(row) for row in compared.to_dict("records")]
        )
    return found


def _masks(thing: Thing, cases: pd.DataFrame) -> dict[str, Any]:
    each = by_unit(cases, "dsc", "vessel")
    return {
        "configuration": thing.configuration,
        "model": thing.model,
        "networks": len(cases[["seed", "fold"]].drop_duplicates()) if thing.configuration != REFERENCE else 0,
        "sweeps": len(cases[["seed", "phantom", "sweep"]].drop_duplicates()),
        "vessels": cases["vessel"].nunique(),
        "dsc": interval_text(Bootstrap()(each), 3) if len(each) else "",
        "hd95_mm": cases["hd95_mm"].mean(),
        "missed": f"{cases['missed'].sum()}/{cases['frames'].sum()}",
        "false_alarms": f"{cases['false_alarms'].sum()}/{cases['frames_empty'].sum()}",
        "data": SIMULATED,
    }


def _errors(thing: Thing, cases: pd.DataFrame) -> dict[str, Any]:
    """Medians over sweeps and networks: half of them may have failed before a median is infinite."""
    good = cases[last_error(cases)] <= SUCCESS_TRE_MM
    row: dict[str, Any] = {"configuration": thing.name}
    for name in ("surface_rmse_mm", "surface_hd95_mm", "tre_mm", "deformed_tre_mm"):
        row[name] = median_of(cases[name])
    return row | {
        "covered_%": 100 * cases["surface_coverage"].mean(),
        f"tre<={SUCCESS_TRE_MM:g}mm": f"{int(good.sum())}/{len(good)}",
        "no_surface": int((cases["surface_error"] != "").sum()),
        "failed": int((cases["error"] != "").sum()),
        "data": SIMULATED,
    }


def median_of(values: pd.Series) -> float:
    """Compute a median in which failures rank worst.

    Parameters
    ----------
    values : pandas.Series
        Values; infinite where something failed, NaN where it is not defined.

    Returns
    -------
    float
        Median of what is defined, infinite if half or more failed; NaN where nothing is defined.
    """
    defined = np.sort(values.dropna().to_numpy(dtype=np.float64))
    if not len(defined):
        return float("nan")
    return float(defined[(len(defined) - 1) // 2 : len(defined) // 2 + 1].mean())


def _correlated(row: Mapping[Any, Any]) -> dict[str, Any]:
    bounds = "" if np.isnan(row["low"]) else f"{row['low']:+.2f} to {row['high']:+.2f}"
    return {
        **{name: row[name] for name in ("masks", "error", "over", "n", "vessels")},
        "rho": f"{row['rho']:+.2f}" if np.isfinite(row["rho"]) else "",
        "interval_95_%": bounds,
        "data": SIMULATED,
    }


def _compared(row: Mapping[Any, Any]) -> dict[str, Any]:
    middle = Interval(row["median_difference"], row["low"], row["high"], 0.95, row["vessels"])
    return {
        "measure": row["measure"],
        **({"model": row["model"]} if row["model"] else {}),
        "configurations": f"{row['first']} - {row['second']}",
        "vessels": row["vessels"],
        "median_difference": interval_text(middle, 3, sign="+"),
        **{name: f"{row[name]:.2g}" for name in ("p_holm", "min_attainable_p")},
        "verdict": row["verdict"],
    }


def interval_text(found: Interval, digits: int, sign: str = "") -> str:
    """Write an estimate with its bounds.

    Parameters
    ----------
    found : Interval
        The estimate.
    digits : int
        Decimals.
    sign : str, optional
        ``+`` writes the sign of positive numbers too.

    Returns
    -------
    str
        The text; without bounds where there are none.
    """
    shown = f"{found.estimate:{sign}.{digits}f}"
    if np.isnan([found.low, found.high]).any():
        return shown
    return f"{shown} [{found.low:{sign}.{digits}f}, {found.high:{sign}.{digits}f}]"
