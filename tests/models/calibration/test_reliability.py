import numpy as np
import pytest
import torch
from monai.metrics import CalibrationErrorMetric
from torchmetrics.functional.classification import binary_calibration_error

from models.calibration import adaptive_table, equal_width_table, fine_table
from models.errors import InputError


def drawn(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    probability = generator.beta(0.4, 0.6, n).astype(np.float32)
    return probability, generator.random(n) < probability**1.5


def test_a_table_by_hand() -> None:
    probability = np.array([[0.0, 0.1, 0.2], [0.5, 0.9, 1.0]])
    reference = np.array([[0, 1, 0], [1, 1, 1]])
    table = equal_width_table(probability, reference, 4)
    assert table.counts.tolist() == [3, 0, 1, 2] and table.vessel_counts.tolist() == [1, 0, 1, 2]
    np.testing.assert_allclose(table.confidence, [0.1, np.nan, 0.5, 0.95])
    np.testing.assert_allclose(table.frequency, [1 / 3, np.nan, 1.0, 1.0])
    gaps = [1 / 3 - 0.1, 0.5, 0.05]
    assert table.expected_gap == pytest.approx((3 * gaps[0] + gaps[1] + 2 * gaps[2]) / 6)
    assert table.mean_gap == pytest.approx(sum(gaps) / 3) and table.max_gap == pytest.approx(0.5)


@pytest.mark.parametrize("n_bins", [1, 7, 15, 20])
def test_equals_torchmetrics_and_monai(n_bins: int) -> None:
    probability, reference = drawn(30_000)
    table = equal_width_table(probability, reference, n_bins)
    tensors = torch.from_numpy(probability), torch.from_numpy(reference).int()
    for norm, ours in (("l1", table.expected_gap), ("max", table.max_gap)):
        assert ours == pytest.approx(
            float(binary_calibration_error(*tensors, n_bins=n_bins, norm=norm)), abs=2e-6
        )
    for reduction, ours in (
        ("expected", table.expected_gap),
        ("average", table.mean_gap),
        ("maximum", table.max_gap),
    ):
        metric = CalibrationErrorMetric(num_bins=n_bins, calibration_reduction=reduction)
        metric(y_pred=tensors[0][None, None], y=tensors[1][None, None])
        assert ours == pytest.approx(float(metric.aggregate()), abs=2e-5)


def test_tables_of_parts_add_up_to_that_of_the_whole() -> None:
    probability, reference = drawn(5000)
    for make in (lambda p, y: equal_width_table(p, y, 15), fine_table):
        whole = make(probability, reference)
        parts = make(probability[:700], reference[:700]) + make(probability[700:], reference[700:])
        np.testing.assert_array_equal(parts.counts, whole.counts)
        np.testing.assert_array_equal(parts.vessel_counts, whole.vessel_counts)
        np.testing.assert_allclose(parts.probability_sums, whole.probability_sums)
        assert parts.pixels == 5000


def test_fine_bins_are_narrow_near_nought_and_one_and_in_order() -> None:
    values = np.array([0.0, 1e-6, 1e-3, 0.3, 0.5, 0.7, 1 - 1e-3, 1 - 1e-6, 1.0])
    places = [int(np.flatnonzero(fine_table(np.array([value]), np.array([0])).counts)[0]) for value in values]
    assert places == sorted(set(places)) and places[0] == 0
    assert places[-1] == len(fine_table(values, values > 2).counts) - 1


def test_an_adaptive_table_equals_equal_parts_of_the_sorted_pixels() -> None:
    # Every probability is a 16-bit one of its own, so that a fine bin holds one pixel.
    values = np.arange(9000, 10200, dtype=np.uint16).view(np.float16).astype(np.float64)
    generator = np.random.default_rng(0)
    reference = generator.random(len(values)) < 0.2
    order = generator.permutation(len(values))
    table = adaptive_table(fine_table(values[order], reference[order]), 12)
    assert table.counts.tolist() == [len(values) // 12] * 12
    gaps = [
        abs(part.mean() - labels.mean())
        for part, labels in zip(values.reshape(12, -1), reference.reshape(12, -1), strict=True)
    ]
    assert table.expected_gap == pytest.approx(np.mean(gaps), rel=1e-9)


def test_an_adaptive_table_of_any_probabilities_is_nearly_that_of_the_sorted_pixels() -> None:
    probability, reference = drawn(60_000)
    order = np.argsort(probability, kind="stable")
    parts = np.array_split(order, 15)
    gaps = [abs(float(probability[part].mean()) - float(reference[part].mean())) for part in parts]
    table = adaptive_table(fine_table(probability, reference), 15)
    assert table.expected_gap == pytest.approx(np.mean(gaps), abs=1e-3)
    assert table.counts.min() > 0.98 * 4000 and table.counts.max() < 1.02 * 4000


def test_equal_probabilities_are_never_parted() -> None:
    probability = np.array([0.0] * 90 + [0.25] * 10)
    reference = np.array([False] * 90 + [True] * 10)
    table = adaptive_table(fine_table(probability, reference), 10)
    assert sorted(table.counts.tolist()) == [0] * 8 + [10, 90]
    assert table.expected_gap == pytest.approx(0.1 * 0.75)


def test_no_pixels_have_no_calibration() -> None:
    empty = np.zeros(0, np.float32), np.zeros(0, bool)
    table = equal_width_table(*empty, 5)
    assert table.pixels == 0 and np.isnan([table.expected_gap, table.mean_gap, table.max_gap]).all()
    assert np.isnan(adaptive_table(fine_table(*empty), 5).expected_gap)


def test_refuses_other_ranges_shapes_and_bins() -> None:
    probability, reference = drawn(10)
    with pytest.raises(InputError, match="n_bins: expected at least 1"):
        equal_width_table(probability, reference, 0)
    with pytest.raises(InputError, match="n_bins: expected at least 1"):
        adaptive_table(fine_table(probability, reference), 0)
    for wrong in (probability + 1, np.full(10, np.nan)):
        with pytest.raises(InputError, match="probability: expected 0 to 1"):
            equal_width_table(wrong, reference, 5)
    with pytest.raises(
        InputError, match=r"reference: expected the probabilities' shape \(10,\), received \(9,\)"
    ):
        equal_width_table(probability, reference[1:], 5)
    with pytest.raises(InputError, match="reference: expected 0 and 1"):
        fine_table(probability, 2 * reference.astype(int) + 1)
    with pytest.raises(InputError, match="bins: expected 5 in both"):
        _ = equal_width_table(probability, reference, 5) + equal_width_table(probability, reference, 6)
