"""Tracked frames pasted into a volume, to check poses and calibration against a reconstruction made elsewhere.

Extent and pasting follow the volume reconstruction of PLUS (Gobbi and Peters, MICCAI 2002, for pasting with trilinear
weights): every pixel goes forward into the volume, holes stay empty.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, UInt8

from registration.brief import brief_repr
from registration.checks import require_positive
from registration.errors import InputError


@dataclass(frozen=True)
class VolumeGrid:
    """Grid of voxel centres at ``origin_mm + index * spacing_mm``, axes along the reference's.

    Parameters
    ----------
    origin_mm : ndarray, shape (3,)
        Centre of the first voxel in the reference coordinate frame in mm.
    spacing_mm : float
        Distance between voxel centres in mm.
    size : tuple[int, int, int]
        Number of voxels along x, y and z.

    Raises
    ------
    InputError
        If the spacing is not positive or an axis has no voxel.
    """

    origin_mm: Float64[np.ndarray, "3"]
    spacing_mm: float
    size: tuple[int, int, int]

    def __post_init__(self) -> None:
        require_positive("spacing_mm", self.spacing_mm)
        if min(self.size) < 1:
            raise InputError(f"size: expected at least one voxel along every axis, received {self.size}")


@dataclass(frozen=True)
class PlacedVolume:
    """Volume that frames were pasted into.

    Parameters
    ----------
    grid : VolumeGrid
        Grid of the volume.
    values : ndarray, shape (z, y, x)
        Grey values, 0 in voxels that no pixel fell into.
    filled : ndarray of bool, shape (z, y, x)
        Voxels that a pixel fell into.
    """

    grid: VolumeGrid
    values: Float64[np.ndarray, "z y x"]
    filled: Bool[np.ndarray, "z y x"]

    __repr__ = brief_repr


@dataclass(frozen=True)
class Agreement:
    """Agreement of a placed volume with a reference on the same grid.

    Parameters
    ----------
    reference_covered : float
        Share of the reference's non-zero voxels that were filled.
    correlation : float
        Pearson correlation over the voxels that both have.
    difference_mean : float
        Mean absolute difference in grey levels over these voxels.
    same_share : float
        Share of these voxels that agree within one grey level.
    """

    reference_covered: float
    correlation: float
    difference_mean: float
    same_share: float


@dataclass(frozen=True)
class VolumePlacement:
    """Forward pasting of frames into a volume.

    Parameters
    ----------
    spacing_mm : float
        Distance between voxel centres in mm.
    interpolation : {"nearest", "linear"}, optional
        With ``linear`` a pixel is shared among its eight voxels.
    compounding : {"latest", "mean"}, optional
        With ``latest`` the last frame wins; it requires ``nearest``.
    clip_origin_px : tuple[int, int] or None, optional
        Column and row of the clip rectangle in px, outside which no pixel enters; None takes the whole frame.
    clip_size_px : tuple[int, int] or None, optional
        Width and height of the clip rectangle in px; None takes the whole frame.

    Raises
    ------
    InputError
        If a value is out of range, the modes do not fit, or only one part of the clip rectangle is given.
    """

    spacing_mm: float
    interpolation: str = "linear"
    compounding: str = "mean"
    clip_origin_px: tuple[int, int] | None = None
    clip_size_px: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        require_positive("spacing_mm", self.spacing_mm)
        if (self.interpolation, self.compounding) not in {
            ("nearest", "latest"),
            ("nearest", "mean"),
            ("linear", "mean"),
        }:
            raise InputError(
                "interpolation, compounding: expected nearest with latest or mean, or linear with mean, "
                f"received {self.interpolation!r} with {self.compounding!r}"
            )
        if (self.clip_origin_px is None) != (self.clip_size_px is None):
            raise InputError("clip_origin_px, clip_size_px: expected both or neither, received one")

    def grid(
        self, reference_A_pixel: Float[np.ndarray, "n 4 4"], height_px: int, width_px: int
    ) -> VolumeGrid:
        """Compute the smallest grid that holds all frames, from the lower corner of their bounding box.

        Parameters
        ----------
        reference_A_pixel : ndarray, shape (n, 4, 4)
            Affine matrix of each frame from pixels to reference coordinates in mm.
        height_px, width_px : int
            Size of the frames in px.

        Returns
        -------
        VolumeGrid
            The grid.

        Raises
        ------
        InputError
            If the clip rectangle does not lie within the frames.
        """
        left, top, right, bottom = self._clip(height_px, width_px)
        corners = np.array([[x, y, 0.0, 1.0] for x in (left, right) for y in (top, bottom)])
        points_mm = (corners @ np.swapaxes(reference_A_pixel, 1, 2))[..., :3].reshape(-1, 3)
        low_mm, high_mm = points_mm.min(axis=0), points_mm.max(axis=0)
        size = np.maximum(np.ceil((high_mm - low_mm) / self.spacing_mm), 1).astype(int)
        return VolumeGrid(low_mm, self.spacing_mm, (int(size[0]), int(size[1]), int(size[2])))

    def __call__(
        self,
        images: UInt8[np.ndarray, "n height width"],
        reference_A_pixel: Float64[np.ndarray, "n 4 4"],
        grid: VolumeGrid | None = None,
    ) -> PlacedVolume:
        """Paste all frames, in their order.

        Parameters
        ----------
        images : ndarray of uint8, shape (n, height, width)
            Grey values.
        reference_A_pixel : ndarray, shape (n, 4, 4)
            Affine matrix of each frame from pixels to reference coordinates in mm.
        grid : VolumeGrid or None, optional
            Grid to paste into; None takes that of the frames.

        Returns
        -------
        PlacedVolume
            The volume.

        Raises
        ------
        InputError
            If there is no frame, or the clip rectangle does not lie within the frames.
        """
        if not len(images):
            raise InputError("images: expected at least one frame, received none")
        height, width = images.shape[1:]
        grid = grid or self.grid(reference_A_pixel, height, width)
        left, top, right, bottom = self._clip(height, width)
        rows, columns = np.mgrid[top : bottom + 1, left : right + 1]
        weighted = np.zeros(int(np.prod(grid.size)))
        weight = np.zeros_like(weighted)
        for image, matrix in zip(images, reference_A_pixel, strict=True):
            place_mm = (
                columns.reshape(-1, 1) * matrix[:3, 0] + rows.reshape(-1, 1) * matrix[:3, 1] + matrix[:3, 3]
            )
            index = (place_mm - grid.origin_mm) / grid.spacing_mm
            values = image[top : bottom + 1, left : right + 1].reshape(-1).astype(np.float64)
            self._paste(weighted, weight, index, values, grid.size)
        filled = weight > 0
        mean = np.divide(weighted, weight, out=np.zeros_like(weighted), where=filled)
        shape = grid.size[::-1]
        return PlacedVolume(grid, mean.reshape(shape), filled.reshape(shape))

    def _clip(self, height_px: int, width_px: int) -> tuple[int, int, int, int]:
        """First and last column and row that enter: left, top, right, bottom."""
        if self.clip_origin_px is None or self.clip_size_px is None:
            return 0, 0, width_px - 1, height_px - 1
        (left, top), (across, down) = self.clip_origin_px, self.clip_size_px
        if not (0 <= left < width_px and 0 <= top < height_px and across > 0 and down > 0):
            raise InputError(
                f"clip_origin_px, clip_size_px: expected a rectangle within {width_px}x{height_px} px, "
                f"received {tuple(self.clip_origin_px)}, {tuple(self.clip_size_px)}"
            )
        # PLUS counts the rectangle's far side in and cuts it to the image.
        return left, top, min(width_px - 1, left + across), min(height_px - 1, top + down)

    def _paste(
        self,
        weighted: np.ndarray,
        weight: np.ndarray,
        index: Float64[np.ndarray, "m 3"],
        values: Float64[np.ndarray, " m"],
        size: tuple[int, int, int],
    ) -> None:
        """Add the pixels of one frame at fractional voxel indices, in place."""
        if self.interpolation == "nearest":
            voxel, inside = _flat(np.floor(index + 0.5).astype(np.int64), size)
            if self.compounding == "latest":
                weighted[voxel], weight[voxel] = values[inside], 1.0
            else:
                weighted += np.bincount(voxel, values[inside], minlength=len(weighted))
                weight += np.bincount(voxel, minlength=len(weight))
            return
        base = np.floor(index).astype(np.int64)
        inside = ((base >= -1) & (base < np.array(size))).all(axis=1)
        base, fraction, values = base[inside], (index - base)[inside], values[inside]
        for z, y, x in itertools.product((0, 1), repeat=3):
            share = np.ones(len(base))
            for axis, upper in enumerate((x, y, z)):
                share *= fraction[:, axis] if upper else 1 - fraction[:, axis]
            voxel, within = _flat(base + np.array([x, y, z]), size)
            low, high = (int(voxel.min()), int(voxel.max()) + 1) if len(voxel) else (0, 0)
            # Only the slab of voxels that this frame touches is summed over.
            weighted[low:high] += np.bincount(voxel - low, (share * values)[within], minlength=high - low)
            weight[low:high] += np.bincount(voxel - low, share[within], minlength=high - low)


def compare(placed: PlacedVolume, reference: UInt8[np.ndarray, "z y x"]) -> Agreement:
    """Compare a placed volume with a reference on the same grid.

    Parameters
    ----------
    placed : PlacedVolume
        Volume that frames were pasted into.
    reference : ndarray of uint8, shape (z, y, x)
        Grey values of the reference; 0 means that no pixel fell there.

    Returns
    -------
    Agreement
        Agreement of both.

    Raises
    ------
    InputError
        If the shapes differ or fewer than two voxels are in common.
    """
    if placed.values.shape != reference.shape:
        raise InputError(f"reference: expected shape {placed.values.shape}, received {reference.shape}")
    present = reference > 0
    both = present & placed.filled
    if both.sum() < 2:
        raise InputError("reference: expected voxels in common with the placed frames, received none")
    ours, theirs = placed.values[both], reference[both].astype(np.float64)
    difference = np.abs(ours - theirs)
    return Agreement(
        reference_covered=float(both.sum() / present.sum()),
        correlation=float(np.corrcoef(ours, theirs)[0, 1]),
        difference_mean=float(difference.mean()),
        same_share=float((difference <= 1).mean()),
    )


def _flat(index: np.ndarray, size: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of the voxels (x, y, z) that lie in the volume, and which those are."""
    inside = np.asarray(((index >= 0) & (index < np.array(size))).all(axis=1))
    x, y, z = index[inside].T
    return (z * size[1] + y) * size[0] + x, inside
