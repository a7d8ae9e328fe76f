"""Controlled perturbations of a registration problem whose result is known.

The moving surface is placed at its true pose first, in the fixed frame, and perturbed there: angle and translation
are the offset from the truth. Axis uniform on the sphere, angle uniform up to a maximum, about the cloud's centroid;
direction uniform, length uniform up to a maximum. Moving and fixed clouds are drawn independently, each with noise of
its own. The moving cloud comes in frames, slabs across the vessel, of which some may be missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import transforms
from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError
from registration.geometry.shapes import Mesh, Surface, transformed
from registration.geometry.vessel_axis import AlongVessel
from registration.perturbation.frame_dropout import ALTERNATING, in_kept_frames, loss_of
from registration.perturbation.random_pose import ANY, ROTATIONS, PoseRange

PLACES = ("middle", "start", "end")


@dataclass(frozen=True)
class Piece:
    """Part of a vessel that the moving cloud covers, along the principal axis.

    The axis points where its largest component is positive.

    Parameters
    ----------
    share : float, optional
        Share of the vessel's extent, above 0 to 1.
    place : {"middle", "start", "end"}, optional
        Where the part lies along the axis.

    Raises
    ------
    InputError
        If the share is out of range or the place is unknown.
    """

    share: float = 1.0
    place: str = "middle"

    def __post_init__(self) -> None:
        require_positive("share", self.share, 1.0)
        if self.place not in PLACES:
            raise InputError(f"place: expected one of {', '.join(PLACES)}, received {self.place!r}")

    def contains(self, points_mm: Float64[np.ndarray, "n 3"], surface: Surface) -> Bool[np.ndarray, " n"]:
        """Select the points that lie in this piece of a surface.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.
        surface : Surface
            Surface that the piece is part of.

        Returns
        -------
        ndarray of bool, shape (n,)
            True for points of the piece.
        """
        if self.share == 1.0:
            return np.ones(len(points_mm), dtype=bool)
        along = AlongVessel.of(surface)
        length_mm = self.share * along.length_mm
        offset = {"start": 0.0, "middle": 0.5, "end": 1.0}[self.place]
        begin_mm = along.first_mm + offset * (along.length_mm - length_mm)
        position_mm = along.position_mm(points_mm)
        return (position_mm >= begin_mm) & (position_mm <= begin_mm + length_mm)


@dataclass(frozen=True)
class Trial:
    """One perturbed problem: both clouds, the pose that undoes the perturbation, and how large it was.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points after the perturbation in mm.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    fixed_T_moving : ndarray, shape (4, 4)
        True pose of ``moving_mm``, the inverse of the perturbation.
    angle_deg, translation_mm : float
        Rotation about the moving cloud's centroid in degrees, and translation of that centroid in mm, from the
        true pose.
    outlier : ndarray of bool, shape (m,)
        Moving points that are outliers and belong to no surface.
    frame : ndarray of int, shape (m,)
        Frame that each moving point was seen in.
    loss : {"scattered", "contiguous"}
        How missing frames were chosen.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    fixed_mm: Float64[np.ndarray, "n 3"]
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    angle_deg: float
    translation_mm: float
    outlier: Bool[np.ndarray, " m"]
    frame: Int64[np.ndarray, " m"]
    loss: str


@dataclass(frozen=True)
class Perturbation:
    """Distribution of perturbed problems: pose, noise, outliers, lost frames, and number of points.

    Parameters
    ----------
    angle_max_deg : float
        Largest rotation in degrees, at most 180.
    translation_max_mm : float
        Largest translation in mm.
    noise_mm : float
        Standard deviation of the noise per coordinate on both clouds in mm.
    outlier_share : float
        Share of the moving points, below 1, that is replaced by points uniform in the moving cloud's bounding
        box grown by half its size on every side.
    moving_points, fixed_points : int
        Number of points of each cloud, at least 3.
    translation_min_mm : float, optional
        Smallest translation in mm.
    rotation : {"any", "roll", "flip"}, optional
        Kind of rotation; see ``PoseRange``.
    angle_bin_deg : float or None, optional
        Width of the bins of angles in degrees; None for a single bin. See ``PoseRange``.
    missing_share : float, optional
        Share of the moving cloud's frames, below 1, that is lost with all their points.
    missing : {"scattered", "contiguous", "alternating"}, optional
        Whether frames are lost one by one, in one run, or in turn.
    sweep_frames : int, optional
        Number of frames along the vessel's length.

    Raises
    ------
    InputError
        If a value is out of range or a kind is unknown.
    """

    angle_max_deg: float
    translation_max_mm: float
    noise_mm: float
    outlier_share: float
    moving_points: int
    fixed_points: int
    translation_min_mm: float = 0.0
    rotation: str = ANY
    angle_bin_deg: float | None = None
    missing_share: float = 0.0
    missing: str = ALTERNATING
    sweep_frames: int = 100

    def __post_init__(self) -> None:
        _ = self.poses
        require_at_least("noise_mm", self.noise_mm, 0.0)
        for name in ("outlier_share", "missing_share"):
            require_at_least(name, getattr(self, name), 0.0)
            if getattr(self, name) >= 1:
                raise InputError(f"{name}: expected below 1, received {getattr(self, name):g}")
        loss_of(self.missing, 0)
        for name, minimum in (("moving_points", 3), ("fixed_points", 3), ("sweep_frames", 1)):
            require_count(name, getattr(self, name), minimum)

    @property
    def poses(self) -> PoseRange:
        """Range of poses that are drawn."""
        return PoseRange(
            self.angle_max_deg,
            self.translation_max_mm,
            self.translation_min_mm,
            self.rotation,
            self.angle_bin_deg,
        )

    def __call__(
        self,
        moving: Surface,
        fixed: Surface,
        fixed_T_moving: Float64[np.ndarray, "4 4"],
        piece: Piece,
        *,
        seed: int,
        trial: int,
    ) -> Trial:
        """Draw one problem, the same whatever was drawn before and whichever method solves it.

        Piece, frames, roll and flip follow the principal axis of the moving surface at its true pose. The pose,
        both clouds and the loss of frames have random streams of their own, so that the poses of a seed do not
        depend on overlap, noise, losses or number of points.

        Parameters
        ----------
        moving : Surface
            Surface that the moving cloud is drawn from, in a coordinate frame of its own.
        fixed : Surface
            Surface that the fixed cloud is drawn from.
        fixed_T_moving : ndarray, shape (4, 4)
            True pose of ``moving``; the identity if both are one surface.
        piece : Piece
            Part of the vessel that the moving cloud covers.
        seed : int
            Seed of the problems.
        trial : int
            Number of the problem, from 0.

        Returns
        -------
        Trial
            The perturbed problem.

        Raises
        ------
        InputError
            If the seed or the number is negative, or the piece has no surface to sample.
        """
        require_count("seed", seed, 0)
        require_count("trial", trial, 0)
        # Kinds of rotation do not share clouds: a method that any pose suits would only repeat itself.
        source = np.random.SeedSequence((seed, trial, ROTATIONS.index(self.rotation)))
        streams = [np.random.default_rng(child) for child in source.spawn(4)]
        placed = transformed(moving, fixed_T_moving)
        along = AlongVessel.of(placed)
        pose = self.poses.draw(along.axis, trial, streams[0])
        drawn_mm = draw(placed, self.moving_points, piece, streams[1])
        frame = along.slab(drawn_mm, self.sweep_frames)
        fixed_mm = draw(fixed, self.fixed_points, Piece(), streams[2])
        loss = loss_of(self.missing, trial)
        kept = in_kept_frames(frame, self.missing_share, loss, streams[3])
        true_mm = self._disturb(drawn_mm, streams[1])[kept]
        fixed_mm = fixed_mm + self.noise_mm * streams[2].standard_normal(fixed_mm.shape)
        moved_T_fixed = transforms.compose(
            transforms.translation(pose.shift_mm),
            transforms.rotate_about(pose.rotation, true_mm.mean(axis=0)),
        )
        return Trial(
            moving_mm=transforms.apply(moved_T_fixed, true_mm),
            fixed_mm=fixed_mm,
            fixed_T_moving=transforms.invert_rigid(moved_T_fixed),
            angle_deg=pose.angle_deg,
            translation_mm=pose.translation_mm,
            outlier=(np.arange(len(drawn_mm)) < self._outliers(len(drawn_mm)))[kept],
            frame=frame[kept],
            loss=loss,
        )

    def _outliers(self, count: int) -> int:
        return round(self.outlier_share * count)

    def _disturb(self, points_mm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        noisy_mm = points_mm + self.noise_mm * rng.standard_normal(points_mm.shape)
        count = self._outliers(len(points_mm))
        low_mm, high_mm = points_mm.min(axis=0), points_mm.max(axis=0)
        grown_mm = 0.5 * (high_mm - low_mm)
        # The points are in random order already, so the first ones are as good as any.
        noisy_mm[:count] = rng.uniform(low_mm - grown_mm, high_mm + grown_mm, size=(count, 3))
        return noisy_mm


def draw(surface: Surface, count: int, piece: Piece, rng: np.random.Generator) -> Float64[np.ndarray, "k 3"]:
    """Draw points of a piece of a surface in random order.

    Parameters
    ----------
    surface : Surface
        A mesh is sampled uniformly by area; of a cloud the points themselves are chosen at random.
    count : int
        Number of points; a cloud may give fewer.
    piece : Piece
        Part of the surface.
    rng : numpy.random.Generator
        Random stream of the draw.

    Returns
    -------
    ndarray, shape (k, 3)
        Points in mm.

    Raises
    ------
    InputError
        If the piece of a mesh has no surface to sample.
    """
    if not isinstance(surface, Mesh):
        inside_mm = surface[piece.contains(surface, surface)]
        return rng.permutation(inside_mm, axis=0)[:count]
    drawn: list[np.ndarray] = []
    missing = count
    for _ in range(1000):
        points_mm = surface.sample(max(2 * missing, 100), rng)
        drawn.append(points_mm[piece.contains(points_mm, surface)][:missing])
        missing -= len(drawn[-1])
        if not missing:
            return np.concatenate(drawn)
    raise InputError(
        f"piece: expected a piece with surface to sample, received {piece.place} {piece.share:g} with none"
    )
