import numpy as np
import pytest

from models.errors import InputError
from models.postprocessing import Hysteresis, Morphology, Option, PostprocessingGrid


def test_all_combinations_with_low_up_to_high_simple_ones_first() -> None:
    grid = PostprocessingGrid(
        lows=(0.3, 0.5), highs=(0.3, 0.5, 0.7), min_areas_px=(0, 20), min_peaks=(0.0, 0.4)
    )
    options = grid.options
    # Pairs: (0.3, 0.3), (0.3, 0.5), (0.3, 0.7), (0.5, 0.5), (0.5, 0.7); twice relative, twice area, twice gate.
    assert len(options) == len(set(options)) == 5 * 2 * 2 * 2
    assert options[0] == Option(Hysteresis(0.5, 0.5), Morphology(min_area_px=0))
    assert all(option.hysteresis.low <= option.hysteresis.high for option in options)
    assert [option.hysteresis.relative for option in options] == sorted(
        o.hysteresis.relative for o in options
    )


def test_areas_in_mm2_where_given() -> None:
    grid = PostprocessingGrid((0.5,), (0.5,), (False,), min_areas_mm2=(0.0, 3.0), connectivity=2)
    assert [option.min_area for option in grid.options] == [0.0, 3.0]
    assert grid.options[1].morphology == Morphology(min_area_mm2=3.0, connectivity=2)
    assert grid.options[1].hysteresis.connectivity == 2


def test_an_option_is_hysteresis_then_morphology() -> None:
    probability = np.array([[0.9, 0.4, 0.0, 0.9]], np.float32)
    option = Option(Hysteresis(0.3, 0.8), Morphology(min_area_px=2))
    assert option(probability, None).tolist() == [[True, True, False, False]]


def test_refuses_an_empty_grid() -> None:
    with pytest.raises(InputError, match="lows: expected at least one value"):
        PostprocessingGrid(lows=())
    with pytest.raises(InputError, match="lows, highs: expected a low up to a high"):
        PostprocessingGrid(lows=(0.5,), highs=(0.4,))
    with pytest.raises(InputError, match="min_areas_mm2: expected at least one value"):
        PostprocessingGrid(min_areas_mm2=())
