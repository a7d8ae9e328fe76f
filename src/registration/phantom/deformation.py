"""How tissue moves between the CT and a frame: a smooth bend of the body, and the push of the probe.

A material point X of the CT lies at ``X + u(X)`` at the time of the sweep (ct frame, mm); under the probe it is pushed
once more, by an amount that belongs to the frame. Both are closed formulas, so truth is exact at any point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.phantom.scatterers import Slab

INVERSE_STEPS = 8
# How far the tissue reaches around the vessel whose rigid motion is taken out of a bend.
BODY_MM = 15.0


@runtime_checkable
class Displacement(Protocol):
    """Field that takes material points to where they lie at the time of the sweep, both in the bed frame."""

    def __call__(self, points_mm: Float[np.ndarray, "n 3"], /) -> Float[np.ndarray, "n 3"]:
        """Compute the displaced points in mm, shape (n, 3), in the precision of the input."""
        ...


@dataclass(frozen=True)
class Bend:
    """Sum of Gaussian bumps, followed by a rigid motion that removes its rigid part.

    Parameters
    ----------
    centres_mm : ndarray, shape (k, 3)
        Centres of the bumps in the bed frame in mm.
    weights_mm : ndarray, shape (k, 3)
        Displacement at each centre in mm.
    length_mm : float
        Standard deviation of the bumps in mm.
    still_T_bent : ndarray, shape (4, 4)
        Rigid transform that brings the bent vessel back over itself.
    """

    centres_mm: Float64[np.ndarray, "k 3"]
    weights_mm: Float64[np.ndarray, "k 3"]
    length_mm: float
    still_T_bent: Float64[np.ndarray, "4 4"]

    def __call__(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where material points lie at the time of the sweep.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the bed frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in mm, in the precision of the input.
        """
        kind = points_mm.dtype
        # |p - c|^2 is spread out into products of matrices, which are far faster than a loop over the bumps; counted
        # from the middle of the bumps and in their length, so that single precision loses nothing that matters.
        middle_mm = self.centres_mm.mean(axis=0)
        centres = ((self.centres_mm - middle_mm) / self.length_mm).astype(kind)
        points = (points_mm - middle_mm.astype(kind)) * kind.type(1.0 / self.length_mm)
        x, y, z = points.T
        exponent = points @ centres.T
        exponent -= kind.type(0.5) * (x * x + y * y + z * z)[:, None]
        exponent -= kind.type(0.5) * (centres * centres).sum(axis=1)
        # Far from a bump the exponential of a single would be a denormal number, which is many times slower.
        bumps = np.exp(np.maximum(exponent, kind.type(-80.0), out=exponent), out=exponent)
        bent = points_mm + bumps @ self.weights_mm.astype(kind)
        rigid = self.still_T_bent.astype(kind)
        return np.asarray(bent @ rigid[:3, :3].T + rigid[:3, 3])


def draw_bend(
    guide_mm: Float64[np.ndarray, "g 3"], most_mm: float, length_mm: float, rng: np.random.Generator
) -> Bend | None:
    """Draw a random bend.

    Parameters
    ----------
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.
    most_mm : float
        Largest displacement of these points in mm.
    length_mm : float
        Length over which the field varies in mm.
    rng : numpy.random.Generator
        Random stream of the bend.

    Returns
    -------
    Bend or None
        The bend; None for a displacement of 0.
    """
    if most_mm == 0:
        return None
    chosen = np.linspace(0, len(guide_mm) - 1, 5).round().astype(int)
    centres_mm = guide_mm[chosen] + rng.normal(0.0, 8.0, (5, 3))
    direction = rng.standard_normal((5, 3)) * [1.0, 0.7, 0.5]

    # A line alone leaves its roll open; with the tissue around it, the rigid part is that of the whole body.
    aside_mm = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * BODY_MM
    body_mm = (guide_mm[:, None] + aside_mm).reshape(-1, 3)

    def scaled(size_mm: float) -> Bend:
        raw = Bend(centres_mm, size_mm * direction, length_mm, np.eye(4))
        return Bend(centres_mm, size_mm * direction, length_mm, _rigid_part(raw(body_mm), body_mm))

    # The rigid part is not linear in the size, but nearly so: a few corrections meet the maximum.
    size_mm = most_mm
    for _ in range(6):
        largest_mm = np.linalg.norm(scaled(size_mm)(guide_mm) - guide_mm, axis=1).max()
        size_mm *= most_mm / largest_mm
    return scaled(size_mm)


@dataclass(frozen=True)
class Press:
    """Push of the probe in one frame, in image coordinates (lateral, depth, elevation).

    Parameters
    ----------
    depth_mm : float
        Displacement of the skin under the probe in mm.
    fade_mm : float
        Decay length in mm: deeper tissue follows less.
    half_width_mm : float
        Half the width of the probe's face in mm.
    squeeze : float
        Share by which tissue around ``centre_mm`` is flattened; it moves sideways instead.
    centre_mm : tuple[float, float]
        Lateral and depth coordinate of the flattened region's centre in mm.
    reach_mm : float
        Radius of that region in mm.
    """

    depth_mm: float
    fade_mm: float
    half_width_mm: float
    squeeze: float
    centre_mm: tuple[float, float]
    reach_mm: float

    def __call__(self, local_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where points lie when pressed.

        Parameters
        ----------
        local_mm : ndarray, shape (n, 3)
            Image coordinates in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Image coordinates in mm under pressure, in the precision of the input.
        """
        kind = local_mm.dtype.type
        pressed = local_mm.copy()
        below = np.maximum(local_mm[:, 1] + kind(self.depth_mm), kind(0.0))
        outside = (local_mm[:, 0] / kind(1.3 * self.half_width_mm)) ** 2
        along = (local_mm[:, 2] / kind(15.0)) ** 2
        pressed[:, 1] += kind(self.depth_mm) * np.exp(
            -below / kind(self.fade_mm) - outside**2 - kind(0.5) * along
        )
        if self.squeeze > 0:
            aside = local_mm[:, 0] - kind(self.centre_mm[0])
            deeper = local_mm[:, 1] - kind(self.centre_mm[1])
            near = np.exp((aside**2 + deeper**2) * kind(-0.5 / self.reach_mm**2) - kind(0.5) * along)
            pressed[:, 1] -= kind(self.squeeze) * near * deeper
            pressed[:, 0] += kind(self.squeeze) * near * aside
        return pressed


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
        bent = self.bend(points_mm) if self.bend else points_mm
        return self.pressed(bent)

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
            self.tissue_T_image, _undo(self.press, local_mm) if self.press else local_mm
        )
        return _undo(self.bend, points_mm) if self.bend else points_mm

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
        tissue_T_block = _rigid_part(local_mm, material_mm)
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


def _undo(forward: Displacement | Press, moved: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    points = moved.copy()
    for _ in range(INVERSE_STEPS):
        points += moved - forward(points)
    return points


def _rigid_part(
    moving_mm: Float64[np.ndarray, "n 3"], fixed_mm: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "4 4"]:
    """The rigid transform that brings one set of points best over the other (Kabsch, Acta Cryst. A32, 1976)."""
    middle, target = moving_mm.mean(axis=0), fixed_mm.mean(axis=0)
    rotation, _ = Rotation.align_vectors(fixed_mm - target, moving_mm - middle)
    return transforms.from_rotation(rotation, target - rotation.apply(middle))
