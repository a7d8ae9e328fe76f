"""How tissue moves between the CT and a frame: a smooth bend of the body, and the push of the probe.

A material point X of the CT lies at ``X + u(X)`` at the time of the sweep (ct frame, mm); under the probe it is pushed
once more, by an amount that belongs to the frame. Both are closed formulas, so truth is exact at any point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from registration import transforms
from registration.phantom.displacement import Displacement, Press, rigid_part, undone
from registration.phantom.scatterers import Slab

# Points that are mapped at a time.
BLOCK = 1 << 14


@dataclass(frozen=True)
class View:
    """Tissue as one frame shows it: pose of the image plane, bend, and push.

    Parameters
    ----------
    tissue_T_image : ndarray, shape (4, 4)
        Rigid transform of (lateral, depth, elevation) in mm to the bed frame, where tissue lies as bent.
    bend : Displacement or None, optional
        Bend of the body; None for none.
    press : Press or None, optional
        Push of the probe; None for none.
    """

    tissue_T_image: Float64[np.ndarray, "4 4"]
    bend: Displacement | None = None
    press: Press | None = None

    def to_image(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Map material points to image coordinates.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the bed frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Image coordinates in mm, in the precision of the input.
        """
        # A frame has some hundred thousand scatterers: what is computed between must stay in the processor's cache.
        local_mm = np.empty_like(points_mm, order="C")
        for begin in range(0, len(points_mm), BLOCK):
            own = slice(begin, begin + BLOCK)
            bent_mm = self.bend(points_mm[own]) if self.bend else points_mm[own]
            local_mm[own] = self.pressed(bent_mm)
        return local_mm

    def pressed(self, bent_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Map points whose bend is already applied to image coordinates.

        Parameters
        ----------
        bent_mm : ndarray, shape (n, 3)
            Bent points in the bed frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Image coordinates in mm, in the precision of the input.
        """
        kind = bent_mm.dtype
        local_mm = (bent_mm - self.tissue_T_image[:3, 3].astype(kind)) @ self.tissue_T_image[:3, :3].astype(
            kind
        )
        return self.press(local_mm) if self.press else local_mm

    def to_tissue(self, local_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Map image coordinates to material points: the inverse of ``to_image``, by fixed-point iteration.

        Parameters
        ----------
        local_mm : ndarray, shape (n, 3)
            Image coordinates (lateral, depth, elevation) in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Material points in the bed frame in mm.
        """
        points_mm = transforms.apply(
            self.tissue_T_image, undone(self.press, local_mm) if self.press else local_mm
        )
        return undone(self.bend, points_mm) if self.bend else points_mm

    def slab(self, low_mm: Float64[np.ndarray, "3"], high_mm: Float64[np.ndarray, "3"]) -> Slab:
        """Bound the material that is seen between two corners in image coordinates.

        Parameters
        ----------
        low_mm, high_mm : ndarray, shape (3,)
            Lower and upper corner (lateral, depth, elevation) in mm.

        Returns
        -------
        Slab
            Block of material that holds all of it.
        """
        if self.bend is None and self.press is None:
            return Slab(self.tissue_T_image, low_mm, high_mm)
        axes = [np.linspace(low_mm[axis], high_mm[axis], count) for axis, count in enumerate((7, 7, 3))]
        local_mm = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        material_mm = self.to_tissue(local_mm)
        # Turning the block with the tissue keeps it thin.
        tissue_T_block = rigid_part(local_mm, material_mm)
        within_mm = transforms.apply(transforms.invert_rigid(tissue_T_block), material_mm)
        return Slab(tissue_T_block, within_mm.min(axis=0) - 0.3, within_mm.max(axis=0) + 0.3)


@dataclass(frozen=True)
class SweepDeformation:
    """True deformation of one sweep: the bend, and the push of every frame.

    Points go in and come out in the ct frame, in mm.

    Parameters
    ----------
    views : tuple of View
        Pose, bend and push of every frame, in the bed frame.
    ct_T_bed : ndarray, shape (4, 4)
        Rigid transform from the bed to the ct frame.
    """

    views: tuple[View, ...]
    ct_T_bed: Float64[np.ndarray, "4 4"]

    def displaced(self, points_mm: Float64[np.ndarray, "n 3"], frame: int) -> Float64[np.ndarray, "n 3"]:
        """Compute where material points lie while a frame is taken.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the ct frame in mm.
        frame : int
            Index of the frame.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in the ct frame in mm.
        """
        view, bed_T_ct = self.views[frame], transforms.invert_rigid(self.ct_T_bed)
        local_mm = view.to_image(transforms.apply(bed_T_ct, points_mm))
        return transforms.apply(self.ct_T_bed @ view.tissue_T_image, local_mm)

    def as_swept(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Compute where material points lie when the image plane passes nearest to them.

        This is what a reconstruction shows.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the ct frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in the ct frame in mm.
        """
        material_mm = transforms.apply(transforms.invert_rigid(self.ct_T_bed), points_mm)
        away_mm = np.abs(np.stack([view.to_image(material_mm)[:, 2] for view in self.views]))
        nearest = away_mm.argmin(axis=0)
        shown_mm = np.empty_like(points_mm)
        for frame in np.unique(nearest):
            chosen = nearest == frame
            shown_mm[chosen] = self.displaced(points_mm[chosen], int(frame))
        return shown_mm

    def material(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Find the material points that a reconstruction shows at given points: the inverse of ``as_swept``.

        A point belongs to the frame whose plane is nearest.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Reconstructed points in the ct frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Material points in the ct frame in mm.
        """
        bed_mm = transforms.apply(transforms.invert_rigid(self.ct_T_bed), points_mm)
        poses = np.stack([view.tissue_T_image for view in self.views])
        away_mm = np.abs(bed_mm @ poses[:, :3, 2].T - np.einsum("fi,fi->f", poses[:, :3, 3], poses[:, :3, 2]))
        nearest = away_mm.argmin(axis=1)
        found_mm = np.empty_like(bed_mm)
        for frame in np.unique(nearest):
            chosen, view = nearest == frame, self.views[frame]
            local_mm = transforms.apply(transforms.invert_rigid(view.tissue_T_image), bed_mm[chosen])
            found_mm[chosen] = view.to_tissue(local_mm)
        return transforms.apply(self.ct_T_bed, found_mm)

    @cached_property
    def pressure_mm(self) -> Float64[np.ndarray, " n"]:
        """Depth in mm to which the probe presses in each frame."""
        return np.array([view.press.depth_mm if view.press else 0.0 for view in self.views])
