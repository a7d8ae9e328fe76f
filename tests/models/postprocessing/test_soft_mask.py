import numpy as np
import pytest

from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.postprocessing.soft_mask import soft_mask

MAPS = [np.random.default_rng(seed).random((20, 30), dtype=np.float32) for seed in range(3)]
OPTIONS = [
    Option(Hysteresis(0.3, 0.8), Morphology(min_area_px=6, fill_holes=True, closing_radius_px=1)),
    Option(Hysteresis(0.4, 0.9, relative=True), Morphology(largest_only=True)),
    Option(Hysteresis(0.5, 0.8), Morphology(min_area_px=6, fill_holes=True, closing_radius_px=1)),
    Option(Hysteresis(0.7, 0.7), Morphology()),
    Option(Hysteresis(1.0, 1.0), Morphology()),
]


@pytest.mark.parametrize("option", OPTIONS)
def test_one_half_is_the_outline_of_the_mask(option: Option) -> None:
    for probability in (*MAPS, np.zeros((4, 5), np.float32), np.full((4, 5), 1, np.float32)):
        mask, before = option(probability, None), probability.copy()
        values = soft_mask(probability, mask, option)
        np.testing.assert_array_equal(probability, before)
        np.testing.assert_array_equal(values >= 0.5, mask)
        assert values.dtype == np.float32 and values.min() >= 0 and values.max() <= 1


def test_a_plain_threshold_of_one_half_leaves_the_probability() -> None:
    option = Option(Hysteresis(), Morphology())
    for probability in MAPS:
        np.testing.assert_array_equal(soft_mask(probability, option(probability, None), option), probability)


def test_the_outline_keeps_its_place_below_a_pixel() -> None:
    # A ramp of 0.1 a pixel crosses the threshold of 0.25 half-way between the pixels of 0.2 and 0.3.
    probability = np.tile(np.linspace(0, 1, 11, dtype=np.float32), (3, 1))
    option = Option(Hysteresis(0.25, 0.25), Morphology())
    values = soft_mask(probability, option(probability, None), option)
    np.testing.assert_allclose(values[0, :5], [0, 0.2, 0.4, 0.5 + 0.05 / 1.5, 0.5 + 0.15 / 1.5], atol=1e-6)
