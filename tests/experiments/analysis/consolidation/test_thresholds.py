"""Thresholds chosen on selection cases, where the best ones can be seen."""

from __future__ import annotations

import numpy as np
from known_predictions import disc, known_prediction

from experiments.analysis.consolidation.predictions import IDENTITY
from experiments.analysis.consolidation.rows import SELECTION, case_rows
from experiments.analysis.consolidation.thresholds import (
    CALIBRATED,
    HYSTERESIS,
    MORPHOLOGY,
    RAW,
    STEPS,
    THRESHOLD,
    choose_steps,
)
from models.calibration import TemperatureScaling
from models.postprocessing import PostprocessingGrid

GRID = PostprocessingGrid(min_areas_px=(0.0, 20.0), min_peaks=(0.0, 0.5))
VESSEL = disc(32, 10, 10, 5)


def logit(probability: float) -> float:
    return float(np.log(probability / (1 - probability)))


def drawn(inner: float, around: float, speck: float) -> np.ndarray:
    """Logits of a vessel with a ring around it, and of a speck elsewhere."""
    found = np.full((32, 32), -6.0)
    found[disc(32, 10, 10, 7)] = around
    found[VESSEL] = inner
    found[26:28, 26:28] = speck
    return found


def dsc_of(prediction, steps) -> dict[str, float]:
    rows = case_rows(prediction, steps, part=SELECTION, model="x")
    return {
        step.name: float(np.mean([row["dsc"] for row in rows if row["step"] == step.name])) for step in steps
    }


def test_each_step_is_at_least_as_good_on_the_cases_it_was_chosen_on() -> None:
    logits = [drawn(logit(0.95), logit(0.65), logit(0.97)), drawn(logit(0.85), logit(0.55), logit(0.9))]
    prediction = known_prediction(logits, [VESSEL, VESSEL], ["a", "b"])
    steps = choose_steps(prediction, IDENTITY, GRID)
    assert tuple(step.name for step in steps) == STEPS
    dscs = dsc_of(prediction, steps)
    # The ring lies below 0.7 and the vessel above 0.8; the speck is surer than both and goes by its area alone.
    assert dscs[RAW] == dscs[CALIBRATED] < dscs[THRESHOLD] == dscs[HYSTERESIS] < dscs[MORPHOLOGY] == 1.0
    chosen = dict(zip(STEPS, steps, strict=True))
    assert 0.65 < chosen[THRESHOLD].option.hysteresis.low <= 0.85
    assert chosen[MORPHOLOGY].option.min_area == 20.0 and chosen[HYSTERESIS].option.min_area == 0.0


def test_hysteresis_keeps_a_weak_rim_and_drops_a_weak_speck() -> None:
    weak_rim = np.full((32, 32), -6.0)
    weak_rim[VESSEL] = logit(0.45)
    weak_rim[disc(32, 10, 10, 3)] = logit(0.95)
    weak_rim[20:26, 20:26] = logit(0.45)
    prediction = known_prediction([weak_rim], [VESSEL], ["a"])
    steps = choose_steps(prediction, IDENTITY, PostprocessingGrid())
    dscs = dsc_of(prediction, steps)
    assert dscs[THRESHOLD] < dscs[HYSTERESIS] == 1.0
    hysteresis = steps[3].option.hysteresis
    assert hysteresis.low <= 0.45 < hysteresis.high


def test_where_nothing_helps_the_masks_stay_those_of_a_half() -> None:
    prediction = known_prediction([drawn(4.0, -4.0, -6.0)], [VESSEL], ["a"])
    steps = choose_steps(prediction, IDENTITY, GRID)
    masks = [step.option(prediction.native(0, step.calibration), None) for step in steps]
    assert all(np.array_equal(mask, masks[0]) for mask in masks)
    assert set(dsc_of(prediction, steps).values()) == {1.0}


def test_a_hole_is_filled_only_where_that_raises_the_dsc() -> None:
    holed = drawn(4.0, -6.0, -6.0)
    holed[9:12, 9:12] = -6.0
    filled = choose_steps(known_prediction([holed], [VESSEL], ["a"]), IDENTITY, GRID)[-1].option.morphology
    assert filled.fill_holes or filled.closing_radius_px
    whole = choose_steps(known_prediction([drawn(4.0, -6.0, -6.0)], [VESSEL], ["a"]), IDENTITY, GRID)[-1]
    assert not whole.option.morphology.fill_holes and not whole.option.morphology.closing_radius_px


def test_thresholds_are_those_of_calibrated_probabilities() -> None:
    prediction = known_prediction([drawn(2.0, 0.4, -6.0)], [VESSEL], ["a"])
    shifted = TemperatureScaling(1.0, -1.0)
    plain, calibrated = (choose_steps(prediction, each, GRID)[2].option for each in (IDENTITY, shifted))
    # The ring is above a half as it is, below after the shift.
    assert plain.hysteresis.low > 0.5 and calibrated.hysteresis.low == 0.5
