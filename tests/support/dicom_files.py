"""DICOM files built by hand: pixels as they are, and whichever attributes a test is about."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.sequence import Sequence
from pydicom.uid import ExplicitVRLittleEndian, UltrasoundMultiFrameImageStorage, generate_uid


def region(box: tuple[int, int, int, int], step_cm: tuple[float, float], **changes: Any) -> Dataset:
    """A 2-D tissue region: top, left, bottom, right (inclusive, as the file has it) and (vertical, horizontal) step."""
    item = Dataset()
    item.RegionSpatialFormat, item.RegionDataType = 1, 1
    item.PhysicalUnitsXDirection = item.PhysicalUnitsYDirection = 3
    item.RegionLocationMinY0, item.RegionLocationMinX0 = box[0], box[1]
    item.RegionLocationMaxY1, item.RegionLocationMaxX1 = box[2], box[3]
    item.PhysicalDeltaY, item.PhysicalDeltaX = step_cm
    for name, value in changes.items():
        if value is None:
            delattr(item, name)
        else:
            setattr(item, name, value)
    return item


def write_dicom(
    path: Path,
    pixels: np.ndarray,
    photometric: str = "MONOCHROME2",
    regions: tuple[Dataset, ...] = (),
    syntax: str = ExplicitVRLittleEndian,
    encoded: list[bytes] | None = None,
    **changes: Any,
) -> Path:
    """Write (h, w), (n, h, w), (h, w, 3) or (n, h, w, 3) pixels; a change of None leaves an attribute out.

    ``encoded`` are the compressed frames that take the place of the pixels under another transfer ``syntax``.
    """
    channels = 3 if pixels.shape[-1] == 3 and pixels.ndim >= 3 else 1
    size = pixels.shape[: pixels.ndim - (channels == 3)]
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = (
        UltrasoundMultiFrameImageStorage,
        generate_uid(),
    )
    meta.TransferSyntaxUID = syntax
    content = FileDataset(str(path), {}, file_meta=meta, preamble=b"\0" * 128)
    content.SOPClassUID, content.SOPInstanceUID = (
        meta.MediaStorageSOPClassUID,
        meta.MediaStorageSOPInstanceUID,
    )
    content.Modality = "US"
    content.Rows, content.Columns = size[-2:]
    if len(size) == 3:
        content.NumberOfFrames = size[0]
    content.SamplesPerPixel, content.PhotometricInterpretation = channels, photometric
    if channels == 3:
        content.PlanarConfiguration = 0
    content.BitsAllocated = content.BitsStored = 8 * pixels.dtype.itemsize
    content.HighBit, content.PixelRepresentation = content.BitsStored - 1, 0
    if regions:
        content.SequenceOfUltrasoundRegions = Sequence(regions)
    content.PixelData = pixels.tobytes() if encoded is None else encapsulate(encoded)
    content["PixelData"].VR = "OB" if pixels.dtype.itemsize == 1 else "OW"
    for name, value in changes.items():
        if value is None:
            delattr(content, name)
        else:
            setattr(content, name, value)
    content.save_as(path, enforce_file_format=False)
    return path
