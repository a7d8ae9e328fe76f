from typing import Any

import pytest
from dicom_files import region
from pydicom.dataset import Dataset
from pydicom.sequence import Sequence

from experiments.datasets.images.dicom_geometry import region_of, spacing_mm_of


def content(*regions: Dataset, **attributes: Any) -> Dataset:
    made = Dataset()
    if regions:
        made.SequenceOfUltrasoundRegions = Sequence(regions)
    for name, value in attributes.items():
        setattr(made, name, value)
    return made


def test_pixels_that_are_not_square_keep_vertical_and_horizontal_apart() -> None:
    file = content(region((10, 20, 109, 219), (0.02, 0.005)))
    assert spacing_mm_of(file) == pytest.approx((0.2, 0.05))
    assert region_of(file, 200, 300) == (10, 20, 110, 220)


def test_where_the_axes_start_and_which_way_they_run_says_nothing_of_size() -> None:
    oblique = region(
        (0, 0, 99, 99),
        (-0.01, 0.03),
        ReferencePixelX0=-37,
        ReferencePixelY0=812,
        ReferencePixelPhysicalValueX=4.5,
    )
    assert spacing_mm_of(content(oblique)) == pytest.approx((0.1, 0.3))


def test_of_several_tissue_regions_the_largest_counts() -> None:
    small, large = region((0, 0, 49, 49), (0.01, 0.01)), region((0, 60, 89, 199), (0.02, 0.02))
    for order in ((small, large), (large, small)):
        assert spacing_mm_of(content(*order)) == pytest.approx((0.2, 0.2))
        assert region_of(content(*order), 100, 200) == (0, 60, 90, 200)


@pytest.mark.parametrize(
    "changes",
    [
        {"RegionSpatialFormat": 2},  # M-mode
        {"RegionDataType": 3},  # spectral Doppler
        {"PhysicalUnitsXDirection": 4},  # seconds
        {"PhysicalUnitsYDirection": 7},  # cm/s
        {"PhysicalDeltaX": 0.0},
        {"PhysicalDeltaY": None},
        {"PhysicalUnitsXDirection": None},
        {"RegionDataType": None},
    ],
)
def test_a_region_that_is_no_measured_tissue_is_passed_over(changes: dict[str, Any]) -> None:
    other = region((0, 0, 199, 199), (0.05, 0.05), **changes)
    assert spacing_mm_of(content(other)) is None and region_of(content(other), 200, 200) is None
    tissue = region((0, 0, 49, 49), (0.01, 0.02))
    assert spacing_mm_of(content(other, tissue)) == pytest.approx((0.1, 0.2))
    assert spacing_mm_of(content(other, PixelSpacing=[0.4, 0.3])) == pytest.approx((0.4, 0.3))


def test_without_regions_pixel_spacing_in_mm_is_row_step_then_column_step() -> None:
    assert spacing_mm_of(content(PixelSpacing=[0.4, 0.3])) == (0.4, 0.3)
    assert spacing_mm_of(
        content(region((0, 0, 9, 9), (0.01, 0.01)), PixelSpacing=[0.4, 0.3])
    ) == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize(
    "attributes", [{}, {"PixelSpacing": None}, {"PixelSpacing": [0.0, 0.3]}, {"PixelSpacing": []}]
)
def test_what_is_not_said_is_unknown(attributes: dict[str, Any]) -> None:
    assert spacing_mm_of(content(**attributes)) is None


def test_a_region_is_cut_to_the_frame_and_one_beside_it_is_none() -> None:
    assert region_of(content(region((5, 5, 500, 500), (0.01, 0.01))), 100, 80) == (5, 5, 100, 80)
    assert region_of(content(region((300, 5, 500, 50), (0.01, 0.01))), 100, 80) is None
