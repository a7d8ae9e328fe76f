"""How large a pixel of a DICOM ultrasound file is, and where in the screen its picture lies.

An ultrasound file measures its screen region by region (DICOM PS3.3, C.8.5.5, US Region Calibration): the picture of
the tissue, a trace below it, a colour box. Where a region's axes have their origin says nothing about a pixel's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from experiments.datasets.images.dicom_grey import functional_groups
from experiments.errors import InputError

if TYPE_CHECKING:
    from pydicom import Dataset

# C.8.5.5.1: codes of a region's format (2-D), of its data (tissue) and of its units along an axis (cm).
FORMAT_2D, TISSUE, CENTIMETRES = 1, 1, 3
MM_PER_CM = 10.0


def spacing_mm_of(content: Dataset) -> tuple[float, float] | None:
    """Return the pixel size of the largest 2-D tissue region, else PixelSpacing.

    Parameters
    ----------
    content : pydicom.Dataset
        The file.

    Returns
    -------
    (float, float) or None
        Vertical and horizontal size in mm; None where the file has neither.

    Raises
    ------
    InputError
        If frames have different pixel sizes.

    Notes
    -----
    An enhanced file has PixelSpacing in its functional groups (PS3.3, C.7.6.16.2.1, Pixel Measures).
    """
    region = _tissue_region(content)
    if region is not None:
        # A negative step says which way the axis runs, not how large a pixel is.
        steps_cm = abs(float(region.PhysicalDeltaY)), abs(float(region.PhysicalDeltaX))
        return _positive(MM_PER_CM * steps_cm[0], MM_PER_CM * steps_cm[1])
    return _plain_spacing_mm(content)


def _plain_spacing_mm(content: Dataset) -> tuple[float, float] | None:
    found = {_pair(content.get("PixelSpacing"))} - {None}
    if not found:
        for number in range(int(content.get("NumberOfFrames") or 1)):
            measures = functional_groups(content, number, "PixelMeasuresSequence")
            found.add(next((_pair(item.get("PixelSpacing")) for item in measures), None))
    if len(found) > 1:
        raise InputError(
            f"{getattr(content, 'filename', 'DICOM file')}: expected one pixel size for all frames, "
            f"received {len(found)}"
        )
    return next(iter(found), None)


def _pair(spacing: Sequence[float] | None) -> tuple[float, float] | None:
    return _positive(float(spacing[0]), float(spacing[1])) if spacing and len(spacing) == 2 else None


def region_of(content: Dataset, height: int, width: int) -> tuple[int, int, int, int] | None:
    """Return the largest 2-D tissue region.

    Parameters
    ----------
    content : pydicom.Dataset
        The file.
    height, width : int
        Size of its frames in px.

    Returns
    -------
    (int, int, int, int) or None
        Top, left, bottom, right in px, the last two exclusive; None where there is none within the frame.
    """
    region = _tissue_region(content)
    if region is None:
        return None
    top, left, bottom, right = _corners_px(region)
    box = max(0, top), max(0, left), min(height, bottom), min(width, right)
    return box if box[0] < box[2] and box[1] < box[3] else None


def _tissue_region(content: Dataset) -> Dataset | None:
    """Return the largest 2-D region of tissue with a pixel size in cm."""
    regions = [region for region in content.get("SequenceOfUltrasoundRegions") or () if _is_measured(region)]
    return max(regions, key=_area_px, default=None)


def _is_measured(region: Dataset) -> bool:
    return (
        region.get("RegionSpatialFormat") == FORMAT_2D
        and region.get("RegionDataType") == TISSUE
        and region.get("PhysicalUnitsXDirection") == CENTIMETRES
        and region.get("PhysicalUnitsYDirection") == CENTIMETRES
        and bool(region.get("PhysicalDeltaX"))
        and bool(region.get("PhysicalDeltaY"))
    )


def _area_px(region: Dataset) -> int:
    top, left, bottom, right = _corners_px(region)
    return max(0, bottom - top) * max(0, right - left)


def _corners_px(region: Dataset) -> tuple[int, int, int, int]:
    # The last row and column that the file names belong to the region.
    return (
        int(region.RegionLocationMinY0),
        int(region.RegionLocationMinX0),
        int(region.RegionLocationMaxY1) + 1,
        int(region.RegionLocationMaxX1) + 1,
    )


def _positive(vertical_mm: float, horizontal_mm: float) -> tuple[float, float] | None:
    known = 0 < vertical_mm < float("inf") and 0 < horizontal_mm < float("inf")
    return (vertical_mm, horizontal_mm) if known else None
