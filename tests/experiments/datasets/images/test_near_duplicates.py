from functools import partial

import numpy as np
import pytest
from PIL import Image

from experiments.datasets.images import near_duplicates
from experiments.datasets.images.image_similarity import correlations, likeness_blocks
from experiments.datasets.images.near_duplicates import across_groups, twin_groups


def pattern(seed: int) -> np.ndarray:
    """Smooth blobs, unlike from seed to seed."""
    values = np.random.default_rng(seed).integers(0, 255, (8, 8), dtype=np.uint8)
    return np.asarray(Image.fromarray(values).resize((96, 96), Image.Resampling.BICUBIC))


def noisy(image: np.ndarray, strength: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(image + rng.integers(-strength, strength + 1, image.shape), 0, 255).astype(np.uint8)


def test_twins_share_a_group_and_strangers_do_not() -> None:
    groups = twin_groups(
        [pattern(0), pattern(1), noisy(pattern(0), 20), pattern(2), noisy(pattern(1), 20)], 0.9
    )
    assert groups[0] == groups[2] and groups[1] == groups[4]
    assert len(set(groups)) == 3


def test_a_twin_of_another_margin_shares_the_group() -> None:
    groups = twin_groups([pattern(0), np.pad(pattern(0), ((0, 0), (0, 10))), pattern(1)], 0.9)
    assert groups[0] == groups[1] != groups[2]


def test_a_twin_of_another_size_shares_the_group() -> None:
    larger = np.asarray(Image.fromarray(pattern(0)).resize((160, 128), Image.Resampling.BICUBIC))
    groups = twin_groups([pattern(0), larger, pattern(1)], 0.9)
    assert groups[0] == groups[1] != groups[2]


def test_twins_of_twins_are_one_group() -> None:
    shift = np.random.default_rng(5).integers(0, 255, (8, 8), dtype=np.uint8)
    other = np.asarray(Image.fromarray(shift).resize((96, 96), Image.Resampling.BICUBIC)).astype(float)
    chain = [np.clip(pattern(0) + step * 0.28 * (other - 128), 0, 255).astype(np.uint8) for step in range(4)]
    values = correlations(chain)
    assert values[0, 3] < 0.8 and min(values[0, 1], values[1, 2], values[2, 3]) > 0.8
    assert len(set(twin_groups(chain, 0.8))) == 1


def test_twins_across_groups_are_found_and_those_within_one_are_not() -> None:
    images = [pattern(0), noisy(pattern(0), 20), pattern(1), noisy(pattern(1), 20), noisy(pattern(0), 20, 1)]
    found = across_groups(images, ["p", "p", "p", "q", "r"], 0.9)
    assert found.twins.tolist() == [[0, 4], [1, 4], [2, 3]]
    assert found.closest[[2, 3]].tolist() == [3, 2] and found.closest[4] in (0, 1)
    np.testing.assert_allclose(found.likeness[2], correlations(images)[2, 3])


def test_the_closest_of_another_group_is_known_where_none_is_a_twin() -> None:
    images = [pattern(seed) for seed in range(4)]
    found = across_groups(images, ["p", "q", "r", "s"], 0.9)
    values = correlations(images) - 2 * np.eye(4)
    assert len(found.twins) == 0
    assert found.closest.tolist() == values.argmax(axis=1).tolist()
    np.testing.assert_allclose(found.likeness, values.max(axis=1))


def test_a_single_group_has_nothing_across() -> None:
    found = across_groups([pattern(0), pattern(0)], ["p", "p"], 0.9)
    assert found.twins.shape == (0, 2) and found.closest.tolist() == [-1, -1]
    assert np.isnan(found.likeness).all()


def test_a_set_of_more_than_one_block_is_searched_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near_duplicates, "likeness_blocks", partial(likeness_blocks, block=4))
    images = [pattern(seed) for seed in range(11)]
    images[9] = noisy(images[2], 20)
    groups = twin_groups(images, 0.9)
    assert groups[9] == groups[2] and len(set(groups)) == 10
    assert across_groups(images, [f"g{i}" for i in range(11)], 0.9).twins.tolist() == [[2, 9]]
