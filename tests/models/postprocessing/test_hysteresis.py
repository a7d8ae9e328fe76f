import numpy as np
import pytest
from skimage.filters import apply_hysteresis_threshold

from models.errors import InputError
from models.postprocessing import Hysteresis


def blobs(seed: int, size: int = 64) -> np.ndarray:
    """A smooth random map of probabilities with many components."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(np.random.default_rng(seed).standard_normal((size, size)), 2)
    return ((smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


def test_a_weak_pixel_is_kept_where_it_hangs_on_a_strong_one() -> None:
    probability = np.array(
        [
            [0.9, 0.4, 0.1, 0.4],
            [0.1, 0.4, 0.1, 0.4],
            [0.1, 0.1, 0.4, 0.1],
        ],
        np.float32,
    )
    mask = Hysteresis(0.4, 0.8)(probability)
    assert mask.astype(int).tolist() == [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]]
    # Over corners the lower pixel hangs on, and by it the right column.
    corners = Hysteresis(0.4, 0.8, connectivity=2)(probability)
    assert corners.astype(int).tolist() == [[1, 1, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0]]


@pytest.mark.parametrize("seed", range(5))
def test_equals_scikit_image(seed: int) -> None:
    probability = blobs(seed)
    for low, high in ((0.31, 0.72), (0.5, 0.9), (0.55, 0.551)):
        np.testing.assert_array_equal(
            Hysteresis(low, high)(probability), apply_hysteresis_threshold(probability, low, high)
        )


@pytest.mark.parametrize("threshold", [0.1, 0.5, 0.7, 1.0])
def test_equal_thresholds_are_a_plain_one_that_belongs_to_the_vessel(threshold: float) -> None:
    probability = blobs(0)
    probability[0, :3] = threshold
    mask = Hysteresis(threshold, threshold)(probability)
    np.testing.assert_array_equal(mask, probability >= threshold)
    assert mask[0, :3].all()


def test_relative_thresholds_do_not_see_the_scale_of_an_image() -> None:
    probability = blobs(1)
    relative = Hysteresis(0.4, 0.75, relative=True)
    # Powers of two are exact.
    for scale in (0.5, 0.25, 2.0**-10):
        np.testing.assert_array_equal(relative(scale * probability), relative(probability))
    faint = Hysteresis(1.0, 1.0, relative=True)(0.3 * probability)
    assert faint.sum() == 1


def test_the_gate_and_an_image_of_nothing() -> None:
    probability = 0.5 * blobs(2)
    assert Hysteresis(0.2, 0.3, min_peak=0.5)(probability).any()
    assert not Hysteresis(0.2, 0.3, min_peak=0.51)(probability).any()
    assert not Hysteresis(0.2, 0.3, relative=True)(np.zeros((4, 5), np.float32)).any()
    # The gate compares as the thresholds do: 0.7 in 32 bits is below 0.7 in 64.
    assert Hysteresis(0.7, 0.7, min_peak=0.7)(np.full((2, 2), 0.7, np.float32)).all()


def test_no_strong_pixel_and_no_weak_one() -> None:
    assert not Hysteresis(0.2, 0.9)(0.5 * blobs(3)).any()
    assert not Hysteresis(0.8, 0.9)(0.5 * blobs(3)).any()


def test_refuses_thresholds_and_probabilities_out_of_range() -> None:
    for low, high in ((0.0, 0.5), (0.6, 0.5), (0.5, 1.1), (float("nan"), 0.5)):
        with pytest.raises(InputError, match="low, high: expected 0 < low <= high <= 1"):
            Hysteresis(low, high)
    with pytest.raises(InputError, match="min_peak: expected 0 to 1"):
        Hysteresis(min_peak=2.0)
    with pytest.raises(InputError, match="connectivity: expected 1"):
        Hysteresis(connectivity=3)
    for wrong in (np.full((2, 2), np.nan), np.full((2, 2), -0.1), np.array([[0.5, 1.5]])):
        with pytest.raises(InputError, match="probability: expected 0 to 1"):
            Hysteresis()(wrong)
