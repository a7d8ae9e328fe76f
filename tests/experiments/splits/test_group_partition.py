import dataclasses

import numpy as np
import pytest
from drawn_vessels import drawn_frames

from experiments.splits.group_partition import GroupedCases, area_classes, divide


def sizes_of(sizes: list[int], shares: list[float], seed: int = 0) -> list[list[int]]:
    """The sizes of the groups in each part; all cases are of one class."""
    groups = np.repeat([f"g{number:02d}" for number in range(len(sizes))], sizes)
    parts = divide(np.ones(len(groups), dtype=np.int64), groups, shares, seed)
    assert sorted(np.concatenate(parts)) == list(range(len(groups)))
    return [sorted(np.unique(groups[part], return_counts=True)[1].tolist()) for part in parts]


def test_area_classes() -> None:
    masks = [np.zeros((10, 10), bool) for _ in range(9)]
    for index, mask in enumerate(masks):
        mask[:index] = True
    frames = dataclasses.replace(drawn_frames(9, size=(10, 10)), masks=tuple(masks))
    assert area_classes(frames).tolist() == [0, 1, 1, 2, 2, 3, 3, 4, 4]


@pytest.mark.parametrize("seed", range(4))
def test_largest_first_to_the_emptiest_part(seed: int) -> None:
    # 4 and 3 apart, a 2 to each, the 1 to the smaller: 4 + 2 against 3 + 2 + 1.
    assert sorted(sizes_of([4, 3, 2, 2, 1], [0.5, 0.5], seed)) == [[1, 2, 3], [2, 4]]


@pytest.mark.parametrize("seed", range(4))
def test_parts_have_their_shares(seed: int) -> None:
    assert sizes_of([3] * 20, [0.6, 0.15, 0.25], seed) == [[3] * 12, [3] * 3, [3] * 5]
    # The groups of 8 go where most is missing; the share of a tenth is met by small ones.
    assert [sum(part) for part in sizes_of([8, 8, 8, 8, 2, 2, 1, 1, 1, 1], [0.9, 0.1], seed)] == [36, 4]


def test_no_part_is_empty_while_there_are_groups_enough() -> None:
    assert sizes_of([5, 5, 5], [0.98, 0.01, 0.01]) == [[5], [5], [5]]
    assert [len(part) for part in sizes_of([50, 1, 1, 1], [0.98, 0.01, 0.01])] == [2, 1, 1]


@pytest.mark.parametrize("seed", range(4))
def test_kinds_are_spread_over_the_parts(seed: int) -> None:
    # Groups of one class each: two parts must get one of each class, whatever the order.
    groups = np.repeat(["a", "b", "c", "d", "e", "f"], 4)
    classes = np.repeat([1, 1, 4, 4, 0, 0], 4)
    for part in divide(classes, groups, [0.5, 0.5], seed):
        assert sorted(classes[part].tolist()) == [0] * 4 + [1] * 4 + [4] * 4


def test_cases_are_given_by_index_among_all() -> None:
    cases = GroupedCases.of(drawn_frames(12, per_group=3))
    assert cases.in_groups({"sweep1", "sweep3"}).tolist() == [3, 4, 5, 9, 10, 11]
    assert cases.names(np.array([3, 11])) == ("case03", "case11")
    assert cases.group_of()["case04"] == "sweep1"
    chosen = cases.in_groups({"sweep1", "sweep2", "sweep3"})
    parts = cases.divide(chosen, [0.5, 0.5], 0)
    assert sorted(np.concatenate(parts)) == chosen.tolist()
    assert cases.count_groups(chosen) == 3


def test_the_part_that_stops_a_training_is_one_group_at_least() -> None:
    cases = GroupedCases.of(drawn_frames(12, per_group=3))
    two = cases.in_groups({"sweep1", "sweep2"})
    assert cases.count_groups(cases.stopping_part(two, 5, 0)) == 1
    assert len(cases.stopping_part(np.arange(12), 2, 0)) == 6
