import numpy as np
import pytest

from models.metrics.scoring import CaseScore, columns_for, score_case, summarise

EMPTY = np.zeros((30, 40), bool)
VESSEL = EMPTY.copy()
VESSEL[10:20, 10:20] = True


def values(score: CaseScore) -> dict[str, float]:
    return {name: value for name, value in vars(score).items() if not np.isnan(value)}


def test_a_perfect_mask() -> None:
    zero = dict.fromkeys(
        ("hd95_mm", "hd95_px", "hd95_surfel_mm", "hd95_unpenalised_mm", "hd95_unpenalised_px", "missed"), 0.0
    )
    assert values(score_case(VESSEL, VESSEL, (0.1, 0.2))) == {"dsc": 1.0, **zero}


def test_a_missed_vessel_scores_zero_and_the_diagonal_and_has_no_unpenalised_distance() -> None:
    assert values(score_case(EMPTY, VESSEL, (1.0, 1.0))) == {
        "dsc": 0.0,
        "hd95_mm": 50.0,
        "hd95_px": 50.0,
        "missed": 1.0,
    }
    assert score_case(EMPTY, VESSEL, (0.1, 0.2)).hd95_mm == pytest.approx(np.hypot(3.0, 8.0))


def test_an_empty_reference_gives_a_false_alarm_or_none_and_nothing_else() -> None:
    assert values(score_case(VESSEL, EMPTY, (0.1, 0.2))) == {"false_alarm": 1.0}
    assert values(score_case(EMPTY, EMPTY, None)) == {"false_alarm": 0.0}


def test_without_spacing_distances_are_in_pixels_alone() -> None:
    shifted = np.roll(VESSEL, 3, axis=1)
    assert values(score_case(shifted, VESSEL, None)) == {
        "dsc": pytest.approx(0.7),
        "hd95_px": 3.0,
        "hd95_unpenalised_px": 3.0,
        "missed": 0.0,
    }
    assert score_case(shifted, VESSEL, (0.1, 0.2)).hd95_mm == pytest.approx(0.6)


def test_columns_follow_what_is_known_of_the_spacing() -> None:
    known, unknown = columns_for([(0.1, 0.1)] * 2), columns_for([None] * 2)
    assert "hd95_mm" in known and not [name for name in known if name.endswith("_px")]
    assert "hd95_px" in unknown and not [name for name in unknown if name.endswith("_mm")]
    assert set(columns_for([None, (0.1, 0.1)])) == {*known, *unknown}


def test_summary_of_five_numbers_leaves_undefined_cases_out() -> None:
    summary = summarise({"dsc": [0.0, 1.0, np.nan, 0.5, 0.5]})
    assert summary == {
        "dsc_mean": 0.5,
        "dsc_std": pytest.approx(np.sqrt(0.5 / 3)),
        "dsc_median": 0.5,
        "dsc_p95": pytest.approx(0.925),
        "dsc_n": 4.0,
    }


def test_summary_of_misses_and_alarms_is_a_rate() -> None:
    summary = summarise(
        {"missed": [1.0, 0.0, np.nan, 0.0, 0.0], "false_alarm": [np.nan, np.nan, 1.0, np.nan, np.nan]}
    )
    assert summary == {"missed_rate": 0.25, "missed_n": 4.0, "false_alarm_rate": 1.0, "false_alarm_n": 1.0}


def test_summary_of_one_case_has_no_spread_and_of_none_only_a_count() -> None:
    assert np.isnan(summarise({"dsc": [0.5]})["dsc_std"])
    assert summarise({"dsc": [np.nan]}) == {"dsc_n": 0.0}
    assert summarise({"false_alarm": [np.nan]}) == {}


def test_a_missed_vessel_without_spacing_has_no_distance_in_mm() -> None:
    score = score_case(np.zeros((3, 4), bool), np.ones((3, 4), bool), None)
    assert np.isnan(score.hd95_mm) and score.hd95_px == 5.0 and score.missed == 1.0


def test_summary_holds_every_metric_and_the_spread_of_two_cases() -> None:
    found = summarise({"dsc": [0.5, 1.0], "hd95_mm": [2.0, 4.0]})
    assert found["dsc_std"] == pytest.approx(np.sqrt(0.125)) and found["hd95_mm_std"] == pytest.approx(
        np.sqrt(2)
    )
    assert found["dsc_n"] == found["hd95_mm_n"] == 2
