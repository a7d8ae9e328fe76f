"""Symmetry-aware multi-start rigid registration of two clouds, coarse to fine, that knows when it doesn't know."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.rigid.acceptance import AcceptanceCriteria
from registration.rigid.assessment import Assessment, Problem, assess
from registration.rigid.coarse_to_fine import CoarseToFine, Found, estimation_by
from registration.rigid.correspondence import Correspondence
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.robust_kernels import RobustKernel, Tukey
from registration.rigid.isolated_points import isolated_points
from registration.rigid.partial_overlap import PartialOverlap
from registration.rigid.pose_comparison import Evidence
from registration.rigid.residual_model.compact_blocks import blocks_of, blocks_of_frames
from registration.rigid.residual_model.model import ResidualModel
from registration.rigid.result import ACCEPTED, RigidResult
from registration.rigid.rigid_input import frame_of_points, points_on_line, rigid_clouds
from registration.rigid.search_cone import SearchBound, SearchCone, bound_around, known_pose
from registration.rigid.stages import Stages
from registration.rigid.starts import Starts
from registration.rigid.swapped import inverted_result, is_longer
from registration.rigid.uncertainty import Uncertainty

REFINEMENTS = ("plane", "symmetric", "point")
# The share of closest pairs that counts where it is not given and no kernel weighs them.
KEPT = 0.9


@dataclass(frozen=True)
class MultiStartICP:
    """ICP from every pose that the symmetry of a vessel allows; the one that explains the points best wins.

    All starts are taken to their optimum in four stages, coarse to fine, on more points in each. The best pose is
    accepted only where all others explain the clouds worse by more than chance and its predicted error is small.
    Where the moving cloud is the longer one, the fixed one is registered to it and the result inverted.

    Parameters
    ----------
    starts : Starts, optional
        Which starting poses are tried.
    stages : Stages, optional
        Points, iterations and survivors of each stage.
    correspondence : Correspondence, optional
        How closest points and normals are found, and which pairs do not count.
    refine_by : str, optional
        Residual of the last two stages: ``plane`` (along fixed normals: exact on sampled surfaces, whose points never
        coincide), ``symmetric`` (normals of both) or ``point`` (for clouds that are no surface: no kernel weighs,
        walls have no offset, and no error is predicted, for closest points say too little about it).
    wall_offset : bool, optional
        Whether one wall may lie outside the other by the same distance everywhere, as the borders that two modalities
        show do: it is estimated with the pose and reported, and is no residual.
    kernel : RobustKernel or None, optional
        Weights of the pairs in the last two stages; None weighs them all alike.
    keep : float or None, optional
        Share of closest pairs that counts in all stages and in the trimmed residual; None stands for 0.9, and for all
        pairs where the kernel weighs them.
    bound : SearchBound, optional
        How far the result may lie from a known pose where the call gives no search cone.
    uncertainty : Uncertainty, optional
        Bootstrap that predicts the error where no tissue has moved.
    residual_model : ResidualModel or None, optional
        Model of the residuals, which detects tissue that has moved, corrects the pose and predicts the error then, and
        says how probable it is that both clouds show one vessel. None takes all residuals for noise.
    acceptance : AcceptanceCriteria, optional
        What a result must show to be accepted.
    partial_overlap : PartialOverlap or None, optional
        Search for a pose that brings a part of one cloud onto a part of the other, where that for the whole cloud ends
        in no accepted result; its results are never accepted. None, or ``refine_by='point'``, leaves it out.
    seed : int, optional
        Seed of all draws; the method is deterministic in it.

    Raises
    ------
    InputError
        If the residual is none of the three, the share is outside 0 to 1 or the seed is negative.

    References
    ----------
    T. Vantini, Politecnico di Milano, 2025, section 2.5 (starts and selection); see ``registration.rigid.icp.loop``,
    ``registration.rigid.pose_comparison`` and ``registration.rigid.uncertainty``.

    Examples
    --------
    >>> vessel_mm = np.random.default_rng(1).normal(size=(500, 3)) * [9.0, 3.0, 1.0]
    >>> bool(MultiStartICP()(vessel_mm + 5.0, vessel_mm).rmse_mm < 1e-6)
    True
    """

    starts: Starts = field(default_factory=Starts)
    stages: Stages = field(default_factory=Stages)
    correspondence: Correspondence = field(default_factory=Correspondence)
    refine_by: str = "plane"
    wall_offset: bool = True
    kernel: RobustKernel | None = field(default_factory=Tukey)
    keep: float | None = None
    bound: SearchBound = field(default_factory=SearchBound)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    residual_model: ResidualModel | None = field(default_factory=ResidualModel)
    acceptance: AcceptanceCriteria = field(default_factory=AcceptanceCriteria)
    partial_overlap: PartialOverlap | None = field(default_factory=PartialOverlap)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.refine_by not in REFINEMENTS:
            raise InputError(f"refine_by: expected {', '.join(REFINEMENTS)}, received {self.refine_by!r}")
        if self.keep is not None:
            require_positive("keep", self.keep, 1.0)
        require_count("seed", self.seed, 0)

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
        """Register a moving cloud to a fixed one, from anywhere or from near a known pose.

        Parameters
        ----------
        moving_mm : array_like, shape (m, 3)
            Moving points in mm.
        fixed_mm : array_like, shape (n, 3)
            Fixed points in mm.
        initial : array_like, shape (4, 4), or None, optional
            Known pose (fixed_T_moving); no result lies outside the bound around it. None searches everywhere.
        search_cone : SearchCone or None, optional
            Bound around ``initial``; what it leaves open is bounded by the method's own ``bound``.
        moving_centerline_mm, fixed_centerline_mm : array_like, shapes (p, 3) and (q, 3), or None, optional
            Points in mm on the clouds' centerlines; where both are given they shorten the search.
        moving_frame : array_like, shape (m,), or None, optional
            Index of the frame that each moving point was seen in, which makes the bootstrap one over frames.

        Returns
        -------
        RigidResult
            Pose, residuals, verdict and predicted error.

        Raises
        ------
        InputError
            If a cloud is empty, of another shape, not finite, degenerate or in metres, ``initial`` is not rigid or no
            start ends near it, there is a cone without it, or frames are not one a point.
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
            settings, moving_tree, fixed_tree = self._assessment, TreeTarget(moving), TreeTarget(fixed)
            return inverted_result(
                found_back,
                partial(settings.measured, moving_mm=moving, moving=moving_tree, target=fixed_tree),
                partial(settings.fit, moving, fixed_tree),
                begin_s,
            )
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
        bound = bound_around(initial, search_cone, moving_mm, self.bound)
        centerlines = None
        if lines[0] is not None and lines[1] is not None and self.starts.use_centerline:
            centerlines = (lines[0], lines[1])
        evidence = self._evidence(moving_mm, fixed_mm, moving_frame)
        starts = self.starts(evidence, bound, centerlines)
        normals = None
        if self.refine_by == "symmetric" or self.correspondence.by_normals:
            normals = TreeTarget(moving_mm).normals_at(evidence.moving_mm, self.correspondence.neighbours)
        axes_tried = self.starts.axes_tried(evidence) if bound is None else 1
        problem = Problem(moving_mm, evidence, bound, axes_tried, begin_s)
        search = self._search(axes_tried)
        found = search(evidence, starts, bound, normals)
        result = assess(self._assessment, problem, found) if len(found.gap) else None
        if result is not None and result.verdict == ACCEPTED:
            return result
        if centerlines is not None and bound is None:
            # Centerlines that are rough, or not of one vessel, can mislead: the surfaces' own axes have a say as well.
            starts = np.concatenate([starts, self.starts(evidence, None, None)])
            again = search(evidence, starts, bound, normals)
            found = replace(again, iterations=found.iterations + again.iterations)
            result = assess(self._assessment, problem, found)
            if result.verdict == ACCEPTED:
                return result
        return (
            self._in_part(problem, search, starts, found, normals)
            or result
            or assess(self._assessment, problem, found)
        )

    def _in_part(
        self,
        problem: Problem,
        search: CoarseToFine,
        starts: np.ndarray,
        found: Found,
        normals: np.ndarray | None,
    ) -> RigidResult | None:
        """The result of the search for partial overlap; None without one, or where it prefers the result before."""
        partial, evidence = self.partial_overlap, problem.evidence
        if partial is None or self.refine_by == "point" or (problem.bound is None and not partial.overhang):
            return None
        if problem.bound is None:
            starts = partial.starts(evidence, starts)
        steps = {offset: estimation_by(self.refine_by, offset) for offset in (False, self.wall_offset)}
        searches = tuple(partial.searches(search, steps.values()))
        ended = [(one, one(evidence, starts, problem.bound, normals)) for one in searches]
        best = partial.best(evidence, [(search, found), *ended], problem.bound, normals)
        if best is None:
            return None
        merged, seen = best
        if found.candidates and np.array_equal(
            merged.candidates[0].fixed_T_moving, found.candidates[0].fixed_T_moving
        ):
            return None
        part = replace(problem, evidence=evidence.part(seen), seen_share=float(seen.mean()))
        return assess(self._assessment, part, merged)

    @property
    def kept(self) -> float:
        """The share of closest pairs in the early stages and in the trimmed residual."""
        return KEPT if self.keep is None else self.keep

    @property
    def _weighing(self) -> RobustKernel | None:
        return None if self.refine_by == "point" else self.kernel

    @property
    def _assessment(self) -> Assessment:
        return Assessment(
            keep=self.kept,
            inlier_spacings=self.correspondence.inlier_spacings,
            kernel=self.kernel or Tukey(),
            uncertainty=self.uncertainty,
            residual_model=self.residual_model,
            acceptance=self.acceptance,
            probe_points=self.stages.coarse_points,
            seed=self.seed,
        )

    def _evidence(
        self, moving_mm: np.ndarray, fixed_mm: np.ndarray, moving_frame: np.ndarray | None
    ) -> Evidence:
        rng = np.random.default_rng(self.seed)
        order = rng.permutation(len(moving_mm))[: self.stages.fine_points]
        fixed_mm = self.correspondence.thinned(fixed_mm, rng)
        # The early stages take the first points: they should not be isolated ones.
        isolated = isolated_points(moving_mm[order])
        order = np.concatenate([order[~isolated], order[isolated]])
        core = len(order) - int(isolated.sum())
        shuffled_mm = moving_mm[order]
        frame = None if moving_frame is None else moving_frame[order]
        if frame is None:
            block = blocks_of(shuffled_mm, self.uncertainty.blocks)
        else:
            block = blocks_of_frames(frame, self.uncertainty.blocks)
        along_normals = self.refine_by != "point"
        exact, smoothed = self.correspondence.targets(fixed_mm, along_normals)
        return Evidence(shuffled_mm, block, exact, smoothed, self.wall_offset and along_normals, core, frame)

    def _search(self, axes_tried: int) -> CoarseToFine:
        return CoarseToFine(
            **self.stages.each(axes_tried),
            first_share=self.stages.first_share,
            cells=self.stages.coarse_cells,
            keep=self.kept,
            kept=1.0 if self.keep is None and self._weighing is not None else self.kept,
            basin_share=self.stages.basin_share,
            estimation=estimation_by(self.refine_by, self.wall_offset),
            kernel=self._weighing,
            rejections=self.correspondence.rejections,
        )
