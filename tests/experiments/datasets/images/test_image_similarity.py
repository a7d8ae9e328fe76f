import numpy as np
import pytest
from PIL import Image

from experiments.datasets.images.image_similarity import correlations, similarity_blocks


def pattern(seed: int, size: tuple[int, int] = (96, 96)) -> np.ndarray:
    """Smooth blobs, unlike from seed to seed."""
    values = np.random.default_rng(seed).integers(0, 255, (8, 8), dtype=np.uint8)
    return np.asarray(Image.fromarray(values).resize(size[::-1], Image.Resampling.BICUBIC))


def similarity(images: list[np.ndarray], block: int = 512) -> np.ndarray:
    return np.concatenate([rows for _, rows in similarity_blocks(images, block)])


def test_correlation_is_pearsons_and_zero_for_a_uniform_one() -> None:
    values = correlations(
        [pattern(0), 255 - pattern(0), (pattern(0) // 2 + 60), np.full((96, 96), 7, np.uint8)]
    )
    assert values[0, 0] == pytest.approx(1) and values[0, 1] == pytest.approx(-1, abs=1e-3)
    assert values[0, 2] == pytest.approx(1, abs=1e-3)
    assert np.abs(values[3, :3]).max() == 0


def test_correlation_is_that_of_48_by_48_thumbnails() -> None:
    # At 48 pixels nothing is reduced, so numpy's own coefficient is the answer.
    first, second = pattern(1, (48, 48)), pattern(2, (48, 48))
    assert correlations([first, second])[0, 1] == pytest.approx(
        np.corrcoef(first.ravel(), second.ravel())[0, 1]
    )


def test_frames_of_one_size_are_compared_as_they_are() -> None:
    images = [pattern(seed) for seed in range(5)]
    np.testing.assert_allclose(similarity(images), correlations(images))


def test_blocks_make_up_the_whole_matrix() -> None:
    images = [pattern(seed, (90 + 2 * (seed % 3), 96)) for seed in range(7)]
    assert [(start, len(rows)) for start, rows in similarity_blocks(images, 3)] == [(0, 3), (3, 3), (6, 1)]
    np.testing.assert_allclose(similarity(images, 3), similarity(images), atol=1e-12)
    np.testing.assert_allclose(similarity(images), similarity(images).T, atol=1e-12)


def test_another_margin_at_the_right_or_below_does_not_hide_a_near_duplicate() -> None:
    picture = pattern(3, (100, 100))
    wider = np.pad(picture, ((0, 0), (0, 12)))
    taller = np.pad(picture, ((0, 12), (0, 0)), constant_values=255)
    stretched = correlations([picture, wider, taller])
    assert max(stretched[0, 1], stretched[0, 2]) < 0.8
    values = similarity([picture, wider, taller, pattern(4, (100, 112))])
    assert min(values[0, 1], values[0, 2]) > 0.98
    assert values[0, 3] < 0.5


def test_the_overlay_is_pearsons_correlation_over_what_is_shared() -> None:
    # The median of the longer sides is 48, so nothing is reduced.
    first, second, third = pattern(5, (48, 44)), pattern(6, (46, 48)), pattern(7, (48, 48))
    shared = np.corrcoef(first[:46, :44].ravel(), second[:46, :44].ravel())[0, 1]
    stretched = correlations([first, second])[0, 1]
    assert similarity([first, second, third])[0, 1] == pytest.approx(max(shared, stretched), abs=1e-9)
    assert shared != pytest.approx(stretched, abs=1e-3)


def test_frames_that_share_too_little_are_not_overlaid() -> None:
    picture = pattern(8, (100, 100))
    corner = np.ascontiguousarray(picture[:60, :60])
    stretched = correlations([picture, corner])[0, 1]
    assert similarity([picture, corner])[0, 1] == pytest.approx(stretched) and stretched < 0.9


def test_a_uniform_part_is_like_nothing() -> None:
    flat = np.zeros((96, 100), np.uint8)
    values = similarity([flat, pattern(9), pattern(9)])
    assert values[0, 1] == 0 and values[1, 2] == pytest.approx(1)
