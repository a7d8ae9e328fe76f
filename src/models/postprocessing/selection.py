"""Joint selection of thresholds and smallest area, on groups reserved for selection."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from models.array_types import Float64
from models.errors import InputError
from models.postprocessing.component_scores import ComponentScorer, SelectionCase
from models.postprocessing.options import Option, PostprocessingGrid

# Differences of DSC below this are rounding.
DSC_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class PostprocessingSelection:
    """Result of ``select_postprocessing``.

    Parameters
    ----------
    best : Option
        The selected option.
    dsc : float
        Its mean DSC: over groups, of the means over their images with a vessel.
    false_alarm_rate : float
        Share of images without a vessel in which it finds one; NaN where there are none.
    within_limit : bool
        Whether ``max_false_alarm_rate`` is met; if not, only the options with the fewest false alarms were
        compared.
    options : tuple of Option
        All options.
    dscs, false_alarm_rates : ndarray, shape (n,)
        Scores of all options.
    """

    best: Option
    dsc: float
    false_alarm_rate: float
    within_limit: bool
    options: tuple[Option, ...]
    dscs: Float64[np.ndarray, " n"]
    false_alarm_rates: Float64[np.ndarray, " n"]


def select_postprocessing(
    cases: Iterable[SelectionCase], grid: PostprocessingGrid, *, max_false_alarm_rate: float | None = None
) -> PostprocessingSelection:
    """Select the option of highest mean DSC; of equal ones that with fewer false alarms, then the simplest.

    Cases are read once, one after the other.

    Parameters
    ----------
    cases : iterable of SelectionCase
        Images of selection groups.
    grid : PostprocessingGrid
        Options to compare.
    max_false_alarm_rate : float or None, optional
        Only options with a share of false alarms (0 to 1) up to this are compared; None compares all.

    Returns
    -------
    PostprocessingSelection
        The selected option, and the scores of all.

    Raises
    ------
    InputError
        If no image shows a vessel, a limit is set without any image without a vessel, a spacing is missing,
        or a case is not as expected.
    """
    options = grid.options
    scorer = ComponentScorer(options)
    dsc_sums: dict[str, np.ndarray] = {}
    counts: dict[str, int] = {}
    false_alarms, empty = np.zeros(len(options)), 0
    for case in cases:
        dsc, found = scorer(case)
        if dsc is None:
            false_alarms, empty = false_alarms + found, empty + 1
        else:
            dsc_sums[case.group] = dsc_sums.get(case.group, 0.0) + dsc
            counts[case.group] = counts.get(case.group, 0) + 1
    if not counts:
        raise InputError(f"cases: expected an image with a vessel, found none in {empty} images")
    dscs = np.mean([dsc_sums[group] / counts[group] for group in sorted(counts)], axis=0)
    rates = false_alarms / empty if empty else np.full(len(options), np.nan)
    within, allowed = _allowed(rates, max_false_alarm_rate)
    keys = zip(-np.round(dscs[allowed] / DSC_ROUNDING), np.nan_to_num(rates[allowed]), allowed, strict=True)
    best = int(min(keys)[2])
    return PostprocessingSelection(
        options[best], float(dscs[best]), float(rates[best]), within, options, dscs, rates
    )


def _allowed(rates: np.ndarray, limit: float | None) -> tuple[bool, np.ndarray]:
    """Whether a limit can be kept, and the options that are left."""
    if limit is None:
        return True, np.arange(len(rates))
    if not 0 <= limit <= 1:
        raise InputError(f"max_false_alarm_rate: expected 0 to 1, received {limit}")
    if np.isnan(rates).all():
        raise InputError("cases: expected an image without a vessel to know false alarms by, found none")
    min_rate = float(rates.min())
    return min_rate <= limit, np.flatnonzero(rates <= max(limit, min_rate))
