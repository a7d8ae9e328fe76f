"""The symmetric shapes have the symmetries that they say, and no others that would be as easy to name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from registration import transforms
from registration.benchmark.scenarios import KINDS
from registration.benchmark.symmetric_shapes import SHAPES
from registration.benchmark.symmetry import half_turn


def places_mm(name: str) -> np.ndarray:
    """Points on the lines of a shape, with the radius as a fourth coordinate."""
    lines = SHAPES[name][0]().lines
    return np.concatenate([np.column_stack([line.points_mm, line.radius_mm]) for line in lines])


def farthest_mm(name: str, motion: np.ndarray, within_mm: float = 0.0) -> float:
    """How far a motion takes the shape's lines and radii from themselves, ``within_mm`` of both ends left out."""
    lines = places_mm(name)
    kept = lines[np.abs(lines[:, 2]) <= np.abs(lines[:, 2]).max() - within_mm]
    moved = np.column_stack([transforms.apply(motion, kept[:, :3]), kept[:, 3]])
    return float(cKDTree(lines).query(moved)[0].max())


@pytest.mark.parametrize("name", SHAPES)
def test_its_symmetry_lays_a_shape_on_itself(name: str) -> None:
    shape = SHAPES[name][0]()
    assert shape.symmetry or shape.slide
    for flip in shape.symmetry.flips:
        assert farthest_mm(name, flip) < 0.1
        assert np.abs(flip - np.eye(4)).max() > 1
    for screw in shape.symmetry.screws:
        for motion in screw(np.array([0.13, 0.5, 0.77])):
            assert farthest_mm(name, motion) < 0.1


@pytest.mark.parametrize("name", ["straight", "arc", "helix"])
def test_a_slide_keeps_a_piece_within_its_vessel(name: str) -> None:
    shape = SHAPES[name][0]()
    assert shape.slide is not None and shape.along_mm is not None
    motion = shape.slide(np.array([6.0]))[0]
    assert farthest_mm(name, motion, within_mm=15.0) < 0.15
    # Forwards is where the place along the vessel grows, by as much.
    points_mm = places_mm(name)[300:-300, :3]
    grown = shape.along_mm(transforms.apply(motion, points_mm)) - shape.along_mm(points_mm)
    np.testing.assert_allclose(grown, 6.0, atol=0.1)


def test_a_piece_may_slide_as_far_as_the_model_goes() -> None:
    shape = SHAPES["straight"][0]()
    fixed_mm = np.outer([-40.0, 40.0], [0.0, 0.0, 1.0])
    piece_mm = np.outer([-10.0, 25.0], [0.0, 0.0, 1.0])
    *_, slide = shape.symmetry_of(piece_mm, fixed_mm).screws
    assert (slide.low, slide.high) == (-30.0, 15.0)
    *_, none = shape.symmetry_of(1.1 * fixed_mm, fixed_mm).screws
    assert (none.low, none.high) == (0.0, 0.0)


def test_a_cone_has_no_half_turn_and_a_fork_no_roll() -> None:
    assert farthest_mm("cone", half_turn(np.zeros(3), np.array([1.0, 0.0, 0.0]))) > 1.0
    roll = SHAPES["cone"][0]().symmetry.screws[0]
    assert farthest_mm("fork", roll(np.array([0.25]))[0]) > 3.0
    assert not SHAPES["fork"][0]().symmetry.screws


def test_every_shape_has_cases_of_known_kinds() -> None:
    names = {kind.name for kind in KINDS}
    for _, kinds in SHAPES.values():
        assert kinds
        assert set(kinds) <= names
