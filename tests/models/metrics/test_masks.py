import inspect
import warnings

import numpy as np
import pytest

from models.errors import InputError
from models.metrics.masks import diagonal, dsc, hd95_mm, hd95_pooled_mm, hd95_px, hd95_surfel_mm

METRICS = [
    dsc,
    hd95_px,
    lambda p, r: hd95_mm(p, r, (1.0, 1.0)),
    lambda p, r: hd95_surfel_mm(p, r, (1.0, 1.0)),
    lambda p, r: hd95_pooled_mm(p, r, (1.0, 1.0)),
]


def mask(*rows: str) -> np.ndarray:
    return np.array([[char == "#" for char in row] for row in rows])


EMPTY = np.zeros((6, 6), bool)
SQUARE = mask("......", ".##...", ".##...", "......", "......", "......")


def test_dsc_of_drawn_masks() -> None:
    other = mask("......", "..##..", "..##..", "......", "......", "......")
    assert dsc(SQUARE, SQUARE) == 1.0
    assert dsc(SQUARE, other) == pytest.approx(2 * 2 / 8)
    assert dsc(SQUARE, ~SQUARE) == 0.0
    assert dsc(SQUARE, EMPTY) == dsc(EMPTY, SQUARE) == 0.0
    assert np.isnan(dsc(EMPTY, EMPTY))


def test_dsc_takes_zeros_and_ones() -> None:
    assert dsc(SQUARE.astype(np.uint8), SQUARE.astype(np.int64)) == 1.0


def test_hd95_of_a_shifted_square_is_its_shift_in_each_direction() -> None:
    for axis, expected in ((0, 2 * 0.5), (1, 2 * 0.2)):
        shifted = np.roll(SQUARE, 2, axis=axis)
        assert hd95_mm(shifted, SQUARE, (0.5, 0.2)) == pytest.approx(expected)
        assert hd95_px(shifted, SQUARE) == 2.0


def test_hd95_interpolates_between_pixels() -> None:
    # A column of 11 pixels against its first: distances 0 to 10; the 95th percentile lies between the last two.
    column = np.ones((11, 1), bool)
    first = np.zeros((11, 1), bool)
    first[0] = True
    assert hd95_px(column, first) == pytest.approx(9.5)
    assert hd95_px(first, column) == pytest.approx(9.5)
    assert hd95_pooled_mm(first, column, 1.0) == pytest.approx(np.quantile([0, *range(11)], 0.95))


def test_hd95_takes_the_worse_direction() -> None:
    two = mask("#.........#", "...........")
    one = mask("#..........", "...........")
    # From one to two: 0. From two to one: 0 and 10, 95th percentile 9.5.
    assert hd95_px(one, two) == hd95_px(two, one) == pytest.approx(9.5)


def test_hd95_sees_the_hole_but_not_the_filled_inside() -> None:
    full = np.ones((7, 7), bool)
    ring = full.copy()
    ring[3, 3] = False
    # Outer boundaries agree; of the ring's 24 + 4 boundary pixels, the four beside the hole are 2 px from the full one.
    assert hd95_px(ring, full) == pytest.approx(2.0)
    assert hd95_px(full, full) == 0.0


def test_surfel_weighs_by_length() -> None:
    # A line of 20 pixels against itself with one pixel more: few elements are off, and by one pixel at most.
    line, longer = np.zeros((2, 5, 30), bool)
    line[2, 2:22] = True
    longer[2, 2:23] = True
    assert hd95_surfel_mm(line, longer, (1.0, 1.0)) == 0.0
    assert hd95_surfel_mm(line, np.roll(line, 2, axis=0), (0.3, 1.0)) == pytest.approx(0.6)


@pytest.mark.parametrize("metric", METRICS[1:])
def test_distances_to_nothing_are_infinite_and_of_nothing_undefined(metric) -> None:
    assert metric(SQUARE, EMPTY) == metric(EMPTY, SQUARE) == np.inf
    assert np.isnan(metric(EMPTY, EMPTY))
    assert metric(SQUARE, SQUARE) == 0.0


@pytest.mark.parametrize("metric", METRICS)
def test_metrics_are_symmetric(metric) -> None:
    rng = np.random.default_rng(3)
    prediction, reference = rng.random((2, 20, 25)) > 0.8
    assert metric(prediction, reference) == metric(reference, prediction)
    assert metric(prediction.T, reference.T) == pytest.approx(metric(prediction, reference))
    assert metric(prediction[::-1, ::-1], reference[::-1, ::-1]) == pytest.approx(
        metric(prediction, reference)
    )


def random_pairs(count: int = 40):
    """Blobs of all sizes, many touching the border, of one part or several, with the spacing of the pair."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(7)
    for index in range(count):
        shape = tuple(rng.integers(15, 70, 2))
        first, second = (gaussian_filter(rng.normal(size=shape), rng.uniform(1, 7)) > 0.02 for _ in range(2))
        if index % 3 == 0:
            second = np.roll(first, rng.integers(-4, 5, 2), (0, 1))
        if first.any() and second.any():
            yield first, second, tuple(float(side) for side in rng.uniform(0.05, 0.6, 2))


def monai_hd95(prediction: np.ndarray, reference: np.ndarray, spacing_mm: tuple[float, float]) -> float:
    import torch
    from monai.metrics import compute_hausdorff_distance

    tensors = [torch.from_numpy(mask.copy())[None, None] for mask in (prediction, reference)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        distance = compute_hausdorff_distance(
            *tensors, include_background=True, percentile=95, spacing=list(spacing_mm)
        )
    return float(distance)


def test_hd95_equals_monai() -> None:
    # MONAI interpolates the percentile in single precision, which moves it by up to 1e-5 of a pixel's step.
    for prediction, reference, spacing_mm in random_pairs():
        ours = hd95_mm(prediction, reference, spacing_mm)
        assert ours == pytest.approx(monai_hd95(prediction, reference, spacing_mm), abs=2e-5, rel=1e-6)


def test_hd95_equals_monai_where_it_does_not_interpolate() -> None:
    for count, expected in ((21, 19.0), (41, 38.0)):
        column, first = np.zeros((2, 50, 3), bool)
        column[:count, 1] = first[0, 1] = True
        assert hd95_mm(column, first, (0.7, 0.3)) == pytest.approx(expected * 0.7)
        assert hd95_mm(column, first, (0.7, 0.3)) == pytest.approx(
            monai_hd95(column, first, (0.7, 0.3)), rel=1e-6
        )


def test_hd95_equals_monais_distances_in_double_precision() -> None:
    from monai.metrics.utils import get_mask_edges, get_surface_distance

    for prediction, reference, spacing_mm in random_pairs():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            edges = get_mask_edges(prediction, reference)
        directed = [
            np.quantile(get_surface_distance(*pair, spacing=list(spacing_mm)).astype(np.float64), 0.95)
            for pair in (edges, edges[::-1])
        ]
        assert hd95_mm(prediction, reference, spacing_mm) == pytest.approx(max(directed), abs=1e-6)


def test_surfel_hd95_equals_surface_distance() -> None:
    import surface_distance

    for prediction, reference, spacing_mm in random_pairs():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            distances = surface_distance.compute_surface_distances(reference, prediction, spacing_mm)
            expected = surface_distance.compute_robust_hausdorff(distances, 95)
        assert hd95_surfel_mm(prediction, reference, spacing_mm) == pytest.approx(expected, abs=1e-6)


def test_one_spacing_means_square_pixels() -> None:
    other = np.roll(SQUARE, (1, 2), (0, 1))
    assert (
        hd95_mm(other, SQUARE, 0.3)
        == hd95_mm(other, SQUARE, [0.3, 0.3])
        == hd95_mm(other, SQUARE, np.full(2, 0.3))
    )


def test_diagonal() -> None:
    assert diagonal((300, 200), (1.0, 2.0)) == 500.0


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    ("prediction", "message"),
    [
        (np.zeros((5, 6), bool), r"prediction: expected the reference's size \(6, 6\), received \(5, 6\)"),
        (np.full((6, 6), 255, np.uint8), "prediction: expected bool or integers 0 and 1"),
        (np.zeros((6, 6), np.float32), "prediction: expected bool or integers 0 and 1, received float32"),
    ],
)
def test_refuses_what_is_no_mask(metric, prediction: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        metric(prediction, SQUARE)


@pytest.mark.parametrize("spacing_mm", [0.0, (1.0, -1.0), (1.0, 1.0, 1.0), (float("nan"), 1.0), ()])
def test_refuses_what_is_no_spacing(spacing_mm) -> None:
    with pytest.raises(InputError, match="spacing_mm: expected one or two positive numbers"):
        hd95_mm(SQUARE, SQUARE, spacing_mm)


@pytest.mark.parametrize(
    "prediction, reference, message",
    [
        (np.ones((2, 3, 4), bool), np.ones((2, 3, 4), bool), r"^prediction: expected a mask of shape"),
        (np.ones((0, 3), bool), np.ones((0, 3), bool), r"^prediction: expected a mask of shape"),
        (np.ones((3, 3), bool), np.full((3, 3), 2), r"^reference: expected bool or integers 0 and 1"),
        (np.ones((3, 3), bool), np.full((3, 3), 0.5), r"^reference: expected bool or integers 0 and 1"),
        (np.full((3, 3), -1), np.ones((3, 3), bool), r"^prediction: expected bool or integers 0 and 1"),
    ],
)
def test_the_mask_that_is_none_is_named(prediction, reference, message: str) -> None:
    with pytest.raises(InputError, match=message):
        inspect.unwrap(dsc)(prediction, reference)  # without the check of shapes, as a user has it


def test_masks_of_one_pixel() -> None:
    one = np.ones((1, 1), bool)
    assert (dsc(one, one), hd95_px(one, one)) == (1.0, 0.0)
