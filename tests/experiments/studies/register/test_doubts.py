"""What a user is told of files in the wrong unit or axes, in several pieces, and of a pose that nobody searched for."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from vessels import bent_tube

from experiments.cli import main
from experiments.studies.register.doubts import doubts
from experiments.studies.register.pair import Pair, Side
from experiments.studies.register.record import Registered
from registration.geometry.shapes import Mesh, Surface
from registration.io.surfaces import write_surface
from registration.metrics.surface_distance import surface_residuals
from registration.rigid.result import ACCEPTED, AMBIGUOUS, FAILED, NOT_JUDGED, RigidResult

TUBE = bent_tube()


def side(surface: Surface, name: str = "a.stl", assumed: bool = False) -> Side:
    return Side(Path(name), surface, "lps", None, None, assumed=assumed)


def found(moving: Side, fixed: Side, verdict: str) -> Registered:
    pair = Pair(moving, fixed, None, None, ())
    result = RigidResult(np.eye(4), 1.0, 1.0, 0.5, 1, True, (), 0.1, verdict=verdict)
    residuals = surface_residuals(
        moving.surface, fixed.surface, np.eye(4), inlier_mm=1.0, keep=0.9, samples=500
    )
    return Registered("gicp", pair, result, residuals)


def scaled(factor: float) -> Mesh:
    return Mesh(factor * TUBE.vertices_mm, TUBE.triangles)


def with_ball() -> Mesh:
    """The tube and, far from it, a copy of a quarter of its size."""
    apart = 0.25 * TUBE.vertices_mm + 200.0
    return Mesh(
        np.concatenate([TUBE.vertices_mm, apart]),
        np.concatenate([TUBE.triangles, TUBE.triangles + len(TUBE.vertices_mm)]),
    )


@pytest.mark.parametrize("verdict", [AMBIGUOUS, FAILED, NOT_JUDGED])
def test_a_model_much_smaller_than_the_sweep_is_asked_for_its_unit(verdict: str) -> None:
    told = " ".join(doubts(found(side(TUBE), side(scaled(0.1)), verdict)))
    assert "in centimetres or metres it needs fixed_unit=cm or fixed_unit=m" in told
    # A sweep is often a short piece of its model.
    assert not doubts(found(side(scaled(0.1)), side(TUBE), AMBIGUOUS))


def test_pieces_beside_the_vessel_are_named_with_their_share() -> None:
    (told,) = doubts(found(side(TUBE), side(with_ball(), "model.stl"), FAILED))
    assert told.startswith("fixed: model.stl lies in 2 pieces, 6 % of the area outside the largest")
    told = doubts(found(side(with_ball()), side(TUBE), AMBIGUOUS))[-1]
    assert told.startswith("moving: a.stl lies in 2 pieces")
    assert not doubts(found(side(TUBE), side(with_ball()), ACCEPTED))


def test_axes_that_nobody_stated_are_named_whatever_the_verdict() -> None:
    pair = side(TUBE, "sweep.xyz", assumed=True), side(TUBE, "model.stl", assumed=True)
    for verdict in (ACCEPTED, FAILED):
        (told,) = doubts(found(*pair, verdict))
        assert told == (
            "sweep.xyz and model.stl state no axes and was taken as LPS; moving_space=ras or fixed_space=ras "
            "says otherwise."
        ).replace("was", "were")
    (told,) = doubts(found(pair[0], side(TUBE), ACCEPTED))
    assert told == "sweep.xyz states no axes and was taken as LPS; moving_space=ras says otherwise."


def test_a_pose_that_was_not_searched_for_and_fits_badly_is_doubted() -> None:
    far = dataclasses.replace(side(TUBE), surface=Mesh(TUBE.vertices_mm + 50.0, TUBE.triangles))
    (told,) = doubts(found(far, side(TUBE), NOT_JUDGED))
    assert told.startswith(
        "Only 0 % of the moving points lie on the fixed surface: gicp has hardly found the pose."
    )
    assert not doubts(found(side(TUBE), side(TUBE), NOT_JUDGED))
    assert not doubts(found(far, side(TUBE), FAILED))


def test_a_model_in_centimetres_is_asked_for_and_then_converted(home: Path, capsys) -> None:
    write_surface(home / "sweep.ply", TUBE)
    trimesh.Trimesh(scaled(0.1).vertices_mm, TUBE.triangles).export(home / "model.stl")
    words = [
        "study=register",
        f"moving={home / 'sweep.ply'}",
        f"fixed={home / 'model.stl'}",
        "tracking.enabled=false",
    ]
    assert main([*words, f"out={home / 'one'}"]) == 0
    said = capsys.readouterr().out
    assert (
        "fixed_unit=cm" in said and "\nmodel.stl states no axes and was taken as LPS; fixed_space=ras" in said
    )
    assert main([*words, "fixed_unit=cm", f"out={home / 'two'}"]) == 0
    assert "fixed_unit=cm" not in capsys.readouterr().out
