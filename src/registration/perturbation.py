"""Controlled perturbations of a registration problem whose answer is known.

Axis uniform on the sphere, angle uniform up to a maximum, about the cloud's centroid; direction uniform, length
uniform up to a maximum. Moving and fixed clouds are drawn independently, each with noise of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation

from registration import frames
from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError
from registration.geometry import Mesh, surface_frame
from registration.metrics import Surface

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
        frame = surface_frame(surface)
        whole_mm = surface.vertices_mm[np.unique(surface.triangles)] if isinstance(surface, Mesh) else surface
        along_mm = (whole_mm - frame.centre_mm) @ frame.axes[:, 0]
        first_mm, last_mm = float(along_mm.min()), float(along_mm.max())
        length_mm = self.share * (last_mm - first_mm)
        offset = {"start": 0.0, "middle": 0.5, "end": 1.0}[self.place]
        begin_mm = first_mm + offset * (last_mm - first_mm - length_mm)
        position_mm = (points_mm - frame.centre_mm) @ frame.axes[:, 0]
        return (position_mm >= begin_mm) & (position_mm <= begin_mm + length_mm)


@dataclass(frozen=True)
class Trial:
    """One perturbed problem: both clouds, the pose that undoes the perturbation, and how large it was.

    ``outlier`` (m,) marks the moving points that belong to no surface.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    fixed_mm: Float64[np.ndarray, "n 3"]
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    angle_deg: float
    translation_mm: float
    outlier: Bool[np.ndarray, "m"]


@dataclass(frozen=True)
class Perturbation:
    """How a problem is disturbed: largest rotation and translation, noise, outliers, and points on each side.

    ``noise_mm`` is the standard deviation per coordinate, on both clouds. ``outlier_share`` of the moving points is
    replaced by points uniform in the moving cloud's bounding box grown by half its size on every side.
    """

    angle_max_deg: float
    translation_max_mm: float
    noise_mm: float
    outlier_share: float
    moving_points: int
    fixed_points: int

    def __post_init__(self) -> None:
        require_at_least("angle_max_deg", self.angle_max_deg, 0.0)
        if self.angle_max_deg > 180:
            raise InputError(f"angle_max_deg: expected at most 180, received {self.angle_max_deg:g}")
        require_at_least("translation_max_mm", self.translation_max_mm, 0.0)
        require_at_least("noise_mm", self.noise_mm, 0.0)
        require_at_least("outlier_share", self.outlier_share, 0.0)
        if self.outlier_share >= 1:
            raise InputError(f"outlier_share: expected below 1, received {self.outlier_share:g}")
        require_count("moving_points", self.moving_points, 3)
        require_count("fixed_points", self.fixed_points, 3)

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
        the moving and the fixed cloud have random streams of their own, so that the poses of a seed do not depend on
        overlap, noise or number of points.
        """
        require_count("seed", seed, 0)
        require_count("trial", trial, 0)
        streams = [np.random.default_rng(child) for child in np.random.SeedSequence((seed, trial)).spawn(3)]
        turn, shift_mm = self._draw_pose(streams[0])
        moving_mm = draw(moving, self.moving_points, piece, streams[1])
        fixed_mm = draw(fixed, self.fixed_points, Piece(), streams[2])
        moving_mm = self._disturb(moving_mm, streams[1])
        fixed_mm = fixed_mm + self.noise_mm * streams[2].standard_normal(fixed_mm.shape)
        moved_T_moving = frames.compose(
            frames.translation(shift_mm), frames.rotate_about(turn, moving_mm.mean(axis=0))
        )
        return Trial(
            moving_mm=frames.apply(moved_T_moving, moving_mm),
            fixed_mm=fixed_mm,
            fixed_T_moving=frames.compose(fixed_T_moving, frames.invert_rigid(moved_T_moving)),
            angle_deg=float(np.rad2deg(turn.magnitude())),
            translation_mm=float(np.linalg.norm(shift_mm)),
            outlier=np.arange(len(moving_mm)) < self._outliers(len(moving_mm)),
        )

    def _draw_pose(self, rng: np.random.Generator) -> tuple[Rotation, Float64[np.ndarray, "3"]]:
        axis = _direction(rng)
        angle = np.deg2rad(rng.uniform(0.0, self.angle_max_deg))
        direction = _direction(rng)
        return Rotation.from_rotvec(angle * axis), rng.uniform(0.0, self.translation_max_mm) * direction

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


def _direction(rng: np.random.Generator) -> Float64[np.ndarray, "3"]:
    """Uniform on the sphere: a normal vector has no preferred direction."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)
