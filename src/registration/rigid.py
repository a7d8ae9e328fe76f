"""Symmetry-aware multi-start rigid registration of two clouds, coarse to fine, that knows when it doesn't know."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from registration.ambiguity import Judge
from registration.answer import answer, measured_candidate
from registration.checks import require_count, require_positive
from registration.correspondence import TreeTarget
from registration.errors import InputError
from registration.geometry import principal_frame
from registration.rejection import NormalRejection, Rejection
from registration.results import ACCEPTED, RigidResult, fit
from registration.rigid_input import frame_of_points, points_on_line, rigid_clouds
from registration.robust_kernels import RobustKernel, Tukey
from registration.search import EARLY_TOLERANCE, CoarseToFine, Stage, estimation_by
from registration.search_cone import USUAL_DEG, USUAL_MM, Bound, SearchCone, bound_around, known_pose
from registration.selection import Evidence, blocks_of, blocks_of_frames
from registration.smoothed_target import outward_targets
from registration.starts import centerline_starts, cone_starts, principal_axes, symmetry_starts
from registration.strays import LEAST_CLOUD, NEIGHBOUR, lonely, strays
from registration.turned_round import is_longer, turned_round

# The surface that poses are judged on is smoothed over so many times the points that a normal is estimated from.
SMOOTHING = 2
REFINEMENTS = ("plane", "symmetric", "point")
# The share of closest pairs that counts where it is not given and no kernel weighs them.
KEPT = 0.9


@dataclass(frozen=True)
class MultiStartICP:
    """ICP from every pose that the symmetry of a vessel allows; the one that explains the points best wins.

    Starts: principal axes laid on each other, rolled in ``rolls`` equal steps, inverted, and slid along the vessel in
    steps of ``slide_share`` of the moving cloud's length; an axis with ``axis_share`` of the longest one's spread
    counts as principal too, and where the second one has ``compact_share`` of it none is: all are tried; ``invert`` and
    ``slide`` can be left out. Where the centerlines of both clouds are given and ``use_centerline`` is true, ICP on
    these comes first and leaves only its ``centerline_places`` best places to be rolled; where the answer is then not
    accepted, the surfaces' own axes are tried too. All starts take ``first_iterations`` on ``first_points`` against a
    closest-point table of ``coarse_cells`` voxels, the best ``first_share`` of them ``coarse_iterations`` on
    ``coarse_points``; the best ``survivors`` of different basins go on with ``middle_points`` and exact closest points,
    at most ``finalists`` of those with up to ``fine_points``. A pose is in the basin of a better one if both move the
    cloud alike within ``basin_share`` of its radius. Of a fixed cloud with more than ``fixed_points`` so many are
    drawn: the nearest neighbours in a denser one are its noise and not its surface.

    ``refine_by`` is the residual of the last two stages: ``plane`` (along normals estimated from ``neighbours`` points:
    exact on sampled surfaces, whose points never coincide), ``symmetric`` (normals of both) or ``point`` (for clouds
    that are no surface). With ``wall_offset`` one wall may lie outside the other by the same distance everywhere, for
    the borders that two modalities show are not one: it is estimated with the pose and reported, and is no residual.
    Along normals the ``kernel`` weighs the pairs of the last two stages. The closest ``keep`` share of pairs counts in
    all stages and in the trimmed residual; None stands for 0.9, and for all pairs where the kernel weighs them.
    ``rejections`` can leave out more. ``cone_deg`` and ``cone_radius_mm`` bound the answer around a given initial pose,
    as far as a search cone does not. The ``judge`` decides whether the answer is accepted, from the candidates and from
    a bootstrap of ``replicates`` over ``blocks`` blocks of points, its spread enlarged by ``inflation``: this was set
    so that the predicted 90 % intervals hold on random anatomies with seeds below 1000. From point to point no error is
    predicted: closest points say too little about it. Where the moving cloud is the longer one, the fixed one is
    registered to it and the result turned round. Deterministic in ``seed``.

    Methods: T. Vantini, Politecnico di Milano, 2025, section 2.5 (starts and selection); see ``registration.icp``,
    ``registration.selection`` and ``registration.uncertainty``.

    >>> vessel_mm = np.random.default_rng(1).normal(size=(500, 3)) * [9.0, 3.0, 1.0]
    >>> bool(MultiStartICP()(vessel_mm + 5.0, vessel_mm).rmse_mm < 1e-6)
    True
    """

    rolls: int = 12
    slide_share: float = 0.25
    axis_share: float = 0.75
    compact_share: float = 0.5
    invert: bool = True
    slide: bool = True
    use_centerline: bool = True
    centerline_places: int = 16
    first_points: int = 150
    first_iterations: int = 6
    first_share: float = 0.34
    coarse_points: int = 300
    coarse_cells: int = 48
    coarse_iterations: int = 8
    survivors: int = 8
    middle_points: int = 600
    finalists: int = 3
    fine_points: int = 5000
    fixed_points: int = 10_000
    max_iterations: int = 50
    tolerance: float = 2e-4
    keep: float | None = None
    refine_by: str = "plane"
    neighbours: int = 20
    wall_offset: bool = True
    kernel: RobustKernel | None = field(default_factory=Tukey)
    rejections: Sequence[Rejection] = ()
    basin_share: float = 0.1
    cone_deg: float = USUAL_DEG
    cone_radius_mm: float = USUAL_MM
    inlier_spacings: float = 3.0
    blocks: int = 48
    replicates: int = 400
    inflation: float = 1.25
    judge: Judge = field(default_factory=Judge)
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("rolls", "centerline_places", "first_iterations", "coarse_iterations", "survivors"):
            require_count(name, getattr(self, name), 1)
        for name in ("finalists", "max_iterations"):
            require_count(name, getattr(self, name), 1)
        for name in (
            "first_points",
            "coarse_points",
            "middle_points",
            "fine_points",
            "fixed_points",
            "neighbours",
        ):
            require_count(name, getattr(self, name), 3)
        require_count("coarse_cells", self.coarse_cells, 8)
        require_count("blocks", self.blocks, 2)
        require_count("replicates", self.replicates, 20)
        require_count("seed", self.seed, 0)
        for name in ("slide_share", "axis_share", "compact_share", "first_share", "tolerance", "basin_share"):
            require_positive(name, getattr(self, name), 1.0)
        if self.keep is not None:
            require_positive("keep", self.keep, 1.0)
        require_positive("cone_deg", self.cone_deg, 180.0)
        require_positive("cone_radius_mm", self.cone_radius_mm)
        require_positive("inlier_spacings", self.inlier_spacings)
        require_positive("inflation", self.inflation)
        if self.refine_by not in REFINEMENTS:
            raise InputError(f"refine_by: expected {', '.join(REFINEMENTS)}, received {self.refine_by!r}")
        # A configuration file hands over a list.
        object.__setattr__(self, "rejections", tuple(self.rejections))

    def __call__(
        self,
        moving_mm: ArrayLike,
        fixed_mm: ArrayLike,
        initial: ArrayLike | None = None,
        *,
        search_cone: SearchCone | None = None,
        moving_centerline_mm: ArrayLike | None = None,
        fixed_centerline_mm: ArrayLike | None = None,
        moving_frame: ArrayLike | None = None,
    ) -> RigidResult:
        """Register ``moving_mm`` to ``fixed_mm`` from anywhere, or from near ``initial`` (a fixed_T_moving).

        Clouds and points on centerlines are arrays or lists of shape (n, 3) in mm, ``initial`` is (4, 4). No answer
        lies outside the bound around ``initial``: of ``search_cone``, else of ``cone_deg`` and ``cone_radius_mm``.
        Points on the clouds' centerlines, in their frames, shorten the search; ``moving_frame`` (m,) is the frame of
        the sweep that each moving point was seen in, which makes the bootstrap one over frames. Raises InputError for a
        cloud that is empty, of another shape, not finite, degenerate or in metres, an ``initial`` that is not rigid or
        that no start ends near, a cone without one, or frames that are not one a point.
        """
        begin_s = time.perf_counter()
        moving, fixed = rigid_clouds(moving_mm, fixed_mm)
        known = known_pose(initial, search_cone)
        frame = frame_of_points(moving_frame, len(moving))
        lines = (
            points_on_line(moving_centerline_mm, "moving_centerline_mm"),
            points_on_line(fixed_centerline_mm, "fixed_centerline_mm"),
        )
        if known is None and is_longer(moving, fixed):
            # The moving cloud would have to slide out of the fixed one: the shorter one moves instead.
            found_back = self(fixed, moving, moving_centerline_mm=lines[1], fixed_centerline_mm=lines[0])
            return self._turned_round(found_back, moving, fixed, begin_s)
        return self._registered(moving, fixed, known, search_cone, lines, frame, begin_s)

    def _registered(
        self,
        moving_mm: np.ndarray,
        fixed_mm: np.ndarray,
        initial: np.ndarray | None,
        search_cone: SearchCone | None,
        lines: tuple[np.ndarray | None, np.ndarray | None],
        moving_frame: np.ndarray | None,
        begin_s: float,
    ) -> RigidResult:
        bound = bound_around(initial, search_cone, moving_mm, self.cone_deg, self.cone_radius_mm)
        centerlines = None
        if lines[0] is not None and lines[1] is not None and self.use_centerline:
            centerlines = (lines[0], lines[1])
        evidence = self._evidence(moving_mm, fixed_mm, moving_frame)
        starts = self._starts(evidence, bound, centerlines)
        normals = None
        if self.refine_by == "symmetric" or any(
            isinstance(rule, NormalRejection) for rule in self.rejections
        ):
            normals = TreeTarget(moving_mm).normals_at(evidence.moving_mm, self.neighbours)
        # As many axes as are tried, as many poses go on: the right one has more rivals on few points.
        tries = self.axes_tried(evidence) if bound is None else 1
        search = self._search(evidence.moving_mm, self.survivors * tries)
        found = search(evidence, starts, bound, normals)
        result = answer(self, moving_mm, evidence, found, bound, begin_s)
        if centerlines is None or bound is not None or result.verdict == ACCEPTED:
            return result
        # Centerlines that are rough, or not of one vessel, can mislead: the surfaces' own axes have a say as well.
        own = self._starts(evidence, None, None)
        again = search(evidence, np.concatenate([starts, own]), bound, normals)
        again = replace(again, iterations=found.iterations + again.iterations)
        return answer(self, moving_mm, evidence, again, bound, begin_s)

    @property
    def kept(self) -> float:
        """The share of closest pairs in the early stages and in the trimmed residual."""
        return KEPT if self.keep is None else self.keep

    def axes_tried(self, evidence: Evidence) -> int:
        """How many axes of the moving cloud are tried for the vessel's where nothing is known of its pose."""
        spread_mm = principal_frame(evidence.moving_mm[: evidence.core]).spread_mm
        return len(principal_axes(spread_mm, self.axis_share, self.compact_share))

    @property
    def _weighing(self) -> RobustKernel | None:
        return None if self.refine_by == "point" else self.kernel

    def _turned_round(
        self, result: RigidResult, moving_mm: np.ndarray, fixed_mm: np.ndarray, begin_s: float
    ) -> RigidResult:
        moving, target = TreeTarget(moving_mm), TreeTarget(fixed_mm)
        settings = {"keep": self.kept, "inlier_spacings": self.inlier_spacings}
        return turned_round(
            result,
            lambda one: measured_candidate(self, one, moving_mm, moving, target),
            lambda pose: fit(moving_mm, target, pose, **settings),
            begin_s,
        )

    def _starts(
        self,
        evidence: Evidence,
        bound: Bound | None,
        centerlines: tuple[np.ndarray, np.ndarray] | None,
    ) -> Float64[np.ndarray, "s 4 4"]:
        """Around a known pose, else by the centerlines, else by the surfaces' own axes."""
        moving_mm = evidence.moving_mm[: evidence.core]
        if bound is not None:
            return cone_starts(moving_mm, bound.initial, bound.angle_deg, bound.radius_mm)
        if centerlines is None:
            target = evidence.target
            fixed_mm = target.points_mm
            if len(fixed_mm) >= LEAST_CLOUD:
                fixed_mm = fixed_mm[~lonely(target.away_mm(NEIGHBOUR))]
            return symmetry_starts(
                moving_mm,
                fixed_mm,
                self.rolls,
                self.slide_share,
                self.axis_share,
                self.compact_share,
                invert=self.invert,
                slide=self.slide,
            )
        return centerline_starts(
            *centerlines,
            self.rolls,
            self.slide_share,
            self.centerline_places,
            invert=self.invert,
            slide=self.slide,
        )

    def _evidence(
        self, moving_mm: np.ndarray, fixed_mm: np.ndarray, moving_frame: np.ndarray | None
    ) -> Evidence:
        rng = np.random.default_rng(self.seed)
        order = rng.permutation(len(moving_mm))[: self.fine_points]
        if len(fixed_mm) > self.fixed_points:
            fixed_mm = fixed_mm[rng.permutation(len(fixed_mm))[: self.fixed_points]]
        # The early stages take the first points: they should not be strays.
        stray = strays(moving_mm[order])
        order = np.concatenate([order[~stray], order[stray]])
        core = len(order) - int(stray.sum())
        shuffled_mm = moving_mm[order]
        if moving_frame is None:
            block = blocks_of(shuffled_mm, self.blocks)
        else:
            block = blocks_of_frames(moving_frame[order], self.blocks)
        if self.refine_by == "point":
            target = TreeTarget(fixed_mm)
            return Evidence(shuffled_mm, block, target, target, core=core)
        exact, smoothed = outward_targets(fixed_mm, self.neighbours, SMOOTHING * self.neighbours)
        return Evidence(shuffled_mm, block, exact, smoothed, self.wall_offset, core)

    def _search(self, shuffled_mm: np.ndarray, survivors: int) -> CoarseToFine:
        return CoarseToFine(
            first=Stage("first", self.first_points, self.first_iterations, EARLY_TOLERANCE, len(shuffled_mm)),
            coarse=Stage("coarse", self.coarse_points, self.coarse_iterations, EARLY_TOLERANCE, survivors),
            middle=Stage(
                "middle",
                self.middle_points,
                self.max_iterations,
                max(self.tolerance, EARLY_TOLERANCE),
                self.finalists,
            ),
            fine=Stage("fine", self.fine_points, self.max_iterations, self.tolerance, 1),
            first_share=self.first_share,
            cells=self.coarse_cells,
            keep=self.kept,
            kept=1.0 if self.keep is None and self._weighing is not None else self.kept,
            basin_share=self.basin_share,
            estimation=estimation_by(self.refine_by, self.wall_offset),
            kernel=self._weighing,
            rejections=tuple(self.rejections),
        )
