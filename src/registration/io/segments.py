"""The segments of a 3D Slicer segmentation (``.seg.nrrd``): their names, layers and labels, and where the scan ends.

Slicer crops the file to the segments, or writes more than the scan; its header keeps the image that was segmented.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration import transforms

_LABEL = re.compile(r"^Segment(\d+)_LabelValue$")
_OFFSET = "Segmentation_ReferenceImageExtentOffset"
_CONVERSION = "Segmentation_ConversionParameters"
# The reference image in the conversion parameters: a 4x4 matrix to RAS in mm, first and last index of each axis.
_GEOMETRY = re.compile(r"Reference image geometry\|([^|]*)")
_LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
# By how much of a voxel two grids may miss each other, and how far their axes may be from parallel.
_SHARE_OF_VOXEL, _SKEW = 0.25, 1e-3


@dataclass(frozen=True)
class Segment:
    """One segment of a label map.

    Parameters
    ----------
    label : int
        Value of its voxels.
    layer : int
        Layer that they lie in.
    name : str
        Name, may be empty.
    identifier : str
        Identifier, may be empty.
    """

    label: int
    layer: int
    name: str
    identifier: str


def read_segments(facts: Mapping[str, str]) -> tuple[Segment, ...]:
    """Read the segments in the keys of a header.

    Parameters
    ----------
    facts : mapping of str to str
        Keys and values of the header.

    Returns
    -------
    tuple of Segment
        Segments in their order.
    """
    numbers = sorted(int(found[1]) for key in facts if (found := _LABEL.match(key)))
    segments = []
    for number in numbers:
        label = facts[f"Segment{number}_LabelValue"].strip()
        layer = facts.get(f"Segment{number}_Layer", "0").strip()
        if label.isdigit() and layer.isdigit():
            name, identifier = (facts.get(f"Segment{number}_{key}", "").strip() for key in ("Name", "ID"))
            segments.append(Segment(int(label), int(layer), name, identifier))
    return tuple(segments)


def scan_ends(
    facts: Mapping[str, str], sizes: Sequence[int], ct_A_voxel: Float64[np.ndarray, "4 4"]
) -> Int64[np.ndarray, "3 2"]:
    """Compute the first and last index of the scan along each axis of the file.

    Parameters
    ----------
    facts : mapping of str to str
        Keys and values of the header.
    sizes : sequence of int
        Sizes of the file's axes i, j and k.
    ct_A_voxel : ndarray, shape (4, 4)
        Map from the file's indices to mm in LPS.

    Returns
    -------
    ndarray, shape (3, 2)
        Indices, which may lie outside the file; the file's own ends where the header does not say where its
        voxels lie in the scan.
    """
    ends = np.stack([np.zeros(3, dtype=np.int64), np.array(sizes, dtype=np.int64) - 1], axis=1)
    reference = _reference(facts)
    if reference is not None:
        from_reference = _in_voxels(*reference, ct_A_voxel)
        return ends if from_reference is None else from_reference
    offset = _numbers(facts.get(_OFFSET, "").split())
    if len(offset) == 3:
        # Axes of a scan begin at 0; where they end is not known.
        ends[:, 0] = -np.rint(offset).astype(np.int64)
    return ends


def _reference(facts: Mapping[str, str]) -> tuple[np.ndarray, np.ndarray] | None:
    """The reference image: its voxels to LPS in mm (4, 4), and the first and last index of each axis (3, 2)."""
    found = _GEOMETRY.search(facts.get(_CONVERSION, ""))
    numbers = _numbers([word for word in found[1].split(";") if word.strip()]) if found else []
    if len(numbers) < 22:
        return None
    matrix = _LPS_FROM_RAS @ np.array(numbers[:16]).reshape(4, 4)
    extent = np.array(numbers[16:22]).reshape(3, 2)
    usable = abs(np.linalg.det(matrix[:3, :3])) > 0 and (extent[:, 1] >= extent[:, 0]).all()
    return (matrix, extent) if usable else None


def _in_voxels(
    ct_A_reference: np.ndarray, extent: np.ndarray, ct_A_voxel: np.ndarray
) -> Int64[np.ndarray, "3 2"] | None:
    """The extent of the reference in indices of the file, whose voxels may be finer; None for other axes."""
    voxel_A_reference = np.linalg.inv(ct_A_voxel) @ ct_A_reference
    along = np.abs(voxel_A_reference[:3, :3])
    if (np.sort(along, axis=1)[:, :-1] > _SKEW * along.max()).any():
        return None
    # The outer sides of the first and last voxel, not their centres.
    sides = extent + np.array([-0.5, 0.5])
    corners = transforms.apply(voxel_A_reference, np.array(list(itertools.product(*sides))))
    first = np.ceil(corners.min(axis=0) + 0.5 - _SHARE_OF_VOXEL)
    last = np.floor(corners.max(axis=0) - 0.5 + _SHARE_OF_VOXEL)
    return np.stack([first, last], axis=1).astype(np.int64)


def _numbers(words: Sequence[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        return []
