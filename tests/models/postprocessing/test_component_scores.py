import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from models.errors import InputError
from models.metrics.masks import dsc
from models.postprocessing import PostprocessingGrid, SelectionCase
from models.postprocessing.component_scores import ComponentScorer, component_table


def case(seed: int, spacing_mm: tuple[float, float] | None = None, scale: float = 1.0) -> SelectionCase:
    generator = np.random.default_rng(seed)
    smooth = gaussian_filter(generator.standard_normal((48, 40)), 2)
    probability = scale * (smooth - smooth.min()) / np.ptp(smooth)
    reference = gaussian_filter(generator.standard_normal((48, 40)), 3) + 0.5 * smooth > 0.05
    return SelectionCase(probability.astype(np.float32), reference, "a", spacing_mm)


def test_the_table_of_drawn_components() -> None:
    probability = np.array([[0.9, 0.4, 0.0, 0.3], [0.0, 0.0, 0.0, 0.6], [0.5, 0.0, 0.0, 0.0]], np.float32)
    reference = np.array([[1, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]], bool)
    table = component_table(SelectionCase(probability, reference, "a"), 0.3, 1)
    assert table.areas.tolist() == [2, 2, 1] and table.overlaps.tolist() == [1, 2, 0]
    np.testing.assert_allclose(table.peaks, [0.9, 0.6, 0.5], rtol=1e-6)


@pytest.mark.parametrize("connectivity", [1, 2])
@pytest.mark.parametrize("spacing_mm", [None, (0.5, 0.3)])
def test_all_scores_equal_those_of_the_masks(
    connectivity: int, spacing_mm: tuple[float, float] | None
) -> None:
    areas = (0.0, 8.0, 40.0)
    grid = PostprocessingGrid(
        lows=(0.3, 0.5, 0.7),
        highs=(0.3, 0.5, 0.7, 0.9),
        min_areas_px=areas,
        min_areas_mm2=None if spacing_mm is None else tuple(0.15 * area for area in areas),
        min_peaks=(0.0, 0.75),
        largest_only=(False, True),
        connectivity=connectivity,
    )
    options = grid.options
    scorer = ComponentScorer(options)
    for seed, scale in ((0, 1.0), (1, 1.0), (2, 0.7), (3, 0.8)):
        one = case(seed, spacing_mm, scale)
        dscs, found = scorer(one)
        assert dscs is not None
        masks = [option(one.probability, spacing_mm) for option in options]
        np.testing.assert_allclose(dscs, [dsc(mask, one.reference) for mask in masks], rtol=1e-12)
        assert found.tolist() == [bool(mask.any()) for mask in masks]
    assert len({round(float(value), 6) for value in dscs}) > 5


def test_an_image_without_a_vessel_has_no_dsc() -> None:
    one = case(0)
    scorer = ComponentScorer(PostprocessingGrid().options)
    dscs, found = scorer(SelectionCase(one.probability, np.zeros_like(one.reference), "a"))
    assert dscs is None and found.all()
    dscs, found = scorer(SelectionCase(0 * one.probability, one.reference, "a"))
    assert dscs is not None and not dscs.any() and not found.any()


def test_refuses_other_sizes_and_areas_without_spacing() -> None:
    one = case(0)
    with pytest.raises(InputError, match=r"reference: expected the probabilities' size .* in group a"):
        SelectionCase(one.probability, one.reference[1:], "a")
    with pytest.raises(
        InputError, match=r"spacing_mm: expected the size of a pixel .* received None in group a"
    ):
        ComponentScorer(PostprocessingGrid(min_areas_mm2=(2.0,)).options)(one)
