from collections import Counter

import pytest
import torch

from models.training.sampling import EmptyFrameSampler

HAS_VESSEL = torch.tensor([True, False, True, False, True, False, False])


def drawn(weight: float, seed: int = 0) -> list[int]:
    sampler = EmptyFrameSampler(HAS_VESSEL, weight, torch.Generator().manual_seed(seed))
    found = list(sampler)
    assert len(found) == len(sampler)
    return found


@pytest.mark.parametrize(("weight", "empty"), [(0.0, 0), (0.5, 2), (1.0, 4), (2.0, 8), (2.5, 10)])
def test_vessels_are_drawn_once_and_empty_frames_by_their_weight(weight: float, empty: int) -> None:
    count = Counter(drawn(weight))
    assert {index: count[index] for index in (0, 2, 4)} == {0: 1, 2: 1, 4: 1}
    times = [count[index] for index in (1, 3, 5, 6)]
    assert sum(times) == empty and max(times) - min(times) <= 1


def test_no_empty_frame_is_left_out_for_good_and_the_order_is_random() -> None:
    epochs = [drawn(0.5, seed) for seed in range(20)]
    assert {index for epoch in epochs for index in epoch} == set(range(7))
    assert len({tuple(epoch) for epoch in epochs}) > 10
    assert drawn(0.5, 3) == drawn(0.5, 3)


def test_a_set_without_empty_frames_is_drawn_once() -> None:
    sampler = EmptyFrameSampler(torch.tensor([True, True]), 3.0, torch.Generator())
    assert sorted(sampler) == [0, 1]
