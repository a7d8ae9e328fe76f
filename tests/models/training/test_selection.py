import pytest

from models.errors import InputError
from models.training.selection import EpochSelection


def history(*dsc: float) -> list[dict[str, float]]:
    return [{"validation_dsc": value} for value in dsc]


def test_the_best_epoch_is_the_first_of_equals() -> None:
    assert EpochSelection().kept(history(0.2, 0.5, 0.5, 0.4)) == 1
    assert EpochSelection().kept(history(0.0, 0.0)) == 0
    assert EpochSelection().kept(history()) == -1


def test_a_lucky_epoch_does_not_win_over_a_steady_rise() -> None:
    # Medians of three: 0.1, 0.5, 0.2, 0.3, 0.4, 0.6, 0.62, 0.62.
    noisy = history(0.1, 0.9, 0.2, 0.3, 0.4, 0.6, 0.62, 0.64)
    assert EpochSelection().kept(noisy) == 1
    assert EpochSelection("smoothed", 3).kept(noisy) == 7
    assert EpochSelection("smoothed", 1).kept(noisy) == 1
    assert EpochSelection("smoothed", 3).last_rise(noisy) == 7


def test_the_last_epoch_is_no_choice() -> None:
    falling = history(0.6, 0.5, 0.4)
    assert EpochSelection("last").kept(falling) == 2 and EpochSelection("last").last_rise(falling) == 0
    assert EpochSelection("last").kept(history()) == -1


def test_refuses_an_unknown_rule_and_an_empty_median() -> None:
    with pytest.raises(InputError, match="selection: expected one of best, smoothed, last, received 'worst'"):
        EpochSelection("worst")
    with pytest.raises(InputError, match="selection_epochs: expected at least 1, received 0"):
        EpochSelection("smoothed", 0)
