"""Thresholds and morphology chosen jointly on selection groups, step by step from a plain threshold of 0.5."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from experiments.analysis.consolidation.predictions import IDENTITY, Prediction
from models.calibration import TemperatureScaling
from models.metrics.masks import dsc
from models.postprocessing import (
    Hysteresis,
    Morphology,
    Option,
    PostprocessingGrid,
    PostprocessingSelection,
    SelectionCase,
    select_postprocessing,
)
from models.postprocessing.selection import DSC_ROUNDING

RAW, CALIBRATED, THRESHOLD, HYSTERESIS, MORPHOLOGY = STEPS = (
    "raw 0.5",
    "calibrated",
    "threshold",
    "hysteresis",
    "morphology",
)
HALF = Option(Hysteresis(), Morphology())
# Radii of the closing in px that are tried, without and with hole filling.
CLOSINGS_PX = (0.0, 1.5, 3.0)


@dataclass(frozen=True)
class Step:
    """One way from logits to masks, as it was chosen.

    Parameters
    ----------
    name : str
        One of ``STEPS``.
    calibration : TemperatureScaling
        Calibration.
    option : Option
        From calibrated probability to mask.
    """

    name: str
    calibration: TemperatureScaling
    option: Option


def choose_steps(
    selection: Prediction,
    calibration: TemperatureScaling,
    grid: PostprocessingGrid,
    *,
    max_false_alarm_rate: float | None = None,
) -> tuple[Step, ...]:
    """Choose thresholds and morphology on selection groups; each step chooses anew among more options.

    Parameters
    ----------
    selection : Prediction
        Logits of the cases of selection groups.
    calibration : TemperatureScaling
        Calibration that goes before the thresholds.
    grid : PostprocessingGrid
        Options of the last step; those before it have no smallest area, gate or single component.
    max_false_alarm_rate : float or None, optional
        As in ``select_postprocessing``.

    Returns
    -------
    tuple of Step
        The steps in the order of ``STEPS``; the last is the choice.

    Raises
    ------
    models.errors.InputError
        If no selection case shows a vessel, or a false-alarm limit is set and none is without one.
    """
    cases = _Cases(selection, calibration)
    chosen = select_postprocessing(cases, grid, max_false_alarm_rate=max_false_alarm_rate)
    whole = [_is_whole(option) for option in chosen.options]
    plain = [
        each and option.hysteresis.low == option.hysteresis.high
        for each, option in zip(whole, chosen.options, strict=True)
    ]
    return (
        Step(RAW, IDENTITY, HALF),
        Step(CALIBRATED, calibration, HALF),
        Step(THRESHOLD, calibration, best_of(chosen, plain)),
        Step(HYSTERESIS, calibration, best_of(chosen, whole)),
        Step(MORPHOLOGY, calibration, _closed(chosen.best, cases)),
    )


def best_of(selection: PostprocessingSelection, allowed: list[bool]) -> Option:
    """Choose among some of the options by the rule of ``select_postprocessing``.

    Parameters
    ----------
    selection : PostprocessingSelection
        Scores of all options.
    allowed : list of bool
        Which options may be chosen.

    Returns
    -------
    Option
        The option of highest DSC; of equal ones that with fewer false alarms, then the simplest.
    """
    if not any(allowed):
        return HALF
    rates = np.nan_to_num(selection.false_alarm_rates)
    places = [place for place, may in enumerate(allowed) if may]
    best = min(
        places, key=lambda place: (-round(float(selection.dscs[place]) / DSC_ROUNDING), rates[place], place)
    )
    return selection.options[best]


@dataclass(frozen=True, eq=False)
class _Cases:
    """Selection cases at native size, made one at a time at every pass."""

    prediction: Prediction
    calibration: TemperatureScaling

    def __iter__(self) -> Iterator[SelectionCase]:
        frames = self.prediction.cases.frames
        for index, (mask, group, spacing) in enumerate(
            zip(frames.masks, frames.groups, frames.spacing_mm, strict=True)
        ):
            yield SelectionCase(self.prediction.native(index, self.calibration), mask, group, spacing)


def _is_whole(option: Option) -> bool:
    """Whether an option keeps all components that hysteresis leaves."""
    return not option.min_area and not option.hysteresis.min_peak and not option.morphology.largest_only


def _closed(option: Option, cases: _Cases) -> Option:
    """The option with the closing and hole filling that raise the DSC of the selection groups most, if any does."""
    tried = [
        Option(option.hysteresis, replace(option.morphology, closing_radius_px=radius, fill_holes=fill))
        for fill in (False, True)
        for radius in CLOSINGS_PX
    ]
    sums: dict[str, np.ndarray] = {}
    counts: dict[str, int] = {}
    for case in cases:
        if case.reference.any():
            mask = option.hysteresis(case.probability)
            scores = [dsc(each.morphology(mask, case.spacing_mm), case.reference) for each in tried]
            sums[case.group] = sums.get(case.group, np.zeros(len(tried))) + scores
            counts[case.group] = counts.get(case.group, 0) + 1
    dscs = np.mean([sums[group] / counts[group] for group in sorted(counts)], axis=0)
    best = int(np.argmax(np.round(dscs / DSC_ROUNDING)))
    return option if best == 0 else tried[best]
