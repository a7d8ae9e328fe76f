"""Registration of two files of a user's own: rigid, and on request deformable after that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.analysis.registration.slicer_result import require_slicer
from experiments.inputs.surfaces import one_method
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.register.carried import Carried, read_carried
from experiments.studies.register.centerlines import bends, centerline_candidates
from experiments.studies.register.deformed import deform, model_side_of, require_constraints, require_side
from experiments.studies.register.pair import Pair, SideFiles, read_pair
from experiments.studies.register.record import Registered
from experiments.studies.register.report import outcome, write
from experiments.studies.register.truth import read_known_truth
from registration.geometry.shapes import sampled
from registration.metrics.surface_distance import surface_residuals

if TYPE_CHECKING:
    from registration.rigid.result import RigidResult

# Points of a centerline that a method is given.
CENTERLINE_POINTS = 300
# What the dashboard has columns for.
HEADLINE = (
    *("rmse_mm", "rmse_trimmed_mm", "rmse_bidirectional_mm", "hd95_mm", "inlier_share", "coverage"),
    *("tre_mm", "predicted_tre_low_mm", "predicted_tre_high_mm", "landmark_error_mm", "deformed_rmse_mm"),
    *("ambiguity_gap", "runtime_s"),
)


def implicit_paths(config: Mapping[str, Any]) -> Iterator[Path]:
    """List the files that a job reads though no setting names them: centerlines next to the surfaces.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    iterator of Path
        Paths.
    """
    for side in ("moving", "fixed"):
        if config.get(f"{side}_centerline") is None:
            yield from centerline_candidates(Path(str(config[side])).expanduser())


def check(
    *,
    moving: PathSetting,
    fixed: PathSetting,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    model_side: str | None,
    landmark_deviation_mm: float | None,
    carry: Sequence[PathSetting],
    initial: PathSetting | None,
    search_cone_deg: float | None,
    search_radius_mm: float | None,
    truth: PathSetting | None,
    moving_landmarks: PathSetting | None,
    fixed_landmarks: PathSetting | None,
    moving_centerline: PathSetting | Literal["none"] | None,
    fixed_centerline: PathSetting | Literal["none"] | None,
    moving_unit: str | None,
    fixed_unit: str | None,
    moving_space: str | None,
    fixed_space: str | None,
    slicer: str,
) -> None:
    """Check that the files can be registered.

    Parameters
    ----------
    moving : PathSetting
        File of the surface or cloud that moves.
    fixed : PathSetting
        File of the surface or cloud that stays.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    model_side : str or None
        Side of the whole model, whose material is displaced: fixed or moving; None for the side that is no sweep, or
        the longer one.
    landmark_deviation_mm : float or None
        Standard deviation in mm per coordinate of landmarks as constraints of the deformable stage; None where they
        only measure the error.
    carry : sequence of PathSetting
        Further surfaces in the coordinate frame of the model's side, which the displacement is to carry along.
    initial : PathSetting or None
        File of a known pose; None for the pose of the landmarks, or none.
    search_cone_deg : float or None
        How far in degrees the result may rotate from a known pose; None for the default.
    search_radius_mm : float or None
        How far in mm the result may move from a known pose; None for the default.
    truth : PathSetting or None
        File of the right pose, which the error is measured against; None where it is not known.
    moving_landmarks, fixed_landmarks : PathSetting or None
        File of landmarks, paired by name; None for no landmarks.
    moving_centerline, fixed_centerline : PathSetting or {"none"} or None
        File of the centerline; "none" for no centerline; None for one next to the surface.
    moving_unit, fixed_unit : str or None
        Length unit, mm or m; None for mm, refused if it looks like metres.
    moving_space, fixed_space : str or None
        Axes, lps or ras; None as the header says, else lps.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer: a scene, a bundle of all in one file beside it, or nothing.

    Raises
    ------
    InputError
        If the files and settings cannot be registered.
    """
    one_method(rigid)
    one_method(deformable, "deformable")
    require_slicer(slicer)
    require_side(model_side)
    read_known_truth(truth)
    sides = (
        SideFiles("moving", moving, moving_unit, moving_space, moving_centerline, moving_landmarks),
        SideFiles("fixed", fixed, fixed_unit, fixed_space, fixed_centerline, fixed_landmarks),
    )
    pair = read_pair(*sides, initial, search_cone_deg, search_radius_mm)
    require_constraints(landmark_deviation_mm, pair)
    read_carried(carry, sides[model_side_of(model_side, pair) == "fixed"])


def run(
    *,
    moving: PathSetting,
    fixed: PathSetting,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
    model_side: str | None,
    landmark_deviation_mm: float | None,
    carry: Sequence[PathSetting],
    initial: PathSetting | None,
    search_cone_deg: float | None,
    search_radius_mm: float | None,
    truth: PathSetting | None,
    moving_landmarks: PathSetting | None,
    fixed_landmarks: PathSetting | None,
    moving_centerline: PathSetting | Literal["none"] | None,
    fixed_centerline: PathSetting | Literal["none"] | None,
    moving_unit: str | None,
    fixed_unit: str | None,
    moving_space: str | None,
    fixed_space: str | None,
    moving_points: int,
    fixed_points: int,
    slicer: str,
    inlier_mm: float,
    keep: float,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Register ``moving`` to ``fixed``.

    Leaves registration.json, moved.ply (mm, LPS), fixed_T_moving.h5 (in ITK's direction), scene.html and, for 3D
    Slicer, scene.mrml in ``workspace``; after a deformable stage moved_deformed.ply, model_deformed.ply and the
    displacement too. Meshes are sampled uniformly by area for the method; residuals are measured on the surfaces
    themselves.

    Parameters
    ----------
    moving : PathSetting
        File of the surface or cloud that moves.
    fixed : PathSetting
        File of the surface or cloud that stays.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.
    model_side : str or None
        Side of the whole model, whose material is displaced: fixed or moving; None for the side that is no sweep, or
        the longer one.
    landmark_deviation_mm : float or None
        Standard deviation in mm per coordinate of landmarks as constraints of the deformable stage; None where they
        only measure the error.
    carry : sequence of PathSetting
        Further surfaces in the coordinate frame of the model's side, which the displacement is to carry along.
    initial : PathSetting or None
        File of a known pose; None for the pose of the landmarks, or none.
    search_cone_deg : float or None
        How far in degrees the result may rotate from a known pose; None for the default.
    search_radius_mm : float or None
        How far in mm the result may move from a known pose; None for the default.
    truth : PathSetting or None
        File of the right pose, which the error is measured against; None where it is not known.
    moving_landmarks, fixed_landmarks : PathSetting or None
        File of landmarks, paired by name; None for no landmarks.
    moving_centerline, fixed_centerline : PathSetting or {"none"} or None
        File of the centerline; "none" for no centerline; None for one next to the surface.
    moving_unit, fixed_unit : str or None
        Length unit, mm or m; None for mm, refused if it looks like metres.
    moving_space, fixed_space : str or None
        Axes, lps or ras; None as the header says, else lps.
    moving_points, fixed_points : int
        Number of points sampled from a mesh.
    slicer : {'scene', 'bundle', 'none'}
        What is written for 3D Slicer: a scene, a bundle of all in one file beside it, or nothing.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, the table of one row and the findings.

    Raises
    ------
    InputError
        If the files cannot be registered.
    """
    name, method = one_method(rigid)
    sides = (
        SideFiles("moving", moving, moving_unit, moving_space, moving_centerline, moving_landmarks),
        SideFiles("fixed", fixed, fixed_unit, fixed_space, fixed_centerline, fixed_landmarks),
    )
    pair = read_pair(*sides, initial, search_cone_deg, search_radius_mm)
    side = model_side_of(model_side, pair)
    carried = Carried(read_carried(carry, sides[side == "fixed"]), landmark_deviation_mm)
    progress.note(f"registering {pair.moving.path.name} to {pair.fixed.path.name} by {name}")
    result = _registered(method, pair, moving_points, fixed_points, seed)
    residuals = surface_residuals(
        pair.moving.surface,
        pair.fixed.surface,
        result.fixed_T_moving,
        inlier_mm=inlier_mm,
        keep=keep,
        seed=seed,
    )
    deformed, refusal = None, ""
    second, deformable_stage = one_method(deformable, "deformable")
    if deformable_stage is not None:
        progress.note(f"deforming by {second}")
        points = {"moving": moving_points, "fixed": fixed_points}
        deformed, refusal = deform(
            second, deformable_stage, pair, result, side, landmark_deviation_mm,
            points=points, inlier_mm=inlier_mm, keep=keep, seed=seed,
        )  # fmt: skip
    found = Registered(name, pair, result, residuals, read_known_truth(truth), deformed, refusal, carried)
    write(found, workspace, slicer)
    return outcome(found, slicer)


def _registered(method: Any, pair: Pair, moving_points: int, fixed_points: int, seed: int) -> RigidResult:
    """The method's result for clouds drawn from both surfaces, with centerlines and what is known of the pose."""
    draws = np.random.default_rng(seed).spawn(2)
    lines_mm = [side.centerline_mm(CENTERLINE_POINTS) for side in (pair.moving, pair.fixed)]
    # A straight line says no more than the axis of its surface, and a search along it has nothing to hold on to.
    if any(line_mm is not None and not bends(line_mm) for line_mm in lines_mm):
        lines_mm = [None, None]
    result: RigidResult = method(
        sampled(pair.moving.surface, moving_points, draws[0]),
        sampled(pair.fixed.surface, fixed_points, draws[1]),
        None if pair.initial is None else pair.initial.fixed_T_moving,
        search_cone=None if pair.initial is None else pair.initial.search_cone,
        moving_centerline_mm=lines_mm[0],
        fixed_centerline_mm=lines_mm[1],
        moving_frame=pair.moving.frame,
    )
    return result
