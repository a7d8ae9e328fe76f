"""How the quality of masks goes with the errors that they leave, and which configuration leaves less."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import is_smoke
from experiments.analysis.segmentation.comparison import ALPHA
from experiments.statistics import PairedComparison, Spearman, by_unit, holm
from experiments.studies.propagation.networks import REFERENCE
from experiments.studies.propagation.tables import ALL, SAME_SWEEP, several_models, things
from experiments.studies.propagation.trial import MASKS

if TYPE_CHECKING:
    import pandas as pd

# Errors that the masks of a sweep may leave.
ERRORS = ("surface_rmse_mm", "surface_hd95_mm", "tre_mm", "deformed_tre_mm")
SWEEP = ("seed", "phantom", "sweep")
NO_DIFFERENCE, TOO_FEW = "no difference shown", "too few vessels to show any"


def measured_errors(cases: pd.DataFrame) -> list[str]:
    """List the errors that were measured.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps.

    Returns
    -------
    list of str
        Names of the columns; without the deformable stage's where there was none.
    """
    return [name for name in ERRORS if cases[name].notna().any()]


def correlations(cases: pd.DataFrame) -> pd.DataFrame:
    """Correlate DSC and HD95 of masks with every error, by ranks, with intervals over vessels.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps; those of the reference masks, which no network made, are left out.

    Returns
    -------
    pandas.DataFrame
        Columns ``masks``, ``error``, ``over``, ``n`` (pairs of sweep and network), ``vessels``, ``rho``, ``low`` and
        ``high``. ``all`` takes all networks and sweeps together; ``same sweep`` compares the networks on each sweep
        alone, so that how hard a sweep is does not count; a configuration's own row compares sweeps alone.
    """
    import pandas as pd

    made = cases[cases["configuration"] != REFERENCE]
    names = ["masks", "error", "over", "n", "vessels", "rho", "low", "high"]
    scopes = list(_scopes(made)) if len(made) else []
    rows = [
        _correlation(own, masks, error, over)
        for over, own in scopes
        for masks in MASKS
        for error in measured_errors(made)
    ]
    return pd.DataFrame([row for row in rows if row["n"] > 1], columns=names)


def _scopes(made: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    own = list(things(made))
    if len(own) > 1:
        yield ALL, made
        yield SAME_SWEEP, made
    for thing, rows in own:
        yield (thing.name if len(own) > 1 else ALL), rows


def _correlation(cases: pd.DataFrame, masks: str, error: str, over: str) -> dict[str, Any]:
    rows = cases.dropna(subset=[masks, error])
    row = {"masks": masks, "error": error, "over": over, "n": len(rows), "vessels": rows["vessel"].nunique()}
    if len(rows) < 2:
        return row
    within = list(rows[list(SWEEP)].itertuples(index=False, name=None)) if over == SAME_SWEEP else None
    found = Spearman()(rows[masks], rows[error], rows["vessel"].tolist(), within)
    return row | {"rho": found.estimate, "low": found.low, "high": found.high}


def pairs(cases: pd.DataFrame) -> pd.DataFrame:
    """Compare every pair of configurations on the same vessels, each kind of network for itself.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps. The reference masks and networks that ``trainer=smoke`` trained are compared with nothing.

    Returns
    -------
    pandas.DataFrame
        A row for each measure and pair: median difference (first minus second) with its bootstrap interval over
        vessels, ``p`` of the exact signed-rank test, ``p_holm`` adjusted for all pairs of that measure,
        ``min_attainable_p``, and a verdict. A vessel counts once, by its mean over sweeps and networks; a failure is
        infinite and ranks worst.
    """
    import pandas as pd

    made = cases[(cases["configuration"] != REFERENCE) & ~is_smoke(cases)]
    families = made.groupby("model", sort=False) if several_models(made) else [("", made)]
    found: list[dict[str, Any]] = []
    for model, own in families:
        for measure in ("dsc", *measured_errors(own)):
            rows = list(_pairs(own, measure, str(model)))
            adjusted = holm([row["p"] for row in rows]).tolist()
            for row, p in zip(rows, adjusted, strict=True):
                found.append(row | {"p_holm": p, "verdict": _verdict(row, p, len(rows))})
    return pd.DataFrame(found)


def _pairs(cases: pd.DataFrame, measure: str, model: str) -> Iterator[dict[str, Any]]:
    values = {
        str(name): by_unit(own, measure, "vessel") for name, own in cases.groupby("configuration", sort=False)
    }
    for first, second in combinations(values, 2):
        shared = values[first].index.intersection(values[second].index)
        if not len(shared):
            continue
        result = PairedComparison()(values[first][shared], values[second][shared])
        middle = result.median_difference
        yield {
            "measure": measure,
            "model": model,
            "first": first,
            "second": second,
            "vessels": result.units,
            "median_difference": middle.estimate,
            "low": middle.low,
            "high": middle.high,
            "p": result.test.p,
            "min_attainable_p": result.test.min_attainable_p,
            "rank_biserial": result.test.rank_biserial,
        }


def _verdict(row: Mapping[str, Any], p_holm: float, tests: int) -> str:
    """What the test shows, and nothing else."""
    if p_holm <= ALPHA:
        return f"{row['second' if row['rank_biserial'] > 0 else 'first']} lower"
    possible = np.isfinite(row["min_attainable_p"]) and tests * row["min_attainable_p"] <= ALPHA
    return NO_DIFFERENCE if possible else TOO_FEW
