import numpy as np
import pytest
from drawn_screens import cross_hairs, speckle

from models.errors import InputError
from models.preprocessing.grey import echo_grey, to_grey


@pytest.mark.parametrize("convert", [to_grey, echo_grey])
def test_grey_of_a_grey_screen_is_itself_in_any_number_of_channels(convert) -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert convert(grey) is grey
    np.testing.assert_array_equal(convert(np.stack([grey] * 3, axis=-1)), grey)
    np.testing.assert_array_equal(convert(np.dstack([grey] * 3 + [np.full_like(grey, 9)])), grey)


def test_grey_of_colours_is_their_luma() -> None:
    colours = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], dtype=np.uint8)
    assert to_grey(colours).tolist() == [[76, 150, 29, 255]]


def test_echoes_lose_a_coloured_mark_that_luma_would_keep() -> None:
    tissue = speckle((60, 80))
    marked = cross_hairs(
        np.dstack([tissue] * 3 + [np.full_like(tissue, 255)]), (30, 40), 10, (255, 255, 0, 255)
    )
    assert to_grey(marked)[30, 35] == 226
    assert echo_grey(marked).max() <= tissue.max()


@pytest.mark.parametrize("convert", [to_grey, echo_grey])
def test_refuses_other_shapes(convert) -> None:
    with pytest.raises(InputError, match=r"image: expected shape .* received \(3, 4, 2\)"):
        convert(np.zeros((3, 4, 2), np.uint8))
