"""Controlled perturbations of a registration problem whose answer is known.

Axis uniform on the sphere, angle uniform up to a maximum, about the cloud's centroid; direction uniform, length
uniform up to a maximum. Moving and fixed clouds are drawn independently, each with noise of its own. The moving cloud
comes in frames, slabs across the vessel, of which some may be missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import frames
from registration.along_vessel import AlongVessel
from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError
from registration.geometry import Mesh
from registration.metrics import Surface
from registration.missing_frames import ALTERNATING, loss_of, seen
from registration.perturbed_pose import ANY, ROTATIONS, PoseRange

PLACES = ("middle", "start", "end")


@dataclass(frozen=True)
class Piece:
    """The part of a vessel that the moving cloud covers: a ``share`` of its extent along the principal axis.

    ``place`` is ``middle``, ``start`` (where the axis begins) or ``end``; the axis points where its largest component
    is positive.
    """

    share: float = 1.0
    place: str = "middle"

    def __post_init__(self) -> None:
        require_positive("share", self.share, 1.0)
        if self.place not in PLACES:
            raise InputError(f"place: expected one of {', '.join(PLACES)}, received {self.place!r}")

    def contains(self, points_mm: Float64[np.ndarray, "n 3"], surface: Surface) -> Bool[np.ndarray, "n"]:
        """Which points lie in this piece of ``surface``."""
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

    ``outlier`` (m,) marks the moving points that belong to no surface, ``frame`` (m,) is the frame that each moving
    point was seen in, and ``loss`` how missing frames were chosen.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    fixed_mm: Float64[np.ndarray, "n 3"]
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    angle_deg: float
    translation_mm: float
    outlier: Bool[np.ndarray, "m"]
    frame: Int64[np.ndarray, "m"]
    loss: str


@dataclass(frozen=True)
class Perturbation:
    """How a problem is disturbed: rotation and translation, noise, outliers, lost frames, and points on each side.

    For ``rotation``, ``angle_bin_deg`` and the translation see ``PoseRange``. ``noise_mm`` is the standard deviation
    per coordinate, on both clouds. ``outlier_share`` of the moving points is replaced by points uniform in the moving
    cloud's bounding box grown by half its size on every side. The vessel's length holds ``sweep_frames`` frames;
    ``missing_share`` of those that the moving cloud has are lost, ``missing`` one by one (``scattered``), in one run
    (``contiguous``) or in turn (``alternating``), with all their points.
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
        for name, least in (("moving_points", 3), ("fixed_points", 3), ("sweep_frames", 1)):
            require_count(name, getattr(self, name), least)

    @property
    def poses(self) -> PoseRange:
        """Which poses are drawn."""
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
        """Draw the ``trial``-th problem of ``seed``, the same whatever was drawn before and whoever solves it.

        ``fixed_T_moving`` is the true pose before the perturbation (the identity if both are one surface). The pose,
        both clouds and the loss of frames have random streams of their own, so that the poses of a seed do not depend
        on overlap, noise, losses or number of points.
        """
        require_count("seed", seed, 0)
        require_count("trial", trial, 0)
        # Kinds of rotation do not share clouds: a method that any pose suits would only repeat itself.
        source = np.random.SeedSequence((seed, trial, ROTATIONS.index(self.rotation)))
        streams = [np.random.default_rng(child) for child in source.spawn(4)]
        along = AlongVessel.of(moving)
        pose = self.poses.draw(along.axis, trial, streams[0])
        drawn_mm = draw(moving, self.moving_points, piece, streams[1])
        frame = along.slab(drawn_mm, self.sweep_frames)
        fixed_mm = draw(fixed, self.fixed_points, Piece(), streams[2])
        loss = loss_of(self.missing, trial)
        kept = seen(frame, self.missing_share, loss, streams[3])
        moving_mm = self._disturb(drawn_mm, streams[1])[kept]
        fixed_mm = fixed_mm + self.noise_mm * streams[2].standard_normal(fixed_mm.shape)
        moved_T_moving = frames.compose(
            frames.translation(pose.shift_mm), frames.rotate_about(pose.turn, moving_mm.mean(axis=0))
        )
        return Trial(
            moving_mm=frames.apply(moved_T_moving, moving_mm),
            fixed_mm=fixed_mm,
            fixed_T_moving=frames.compose(fixed_T_moving, frames.invert_rigid(moved_T_moving)),
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
    """Points of a piece of a surface in random order.

    From a mesh ``count`` points, uniform by area; from a cloud a random choice of at most ``count`` of its own.
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
