"""Whether a second pose explains a case as well as the true one, so that a result is rightly called ambiguous.

The search uses the truth and not the method under test: the vessel, in its true place, is slid along its axis, rolled
about it and flipped, and the candidates of the method are tried as well. From each start the residual to the
triangles is minimised with the displaced direction held, and once more with all directions free.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh, principal_frame
from registration.metrics.surface_distance import pose_error

# A pose is a second one if it takes the targets, or the model's surface, elsewhere by more than this.
ELSEWHERE_MM = 2.0
# Worse than the true pose by fewer standard errors than this, it is worse by chance in one case of twenty.
WITHIN_NOISE = 1.645
SLIDES_MM = (2.5, 4.0, 6.0, 10.0, 15.0, 20.0, 30.0)
ROLLS_DEG = (20.0, 45.0, 90.0, 135.0, 180.0)
# The frames are taken together in so many stretches: neighbours err alike.
STRETCHES = 20
# Points used; residuals beyond so many robust deviations of the true pose's do not count more.
POINTS, STEPS, CAP = 1500, 12, 4.0
# Of exact points every distance is rounding.
LEAST_CAP_MM = 1e-3
# Where a surface lies is told by so many of its points.
PLACES = 300


@dataclass(frozen=True)
class SecondPose:
    """Pose elsewhere that explains a case best.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        The pose.
    gap : float
        Number of standard errors by which it is worse than the true pose, over stretches of the sweep.
    tre_mm : float
        Displacement of the targets in mm, root mean square.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    gap: float
    tre_mm: float

    @property
    def hidden(self) -> bool:
        """Whether the two poses cannot be told apart: the gap is within the noise."""
        return bool(self.gap < WITHIN_NOISE)


def second_pose(
    case: BenchmarkCase, truth: CaseTruth, candidates: Iterable[Float64[np.ndarray, "4 4"]] = ()
) -> SecondPose | None:
    """Search for the best pose that is not the true one.

    Parameters
    ----------
    case : BenchmarkCase
        Case.
    truth : CaseTruth
        Its truth.
    candidates : iterable of ndarray, shape (4, 4), optional
        Poses (fixed_T_moving) of the method under test, tried as starts.

    Returns
    -------
    SecondPose or None
        The second pose; None where no search ends elsewhere.
    """
    search = _Search(case, truth)
    right = search.refined(truth.fixed_T_moving, None)
    right_cost = search.costs(right)
    best: SecondPose | None = None
    places_mm = case.fixed_mm[:PLACES]
    for pose, held in (*search.starts(right), *((one, None) for one in candidates)):
        ends = [
            search.refined(pose, direction) for direction in ((held, None) if held is not None else (None,))
        ]
        for end in ends:
            apart_mm = pose_error(end, truth.fixed_T_moving, places_mm).tre_mm
            if apart_mm <= ELSEWHERE_MM:
                continue
            gap = search.gap(search.costs(end), right_cost)
            if best is None or gap < best.gap:
                best = SecondPose(end, gap, pose_error(end, truth.fixed_T_moving, truth.targets_mm).tre_mm)
    return best


class _Search:
    """One case, prepared: its genuine points in stretches, and the model to ask for closest points and normals."""

    def __init__(self, case: BenchmarkCase, truth: CaseTruth) -> None:
        genuine = np.flatnonzero(~truth.outlier)
        chosen = genuine[np.linspace(0, len(genuine) - 1, min(POINTS, len(genuine))).astype(int)]
        self.moving_mm = case.moving_mm[chosen]
        rank = np.argsort(np.argsort(case.moving_frame[chosen], kind="stable"), kind="stable")
        self.stretch = rank * STRETCHES // len(chosen)
        self.model = _Model(case.fixed)
        found = self.model(transforms.apply(truth.fixed_T_moving, self.moving_mm))
        self.cap_mm = max(CAP * 1.4826 * float(np.median(found.apart_mm)), LEAST_CAP_MM)

    def costs(self, pose: np.ndarray) -> Float64[np.ndarray, " s"]:
        """The mean squared residual of each stretch, with an upper limit to what a point may count."""
        apart_mm = self.model(transforms.apply(pose, self.moving_mm)).apart_mm
        squared = np.minimum(apart_mm, self.cap_mm) ** 2
        return np.bincount(self.stretch, squared, STRETCHES) / np.bincount(self.stretch, minlength=STRETCHES)

    def gap(self, costs: np.ndarray, right: np.ndarray) -> float:
        """How much worse ``costs`` are on average, in standard errors."""
        worse = costs - right
        error = float(worse.std(ddof=1)) / np.sqrt(len(worse))
        return float(worse.mean()) / error if error > 0 else float(np.sign(worse.mean())) * np.inf

    def starts(self, right: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
        """Displaced poses, each with the direction of its displacement: a turn and a shift about the cloud's centre."""
        moved_mm = transforms.apply(right, self.moving_mm)
        frame = principal_frame(moved_mm)
        axis, across = frame.axes[:, 0], frame.axes[:, 1:].T
        slide, roll = np.concatenate([np.zeros(3), axis]), np.concatenate([axis, np.zeros(3)])
        for size_mm in SLIDES_MM:
            for way in (1.0, -1.0):
                yield transforms.translation(way * size_mm * axis) @ right, slide
        turns = [(angle, way) for angle in ROLLS_DEG for way in (1.0, -1.0)]
        for angle, way in turns:
            turn = Rotation.from_rotvec(np.deg2rad(way * angle) * axis)
            yield transforms.rotate_about(turn, frame.centre_mm) @ right, roll
        for direction in (
            *across,
            (across[0] + across[1]) / np.sqrt(2),
            (across[0] - across[1]) / np.sqrt(2),
        ):
            flip = Rotation.from_rotvec(np.pi * direction)
            yield transforms.rotate_about(flip, frame.centre_mm) @ right, None

    def refined(self, pose: np.ndarray, held: np.ndarray | None) -> np.ndarray:
        """Point-to-plane steps (Chen and Medioni, Image Vision Comput. 10(3), 1992), none along ``held``."""
        for _ in range(STEPS):
            moved_mm = transforms.apply(pose, self.moving_mm)
            found = self.model(moved_mm)
            centre_mm = moved_mm.mean(axis=0)
            rows = np.concatenate([np.cross(moved_mm - centre_mm, found.normals), found.normals], axis=1)
            weight = np.maximum(1 - (found.apart_mm / (2 * self.cap_mm)) ** 2, 0.0) ** 2
            if (weight > 0).sum() < len(weight) // 4:  # too far off for a robust weight: all points pull
                weight = np.ones(len(weight))
            free = np.eye(6) if held is None else np.linalg.svd(held[None])[2][1:].T
            root = np.sqrt(weight)[:, None]
            step = free @ np.linalg.lstsq(root * rows @ free, root[:, 0] * found.gap_mm, rcond=1e-6)[0]
            turn = Rotation.from_rotvec(step[:3])
            motion = transforms.from_rotation(turn, centre_mm + step[3:] - turn.apply(centre_mm))
            pose = motion @ pose
        return np.asarray(pose)


@dataclass(frozen=True)
class _Closest:
    """Distances to the model, signed gaps along its normals, and these."""

    apart_mm: np.ndarray
    gap_mm: np.ndarray
    normals: np.ndarray


class _Model:
    """Closest places on the triangles of a mesh, by Open3D's ray-casting scene."""

    def __init__(self, mesh: Mesh) -> None:
        self._scene = TriangleScene(mesh)

    def __call__(self, points_mm: np.ndarray) -> _Closest:
        found = self._scene.closest(points_mm)
        gap_mm = np.einsum("nk,nk->n", found.offsets_mm, found.normals)
        return _Closest(np.linalg.norm(found.offsets_mm, axis=1), gap_mm, found.normals)
