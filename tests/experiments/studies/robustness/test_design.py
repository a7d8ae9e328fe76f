"""The design: which jobs there are, and which conditions each has."""

from __future__ import annotations

import math
from typing import Any

import pytest

from experiments.errors import InputError
from experiments.studies.robustness.design import conditions, job_changes, one_piece
from registration.perturbation.perturbation import Perturbation, Piece

NODES = {"a": {"_target_": "x"}, "b": {"_target_": "y"}}
A, B = ({"rigid": {name: node}} for name, node in NODES.items())
BASE = Perturbation(180.0, 10.0, 0.5, 0.0, moving_points=30, fixed_points=30, angle_bin_deg=15.0)


def config(**change: Any) -> dict[str, Any]:
    return {
        "target": "t.stl",
        "rigid": NODES,
        "overlaps": [1.0, 0.6],
        "places": ["start", "end"],
        "factors": {},
    } | change


def test_jobs_are_methods_by_pieces_and_the_whole_vessel_has_one_place() -> None:
    pieces = [(1.0, "start"), (0.6, "start"), (0.6, "end")]
    assert job_changes(config()) == [
        {**method, "overlaps": [overlap], "places": [place]} for overlap, place in pieces for method in (A, B)
    ]


def test_factors_have_jobs_of_their_own_on_the_first_piece() -> None:
    found = job_changes(
        config(overlaps=[0.6], places=["end"], factors={"noise_mm": [0, 1], "missing_share": [0.1]})
    )
    piece = {"overlaps": [0.6], "places": ["end"]}
    assert found == [
        {**method, **piece, "factors": factors}
        for factors in ({}, {"noise_mm": [0, 1]}, {"missing_share": [0.1]})
        for method in (A, B)
    ]


def test_each_anatomy_has_its_jobs_and_its_centerline() -> None:
    found = job_changes(
        config(target=["s.stl", "t.stl"], target_centerline=["s.vtp", "t.vtp"], overlaps=[1.0])
    )
    assert [(job["target"], job["target_centerline"], *job["rigid"]) for job in found] == [
        ("s.stl", "s.vtp", "a"),
        ("s.stl", "s.vtp", "b"),
        ("t.stl", "t.vtp", "a"),
        ("t.stl", "t.vtp", "b"),
    ]
    bare = job_changes(config(target=["s.stl", "t.stl"], target_centerline=None, overlaps=[1.0]))
    assert {job["target_centerline"] for job in bare} == {None}


@pytest.mark.parametrize(
    "change, message",
    [
        ({"rigid": {}}, "rigid: expected at least one method"),
        ({"overlaps": 1.0}, "overlaps: expected a list with something in it, received 1.0"),
        ({"places": []}, "places: expected a list with something in it"),
        ({"factors": [1]}, "factors: expected levels by the name of a factor"),
        ({"target": []}, "target: expected a list with something in it"),
        (
            {"target": ["s", "t"], "target_centerline": "s.vtp"},
            "target_centerline: expected one for each of 2",
        ),
        (
            {"target": ["s", "t"], "target_centerline": ["s.vtp"]},
            "target_centerline: expected one for each of 2",
        ),
    ],
)
def test_jobs_of_nothing_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        job_changes(config(**change))


def test_rotations_are_crossed_with_bins() -> None:
    found = conditions(BASE, ["any", "roll", "flip"], {}, 25)
    assert [(each.factor, each.perturbation.rotation, each.trials) for each in found] == [
        ("rotation", "any", 300),
        ("rotation", "roll", 300),
        ("rotation", "flip", 25),
    ]
    assert all(math.isnan(each.level) for each in found)
    (own,) = conditions(BASE, None, None, 2)
    assert own.perturbation == BASE


@pytest.mark.parametrize(
    "factor, levels, fields",
    [
        ("translation_mm", [0, 50], ("translation_min_mm", "translation_max_mm")),
        ("noise_mm", [0, 0.25], ("noise_mm",)),
        ("outlier_share", [0, 0.1], ("outlier_share",)),
        ("missing_share", [0, 0.3], ("missing_share",)),
    ],
)
def test_a_factor_changes_its_own_fields_alone(
    factor: str, levels: list[float], fields: tuple[str, ...]
) -> None:
    found = conditions(BASE, ["any", "roll"], {factor: levels}, 25)
    assert [(each.factor, each.level, each.trials) for each in found] == [
        (factor, level, 25) for level in levels
    ]
    for each in found:
        changed = {name for name in vars(BASE) if getattr(each.perturbation, name) != getattr(BASE, name)}
        assert changed <= {*fields, "angle_bin_deg"}
        assert {getattr(each.perturbation, name) for name in fields} == {each.level}
        assert each.perturbation.angle_bin_deg is None


@pytest.mark.parametrize(
    "rotations, factors, trials, message",
    [
        (["spin"], {}, 1, "rotations: rotation: expected one of any, roll, flip"),
        ([], {}, 1, "rotations: expected a list with something in it"),
        (None, {"noise": [1]}, 1, "factors: expected some of translation_mm"),
        (None, {"noise_mm": [-1]}, 1, r"factors\.noise_mm: noise_mm: expected a number of at least 0"),
        (None, {"noise_mm": ["much"]}, 1, r"factors\.noise_mm: expected numbers, received 'much'"),
        (None, {"noise_mm": 1}, 1, r"factors\.noise_mm: expected a list"),
        (None, {}, 0, "trials: expected a whole number of at least 1"),
    ],
)
def test_conditions_of_nothing_are_refused(rotations: Any, factors: Any, trials: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        conditions(BASE, rotations, factors, trials)


def test_a_job_has_one_piece() -> None:
    assert one_piece([0.4], ["end"]) == Piece(0.4, "end")
    with pytest.raises(InputError, match="places: expected one value a job, received 2"):
        one_piece([0.4], ["end", "start"])
    with pytest.raises(InputError, match="overlaps and places: share"):
        one_piece([0.0], ["end"])
