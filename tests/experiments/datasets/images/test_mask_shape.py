import numpy as np
import pytest

from experiments.datasets.images.mask_shape import MaskShape, mask_shape


def drawn(*rows: str) -> np.ndarray:
    return np.array([[pixel == "#" for pixel in row] for row in rows])


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        (drawn("....", "....", "...."), MaskShape(0, 0, 0, False)),
        (drawn("....", ".##.", "...."), MaskShape(2, 1, 0, False)),
        (drawn(".....", ".#.#.", "....."), MaskShape(2, 2, 0, False)),
        # Pixels that meet at a corner are one component; the background between them is not closed.
        (drawn("....", ".#..", "..#.", "...."), MaskShape(2, 1, 0, False)),
        (drawn(".....", ".###.", ".#.#.", ".###.", "....."), MaskShape(8, 1, 1, False)),
        (drawn("#....", "....."), MaskShape(1, 1, 0, True)),
        (drawn(".....", "....#", "....."), MaskShape(1, 1, 0, True)),
        # A bay that the image's edge closes is no hole, nor is the rest of an image that a vessel divides.
        (drawn(".#.#.", ".###.", "....."), MaskShape(5, 1, 0, True)),
        (drawn("..#..", "..#..", "..#.."), MaskShape(3, 1, 0, True)),
        (drawn("###", "###"), MaskShape(6, 1, 0, True)),
    ],
)
def test_shapes_by_hand(mask: np.ndarray, expected: MaskShape) -> None:
    assert mask_shape(mask) == expected
