"""Three sentences of the study of propagation: what is left, what goes with it, and what that does not show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import is_smoke, smoke_note
from experiments.analysis.segmentation.comparison import ALPHA
from experiments.reporting.labels import counted
from experiments.studies.propagation.comparison import NO_DIFFERENCE, TOO_FEW
from experiments.studies.propagation.networks import REFERENCE
from experiments.studies.propagation.tables import ALL, SAME_SWEEP, Thing, last_error, median_of, things
from registration.rigid.result import length_mm

if TYPE_CHECKING:
    import pandas as pd

DIGITS = {"dsc": 3}
IN_WORDS = {
    "dsc": "DSC",
    "surface_rmse_mm": "surface RMSE",
    "surface_hd95_mm": "surface HD95",
    "tre_mm": "TRE after the rigid stage",
    "deformed_tre_mm": "TRE after the deformable stage",
}
SIMULATED = "all sweeps are simulated, not comparable, and no value was published."


def describe(cases: pd.DataFrame, correlated: pd.DataFrame, compared: pd.DataFrame) -> tuple[str, ...]:
    """State what was found, and no more than the numbers of vessels and networks allow.

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
    tuple of str
        Three sentences, and a note before them where networks were trained by ``trainer=smoke``.
    """
    return (
        *smoke_note(cases),
        _left(cases),
        _correlation(cases, correlated),
        f"{_comparison(cases, compared)}; {SIMULATED}",
    )


def _left(cases: pd.DataFrame) -> str:
    """What the masks of each configuration leave, and how often there was no result."""
    stage = IN_WORDS[last_error(cases)]
    sweeps = len(cases[["seed", "phantom", "sweep"]].drop_duplicates())
    parts = "; ".join(_of_thing(thing, own) for thing, own in things(cases))
    without, failed = (int((cases[name] != "").sum()) for name in ("surface_error", "error"))
    failures = (
        f"{without} of {len(cases)} surfaces and {failed} of {len(cases)} registrations failed and rank worst"
        if without or failed
        else "none failed"
    )
    return (
        f"Medians of the surface's RMSE and of the {stage} over {counted(sweeps, 'simulated sweep')} of "
        f"{counted(cases['vessel'].nunique(), 'vessel')}: {parts}; {failures}."
    )


def _of_thing(thing: Thing, cases: pd.DataFrame) -> str:
    left = " and ".join(_left_of(cases[name]) for name in ("surface_rmse_mm", last_error(cases)))
    if thing.configuration == REFERENCE:
        return f"{left} with the reference masks"
    return f"{left} with {thing.name} (mean DSC {cases['dsc'].mean():.3f})"


def _left_of(values: pd.Series) -> str:
    middle = median_of(values)
    if np.isfinite(middle):
        return length_mm(middle)
    return f"none, as {int(np.isinf(values).sum())} of {len(values)} failed,"


def _correlation(cases: pd.DataFrame, correlated: pd.DataFrame) -> str:
    """How DSC goes with the errors, over all sweeps and on the same sweep."""
    rows = correlated[correlated["masks"] == "dsc"]
    error = last_error(cases)
    together = list(_rhos(rows[rows["over"] == ALL], ("surface_rmse_mm", error)))
    if not together:
        return "DSC is correlated with nothing: there are too few sweeps and networks, or one of the two does not vary."
    first = rows[rows["over"] == ALL].iloc[0]
    same = list(_rhos(rows[rows["over"] == SAME_SWEEP], (error,)))
    alone = f"; between networks on the same sweep {same[0]}" if same else ""
    return (
        f"Spearman's correlation of DSC over {counted(int(first['n']), 'pair')} of sweep and network "
        f"({counted(int(first['vessels']), 'vessel')}, which the intervals are over): {' and '.join(together)}{alone}."
    )


def _rhos(rows: pd.DataFrame, errors: tuple[str, ...]) -> Iterator[str]:
    for row in rows[rows["error"].isin(errors)].to_dict("records"):
        if np.isfinite(row["rho"]):
            bounds = f"{row['low']:+.2f} to {row['high']:+.2f}" if np.isfinite(row["low"]) else "no interval"
            yield f"{row['rho']:+.2f} ({bounds}) with the {IN_WORDS[row['error']]}"


def _comparison(cases: pd.DataFrame, compared: pd.DataFrame) -> str:
    """Which differences between configurations the tests show."""
    made = cases[cases["configuration"] != REFERENCE]
    if not len(compared):
        why = "smoke-trained networks are" if is_smoke(made).any() else "a single configuration is"
        return f"No configuration was tested against another: {why} compared with nothing"
    # The table has all errors; a sentence has the masks and what they leave in the end.
    ends = compared[compared["measure"].isin(["dsc", last_error(cases)])]
    shown = ends[ends["p_holm"] <= ALPHA]
    differences = [_difference(row) for row in shown.to_dict("records")]
    networks = [len(own[["seed", "fold"]].drop_duplicates()) for _, own in things(made)]
    worth = f"with {counted(min(networks), 'network')} a configuration, another training may differ otherwise"
    left = ends[ends["p_holm"] > ALPHA]
    few = int((left["verdict"] == TOO_FEW).sum())
    others = f"; of the others {few} had too few vessels to show any" if few else ""
    found = "; ".join(differences) if differences else NO_DIFFERENCE
    return (
        f"{len(ends)} paired tests of DSC and {IN_WORDS[last_error(cases)]} between configurations, vessel by vessel, "
        f"show at {100 * ALPHA:g} % (Holm): {found}{others}; {worth}"
    )


def _difference(row: Mapping[Any, Any]) -> str:
    model = f" ({row['model']})" if row["model"] else ""
    value = float(row["median_difference"])
    unit = "" if row["measure"] == "dsc" else " mm"
    by = f" by {abs(value):.{DIGITS.get(str(row['measure']), 2)}f}{unit}"
    if not np.isfinite(value):
        by = ", which failed on half of the vessels or more"
    # The test says which; its median may be of the other sign.
    lower, higher = row["first"], row["second"]
    if row["rank_biserial"] > 0:
        lower, higher = higher, lower
    return f"{IN_WORDS[str(row['measure'])]} of {lower} below that of {higher}{by}{model}"
