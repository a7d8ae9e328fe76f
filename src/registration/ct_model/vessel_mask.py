"""One vessel out of a label map: its voxels, where they lie, and where the scan cut it off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Shaped

from registration import transforms
from registration.ct_model.label_map import LabelMap
from registration.errors import InputError
from registration.io.segments import Segment

# Segmentations of the whole body have a hundred labels or two, a CT itself has thousands of values.
MAX_LABELS = 300
LISTED_LABELS = 20
# Noise leaves cavities of a few voxels; the lumen of a printed wall is as large as the wall itself.
CAVITY_SHARE = 0.1


@dataclass(frozen=True)
class VesselMask:
    """The voxels of one vessel: its largest piece, small cavities filled, cropped to the box around it.

    Parameters
    ----------
    inside : ndarray of bool, shape (i, j, k)
        Which voxels belong to the vessel.
    ct_A_voxel : ndarray, shape (4, 4)
        Map from the indices of ``inside`` to mm in LPS.
    cut : ndarray of bool, shape (3, 2)
        For the low and the high side of each axis, whether the vessel reaches the border of the scan there:
        it was cut off, and continues beyond.
    label : int
        Value of the label.
    pieces_dropped : int
        Number of smaller pieces left out.
    voxels_dropped : int
        Number of voxels in them.
    voxels_filled : int
        Number of voxels in cavities that were filled.
    name : str, optional
        Name of the segment, where the file has one.
    """

    inside: Bool[np.ndarray, "i j k"]
    ct_A_voxel: Float64[np.ndarray, "4 4"]
    cut: Bool[np.ndarray, "3 2"]
    label: int
    pieces_dropped: int
    voxels_dropped: int
    voxels_filled: int
    name: str = ""

    @property
    def spacing_mm(self) -> Float64[np.ndarray, "3"]:
        """The distance of neighbouring voxels along i, j and k."""
        return np.asarray(np.linalg.norm(self.ct_A_voxel[:3, :3], axis=0))

    @property
    def volume_mm3(self) -> float:
        """The volume of all voxels together."""
        return float(self.inside.sum() * np.prod(self.spacing_mm))


def vessel_mask(label_map: LabelMap, label: int | str | None = None) -> VesselMask:
    """Take one vessel out of a label map.

    The largest piece is by voxels that touch at least at a corner; cavities are what it encloses on all
    sides. A cavity of ``CAVITY_SHARE`` of the piece or more may be a lumen and is left.

    Parameters
    ----------
    label_map : LabelMap
        Labels and where they lie.
    label : int or str, optional
        Number or name of the segment; may be left out where there is only one.

    Returns
    -------
    VesselMask
        Voxels of the vessel.

    Raises
    ------
    InputError
        If the map is empty, the label is not there, or a choice was not made.
    """
    from scipy.ndimage import label as label_pieces

    labels, chosen, name = _choose(label_map, label)
    there = labels == chosen
    box = _box(there)
    pieces, count = label_pieces(there[box], structure=np.ones((3, 3, 3)))
    sizes = np.bincount(pieces.reshape(-1))[1:]
    largest = pieces == 1 + int(sizes.argmax())
    inner = _box(largest)
    inside = _without_small_cavities(largest[inner])
    start = np.array([outer.start + own.start for outer, own in zip(box, inner, strict=True)])
    ends = label_map.scan_ends
    if ends is None:
        ends = np.stack([np.zeros(3, dtype=np.int64), np.array(labels.shape) - 1], axis=1)
    cut = np.stack([start <= ends[:, 0], start + inside.shape - 1 >= ends[:, 1]], axis=1)
    ct_A_voxel = transforms.compose(label_map.ct_A_voxel, transforms.translation(start.astype(np.float64)))
    return VesselMask(
        inside=inside,
        ct_A_voxel=ct_A_voxel,
        cut=cut,
        label=chosen,
        pieces_dropped=int(count) - 1,
        voxels_dropped=int(sizes.sum() - sizes.max()),
        voxels_filled=int(inside.sum() - sizes.max()),
        name=name,
    )


def _without_small_cavities(inside: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "i j k"]:
    from scipy.ndimage import binary_fill_holes
    from scipy.ndimage import label as label_pieces

    filled: np.ndarray = binary_fill_holes(inside)
    cavities, count = label_pieces(filled & ~inside)
    if not count:
        return filled
    large = np.bincount(cavities.reshape(-1)) >= CAVITY_SHARE * inside.sum()
    large[0] = False
    return filled & ~large[cavities]


def _choose(label_map: LabelMap, label: int | str | None) -> tuple[Shaped[np.ndarray, "i j k"], int, str]:
    """The labels of the layer that is meant, the value in them, and the segment's name."""
    if label_map.layers is not None:
        segment = _segment(label_map.segments, label)
        layer = (
            label_map.layers[segment.layer] if segment.layer < len(label_map.layers) else np.zeros((1, 1, 1))
        )
        if not (layer == segment.label).any():
            raise InputError(
                f"label: expected a segment with voxels, received {_named(segment)}, which has none"
            )
        return layer, segment.label, segment.name
    if isinstance(label, str):
        label = _segment(label_map.segments, label).label
    chosen = _value(label_map, label)
    return label_map.labels, chosen, label_map.names.get(chosen, "")


def _segment(segments: tuple[Segment, ...], label: int | str | None) -> Segment:
    """The one segment that is meant by its name, its identifier or its value."""
    listed = ", ".join(_named(segment) for segment in segments[:LISTED_LABELS])
    listed += f" and {len(segments) - LISTED_LABELS} more" if len(segments) > LISTED_LABELS else ""
    if not segments:
        raise InputError(f"label: expected a number, because the file names no segments, received {label!r}")
    if label is None:
        found = segments
    elif isinstance(label, int):
        found = tuple(segment for segment in segments if segment.label == label)
    else:
        found = tuple(segment for segment in segments if label in (segment.name, segment.identifier))
    if len(found) != 1:
        received = "none" if label is None else f"{label!r}, which {len(found)} of them have"
        raise InputError(f"label: expected the name of one of {listed}, received {received}")
    return found[0]


def _named(segment: Segment) -> str:
    return segment.name or segment.identifier or str(segment.label)


def _value(label_map: LabelMap, label: int | None) -> int:
    there = label_map.labels[label_map.labels != 0]
    values = [int(value) for value in np.unique(there)]
    if len(values) > MAX_LABELS:
        raise InputError(
            f"labels: expected a label map, received {len(values)} different values from {values[0]} to {values[-1]}: "
            "a grey image?"
        )
    listed = ", ".join(label_map.describe(value) for value in values[:LISTED_LABELS])
    listed += f" and {len(values) - LISTED_LABELS} more" if len(values) > LISTED_LABELS else ""
    if not values:
        raise InputError("labels: expected at least one voxel with a label, received a map of zeros")
    if label is None and len(values) > 1:
        raise InputError(f"label: expected one of {listed}, because there are {len(values)}, received none")
    chosen = values[0] if label is None else label
    if chosen not in values:
        raise InputError(f"label: expected one of {listed}, received {chosen}")
    return chosen


def _box(inside: Bool[np.ndarray, "i j k"]) -> tuple[slice, ...]:
    """The smallest box around all that is inside."""
    slices = []
    for axis in range(3):
        used = np.flatnonzero(inside.any(axis=tuple(other for other in range(3) if other != axis)))
        slices.append(slice(int(used[0]), int(used[-1]) + 1))
    return tuple(slices)
