from itertools import pairwise

import pytest

from models.training.schedules import cosine, factor, one_cycle


def test_cosine_of_known_numbers() -> None:
    assert [cosine(step, 4, 12) for step in range(4)] == [0.2, 0.4, 0.6, 0.8]
    assert cosine(4, 4, 12) == 1.0
    assert cosine(8, 4, 12) == pytest.approx(0.5)
    assert cosine(12, 4, 12) == cosine(99, 4, 12) == pytest.approx(0.0)


def test_one_cycle_of_known_numbers() -> None:
    assert one_cycle(0, 5, 21) == pytest.approx(1 / 25)
    assert one_cycle(2, 5, 21) == pytest.approx((1 + 1 / 25) / 2)  # half-way up
    assert one_cycle(4, 5, 21) == 1.0
    assert one_cycle(12, 5, 21) == pytest.approx(0.5, rel=1e-4)  # half-way down
    assert one_cycle(20, 5, 21) == one_cycle(99, 5, 21) == pytest.approx(1 / 250000)
    factors = [one_cycle(step, 5, 21) for step in range(21)]
    assert all(a < b for a, b in pairwise(factors[:5])) and all(a > b for a, b in pairwise(factors[4:]))


@pytest.mark.parametrize("schedule", ["cosine", "one_cycle"])
def test_the_shortest_trainings_have_a_rate(schedule: str) -> None:
    for rise in (0, 1):
        for total in (1, 2):
            assert all(0 <= factor(schedule, step, rise, total) <= 1 for step in range(3))
            assert factor(schedule, 0, rise, total) > 0
