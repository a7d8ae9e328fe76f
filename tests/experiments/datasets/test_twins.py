import numpy as np
import pytest

from experiments.datasets.twins import correlations, twin_groups


def pattern(seed: int, size: tuple[int, int] = (96, 96)) -> np.ndarray:
    """A pattern coarse enough to survive the thumbnail."""
    blocks = np.random.default_rng(seed).integers(0, 200, (12, 12))
    rows, columns = (np.arange(side) * 12 // side for side in size)
    return blocks[rows][:, columns].astype(np.uint8)


def noisy(image: np.ndarray, seed: int) -> np.ndarray:
    return image + np.random.default_rng(seed).integers(0, 50, image.shape).astype(np.uint8)


def test_twins_share_a_group_and_others_do_not() -> None:
    images = [pattern(0), pattern(1), noisy(pattern(0), 5), pattern(2), noisy(pattern(1), 6)]
    groups = twin_groups(images, 0.9)
    assert groups[0] == groups[2] and groups[1] == groups[4]
    assert len(set(groups)) == 3


def test_twins_are_found_across_sizes() -> None:
    groups = twin_groups([pattern(0), pattern(0, (128, 160)), pattern(1)], 0.9)
    assert groups[0] == groups[1] != groups[2]


def test_a_twin_of_a_twin_belongs_to_the_group() -> None:
    first, last = pattern(0).astype(float), pattern(1).astype(float)
    chain = [(first * (1 - t) + last * t).astype(np.uint8) for t in (0.0, 0.35, 0.65, 1.0)]
    values = correlations(chain)
    assert values[0, 3] < 0.5 and min(values[0, 1], values[1, 2], values[2, 3]) > 0.8
    assert len(set(twin_groups(chain, 0.8))) == 1


def test_correlation_is_pearsons_and_zero_for_a_uniform_image() -> None:
    values = correlations(
        [pattern(0), 255 - pattern(0), (pattern(0) // 2 + 60), np.full((96, 96), 7, np.uint8)]
    )
    assert values[0, 0] == pytest.approx(1) and values[0, 1] == pytest.approx(-1, abs=1e-3)
    assert values[0, 2] == pytest.approx(1, abs=1e-3)
    assert np.abs(values[3, :3]).max() == 0
