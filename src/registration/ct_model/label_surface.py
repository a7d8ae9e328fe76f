"""The surface of a vessel below the size of its voxels, from the voxels that lie inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.ndimage import label as label_pieces

from registration import transforms
from registration.brief import brief_repr
from registration.checks import require_positive
from registration.ct_model.vessel_mask import VesselMask
from registration.errors import InputError
from registration.geometry.hollow import Lumen, find_lumen
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.mesh_topology import largest_piece
from registration.geometry.shapes import Mesh
from registration.reconstruction.open_ends import clip

# How well the surface's volume has to meet that of the voxels, and how many times its level is corrected for it.
VOLUME_TOLERANCE = 1e-3
MAX_CORRECTIONS = 4
# The field extends so many smoothing widths around the vessel.
MARGIN_WIDTHS = 4.0


@dataclass(frozen=True)
class LabelledSurface:
    """The surface of a label in mm in LPS, wound outwards, in one piece.

    Parameters
    ----------
    mesh : Mesh
        Surface; of the lumen where the label is the wall of a hollow body.
    lost_mm : float
        How far the farthest voxel of the label lies from what the surface encloses: below two voxels where
        only steps were smoothed, a branch's length where a branch was too thin for its voxels.
    lumen : Lumen, optional
        How the lumen of a hollow body was found; None for other labels.
    """

    mesh: Mesh
    lost_mm: float
    lumen: Lumen | None = None

    __repr__ = brief_repr


@dataclass(frozen=True)
class LabelSurface:
    """A smoothed field of signed distances, cut where it encloses the volume of the voxels.

    A label is a staircase: its steps are as high as voxels are, which for a CT differs by axis, and lie
    obliquely to the vessel. The distances to it are in mm, so the smoothing is the same in every direction. A
    Gaussian G would shrink what is curved, thin branches most; 2G - G*G does so far less, because it leaves
    quadratic functions as they are. The surface is the level whose volume is that of the voxels (counting
    voxels has no bias). Where the vessel reaches the border of the volume the surface is cut there and stays
    open.

    Parameters
    ----------
    smoothing_voxels : float, optional
        Width of the Gaussian, as a multiple of the side of a cube of a voxel's volume.

    Notes
    -----
    Measured on tubes of radius 2 and 8 mm in one label, oblique to the voxels, as bias / mean distance from
    the truth in mm on the thin one: voxels of 0.7 mm -0.015 / 0.049 (one Gaussian -0.113 / 0.113; a Gaussian
    on the label itself, cut at one half, loses 9.5 % of the volume at radius 2.5 mm), voxels of 0.5 x 0.6 x
    1.5 mm -0.049 / 0.082.

    References
    ----------
    T. Lewiner et al., J. Graph. Tools 8(2), 2003 (marching cubes).
    """

    smoothing_voxels: float = 1.0

    def __post_init__(self) -> None:
        require_positive("smoothing_voxels", self.smoothing_voxels, 5.0)

    def __call__(self, mask: VesselMask) -> LabelledSurface:
        """Make the surface around the voxels of a vessel.

        Parameters
        ----------
        mask : VesselMask
            Voxels of one vessel.

        Returns
        -------
        LabelledSurface
            Surface in mm in LPS.

        Raises
        ------
        InputError
            If the label is too small to have a surface, or the lumen of a hollow body is ambiguous.
        """
        spacing_mm = mask.spacing_mm
        width_mm = self.smoothing_voxels * float(np.prod(spacing_mm) ** (1 / 3))
        margin = np.ceil(MARGIN_WIDTHS * width_mm / spacing_mm).astype(int) + 1
        field_mm = _field_mm(_extended(mask, margin), spacing_mm, width_mm)
        voxels = int(mask.inside.sum())
        own = field_mm[
            tuple(slice(low, low + size) for low, size in zip(margin, mask.inside.shape, strict=True))
        ]
        # A first guess: as many voxels below it as are inside.
        level_mm = float(np.partition(own, voxels, axis=None)[voxels]) if voxels < own.size else 0.0
        for _ in range(MAX_CORRECTIONS):
            mesh = _at_level(field_mm, level_mm, margin, mask)
            missing_mm3 = mask.volume_mm3 - enclosed_volume_mm3(mesh)
            if abs(missing_mm3) <= VOLUME_TOLERANCE * mask.volume_mm3:
                break
            level_mm += missing_mm3 / float(mesh.areas_mm2.sum())
        lumen = find_lumen(mesh)
        surface = largest_piece(mesh) if lumen is None else lumen.mesh
        return LabelledSurface(surface, _lost_mm(own <= level_mm, mask), lumen)


def _extended(mask: VesselMask, margin: np.ndarray) -> np.ndarray:
    """The mask with a margin around it; where the scan cut the vessel off, it is continued as it was."""
    inside = mask.inside
    for axis in range(3):
        for side in range(2):
            widths = [(0, 0)] * 3
            widths[axis] = (int(margin[axis]), 0) if side == 0 else (0, int(margin[axis]))
            inside = np.pad(inside, widths, mode="edge" if mask.cut[axis, side] else "constant")
    return inside


def _field_mm(inside: np.ndarray, spacing_mm: np.ndarray, width_mm: float) -> Float32[np.ndarray, "i j k"]:
    """Smoothed signed distance to the staircase, negative inside."""
    # Distances are between centres of voxels; the wall is half a voxel nearer.
    half_mm = 0.5 * float(spacing_mm.min())
    deep_mm = distance_transform_edt(inside, sampling=spacing_mm)
    away_mm = distance_transform_edt(~inside, sampling=spacing_mm)
    distance_mm = np.where(inside, half_mm - deep_mm, away_mm - half_mm).astype(np.float32)
    once_mm = gaussian_filter(distance_mm, width_mm / spacing_mm, mode="nearest")
    twice_mm = gaussian_filter(once_mm, width_mm / spacing_mm, mode="nearest")
    return np.asarray(2 * once_mm - twice_mm)


def _lost_mm(below: np.ndarray, mask: VesselMask) -> float:
    pieces, count = label_pieces(below)
    if not count:
        raise InputError(
            f"label: expected a vessel several voxels wide, received one that no voxel of {mask.label} fits"
        )
    kept = pieces == 1 + int(np.bincount(pieces.reshape(-1))[1:].argmax())
    lost = mask.inside & ~kept
    return float(distance_transform_edt(~kept, sampling=mask.spacing_mm)[lost].max(initial=0.0))


def _at_level(field_mm: np.ndarray, level_mm: float, margin: np.ndarray, mask: VesselMask) -> Mesh:
    from skimage.measure import marching_cubes

    if not field_mm.min() < level_mm < field_mm.max():
        raise InputError(
            f"label: expected a vessel several voxels wide, received {int(mask.inside.sum())} voxels of label "
            f"{mask.label} that no surface fits"
        )
    corners, triangles, _, _ = marching_cubes(field_mm, level_mm, gradient_direction="descent")
    index = corners.astype(np.float64) - margin
    if np.linalg.det(mask.ct_A_voxel[:3, :3]) < 0:
        # A left-handed grid turns every triangle over.
        triangles = triangles[:, ::-1]
    mesh = Mesh(transforms.apply(mask.ct_A_voxel, index), np.ascontiguousarray(triangles, dtype=np.int64))
    if not mask.cut.any():
        return mesh
    # How far each corner lies past the outer face of the last voxels, on the sides where the scan ends.
    past = np.stack([-0.5 - index, index - (np.array(mask.inside.shape) - 0.5)], axis=-1)
    return clip(mesh, np.where(mask.cut, past, -np.inf).max(axis=(1, 2)))
