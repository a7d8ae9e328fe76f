import math

import numpy as np
import pytest

from models.errors import InputError
from models.postprocessing import PostprocessingGrid, SelectionCase, select_postprocessing

PLAIN = PostprocessingGrid(lows=(0.3, 0.5, 0.7), highs=(0.3, 0.5, 0.7), relative=(False,))


def case(rows: list[list[float]], reference: list[list[int]], group: str = "a") -> SelectionCase:
    return SelectionCase(np.array(rows, np.float32), np.array(reference, bool), group)


def test_hysteresis_is_chosen_where_it_alone_is_right() -> None:
    # A vessel with a faint half, and a faint stretch of something else.
    one = case([[0.9, 0.4, 0.0, 0.4, 0.0]], [[1, 1, 0, 0, 0]])
    found = select_postprocessing([one], PLAIN)
    assert (found.best.hysteresis.low, found.best.hysteresis.high) == (0.3, 0.5)
    assert found.dsc == 1.0 and math.isnan(found.false_alarm_rate) and found.within_limit


def test_relative_thresholds_are_chosen_for_images_of_other_brightness() -> None:
    bright = case([[1.0, 0.7, 0.35, 0.0]], [[1, 1, 0, 0]])
    faint = case([[0.4, 0.28, 0.14, 0.0]], [[1, 1, 0, 0]])
    grid = PostprocessingGrid(lows=(0.2, 0.3, 0.5), highs=(0.2, 0.3, 0.5), relative=(False, True))
    found = select_postprocessing([bright, faint], grid)
    assert found.best.hysteresis.relative and found.best.hysteresis.low == 0.5 and found.dsc == 1.0


def test_every_group_counts_the_same() -> None:
    # Three images of one group want 0.3, two of others want 0.7.
    low = case([[0.4, 0.4, 0.0]], [[1, 1, 0]], "many")
    high = [case([[0.9, 0.6, 0.6]], [[1, 0, 0]], group) for group in ("b", "c")]
    grid = PostprocessingGrid(lows=(0.3, 0.7), highs=(0.3, 0.7), relative=(False,))
    found = select_postprocessing([low, low, low, *high], grid)
    by_low = dict(zip([option.hysteresis for option in found.options], found.dscs, strict=True))
    means = {(h.low, h.high): value for h, value in by_low.items()}
    assert means[0.3, 0.3] == pytest.approx((1 + 0.5 + 0.5) / 3)
    assert means[0.7, 0.7] == pytest.approx((0 + 1 + 1) / 3)
    # With equal means the plain threshold nearest to a half comes first, whatever the order.
    assert found.best == select_postprocessing([*high, low], grid).best


def test_false_alarms_decide_between_equals_and_may_be_limited() -> None:
    vessel = case([[0.9, 0.9, 0.0]], [[1, 1, 0]])
    shadow = case([[0.6, 0.0, 0.0]], [[0, 0, 0]])
    found = select_postprocessing([vessel, shadow], PLAIN)
    # 0.3, 0.5 and 0.7 are all right on the vessel; a half would be simplest.
    assert found.best.hysteresis.high == 0.7 and found.false_alarm_rate == 0.0
    faint = case([[0.6, 0.6, 0.0]], [[1, 1, 0]])
    free = select_postprocessing([faint, shadow], PLAIN)
    assert free.dsc == 1.0 and free.false_alarm_rate == 1.0
    limited = select_postprocessing([faint, shadow], PLAIN, max_false_alarm_rate=0.0)
    assert limited.within_limit and limited.false_alarm_rate == 0.0 and limited.dsc == 0.0
    certain = case([[0.95, 0.0, 0.0]], [[0, 0, 0]])
    kept = select_postprocessing([faint, certain], PLAIN, max_false_alarm_rate=0.5)
    assert not kept.within_limit and kept.false_alarm_rate == 1.0 and kept.dsc == 1.0


def test_the_least_area_and_the_gate_are_chosen_too() -> None:
    speck = case([[0.8, 0.0, 0.8, 0.8, 0.8]], [[0, 0, 1, 1, 1]])
    grid = PostprocessingGrid((0.5,), (0.5,), (False,), min_areas_px=(0, 2, 5), min_peaks=(0.0, 0.7))
    found = select_postprocessing([speck, case([[0.6, 0.6, 0.6, 0.0, 0.0]], [[0] * 5])], grid)
    assert found.best.min_area == 2 and found.best.hysteresis.min_peak == 0.7
    assert found.dsc == 1.0 and found.false_alarm_rate == 0.0


def test_the_choice_is_the_same_in_any_order_and_from_a_stream() -> None:
    generator = np.random.default_rng(0)
    cases = [
        SelectionCase(
            generator.random((12, 12)).astype(np.float32), generator.random((12, 12)) > 0.6, str(i % 3)
        )
        for i in range(12)
    ]
    grid = PostprocessingGrid(min_areas_px=(0, 3, 9))
    first = select_postprocessing(iter(cases), grid)
    other = select_postprocessing(reversed(cases), grid)
    assert first.best == other.best and first.dsc == pytest.approx(other.dsc)
    assert first.dsc == first.dscs.max() and len(first.options) == len(first.dscs) == 45 * 2 * 3


def test_refuses_what_can_not_be_chosen_by() -> None:
    empty = case([[0.5, 0.5]], [[0, 0]])
    with pytest.raises(InputError, match="cases: expected an image with a vessel, found none in 1 images"):
        select_postprocessing([empty], PLAIN)
    vessel = case([[0.5, 0.5]], [[1, 0]])
    with pytest.raises(InputError, match="expected an image without a vessel to know false alarms by"):
        select_postprocessing([vessel], PLAIN, max_false_alarm_rate=0.1)
    with pytest.raises(InputError, match="max_false_alarm_rate: expected 0 to 1"):
        select_postprocessing([vessel], PLAIN, max_false_alarm_rate=2.0)
