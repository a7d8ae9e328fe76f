from functools import partial

import numpy as np
import pytest
from PIL import Image

from experiments.datasets.images import near_duplicates
from experiments.datasets.images.image_similarity import correlations, similarity_blocks
from experiments.datasets.images.near_duplicates import near_duplicate_groups, near_duplicates_across_groups


def pattern(seed: int) -> np.ndarray:
    """Smooth blobs, unlike from seed to seed."""
    values = np.random.default_rng(seed).integers(0, 255, (8, 8), dtype=np.uint8)
    return np.asarray(Image.fromarray(values).resize((96, 96), Image.Resampling.BICUBIC))


def noisy(image: np.ndarray, strength: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(image + rng.integers(-strength, strength + 1, image.shape), 0, 255).astype(np.uint8)


def test_near_duplicates_share_a_group_and_other_images_do_not() -> None:
    groups = near_duplicate_groups(
        [pattern(0), pattern(1), noisy(pattern(0), 20), pattern(2), noisy(pattern(1), 20)], 0.9
    )
    assert groups[0] == groups[2] and groups[1] == groups[4]
    assert len(set(groups)) == 3


def test_a_near_duplicate_of_another_margin_shares_the_group() -> None:
    groups = near_duplicate_groups([pattern(0), np.pad(pattern(0), ((0, 0), (0, 10))), pattern(1)], 0.9)
    assert groups[0] == groups[1] != groups[2]


def test_a_near_duplicate_of_another_size_shares_the_group() -> None:
    larger = np.asarray(Image.fromarray(pattern(0)).resize((160, 128), Image.Resampling.BICUBIC))
    groups = near_duplicate_groups([pattern(0), larger, pattern(1)], 0.9)
    assert groups[0] == groups[1] != groups[2]


def test_near_duplicates_of_near_duplicates_are_one_group() -> None:
    shift = np.random.default_rng(5).integers(0, 255, (8, 8), dtype=np.uint8)
    other = np.asarray(Image.fromarray(shift).resize((96, 96), Image.Resampling.BICUBIC)).astype(float)
    chain = [np.clip(pattern(0) + step * 0.28 * (other - 128), 0, 255).astype(np.uint8) for step in range(4)]
    values = correlations(chain)
    assert values[0, 3] < 0.8 and min(values[0, 1], values[1, 2], values[2, 3]) > 0.8
    assert len(set(near_duplicate_groups(chain, 0.8))) == 1


def test_near_duplicates_across_groups_are_found_and_those_within_one_are_not() -> None:
    images = [pattern(0), noisy(pattern(0), 20), pattern(1), noisy(pattern(1), 20), noisy(pattern(0), 20, 1)]
    found = near_duplicates_across_groups(images, ["p", "p", "p", "q", "r"], 0.9)
    assert found.pairs.tolist() == [[0, 4], [1, 4], [2, 3]]
    assert found.closest[[2, 3]].tolist() == [3, 2] and found.closest[4] in (0, 1)
    np.testing.assert_allclose(found.similarity[2], correlations(images)[2, 3])


def test_the_closest_of_another_group_is_known_where_none_is_a_near_duplicate() -> None:
    images = [pattern(seed) for seed in range(4)]
    found = near_duplicates_across_groups(images, ["p", "q", "r", "s"], 0.9)
    values = correlations(images) - 2 * np.eye(4)
    assert len(found.pairs) == 0
    assert found.closest.tolist() == values.argmax(axis=1).tolist()
    np.testing.assert_allclose(found.similarity, values.max(axis=1))


def test_a_single_group_has_nothing_across() -> None:
    found = near_duplicates_across_groups([pattern(0), pattern(0)], ["p", "p"], 0.9)
    assert found.pairs.shape == (0, 2) and found.closest.tolist() == [-1, -1]
    assert np.isnan(found.similarity).all()


def test_a_set_of_more_than_one_block_is_searched_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near_duplicates, "similarity_blocks", partial(similarity_blocks, block=4))
    images = [pattern(seed) for seed in range(11)]
    images[9] = noisy(images[2], 20)
    groups = near_duplicate_groups(images, 0.9)
    assert groups[9] == groups[2] and len(set(groups)) == 10
    assert near_duplicates_across_groups(images, [f"g{i}" for i in range(11)], 0.9).pairs.tolist() == [[2, 9]]
