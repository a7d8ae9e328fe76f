"""Known deformations: of the size that is asked for, smooth, and without folds."""

from __future__ import annotations

import numpy as np
import pytest
from vessels import bent_tube

from registration.benchmark.known_deformations import DEFORMATIONS, Dilation, draw_known
from registration.deformable.displacement_field import gradient
from registration.errors import InputError

TUBE = bent_tube()
LINE_MM = TUBE.vertices_mm[:-2].reshape(80, 32, 3).mean(axis=1)
RADIUS_MM = np.full(80, 6.0)


def drawn(name: str, size_mm: float, seed: int = 0):
    rng = np.random.default_rng(seed)
    return draw_known(name, LINE_MM, RADIUS_MM, TUBE.vertices_mm, size_mm, rng)


@pytest.mark.parametrize("name", DEFORMATIONS)
@pytest.mark.parametrize("seed", range(3))
def test_no_deformation_folds_at_the_largest_size(name: str, seed: int) -> None:
    moved = drawn(name, 5.0, seed)
    rng = np.random.default_rng(1)
    low_mm, high_mm = TUBE.vertices_mm.min(axis=0) - 10, TUBE.vertices_mm.max(axis=0) + 10
    points_mm = rng.uniform(low_mm, high_mm, (2000, 3))
    volumes = np.linalg.det(np.eye(3) + gradient(lambda places_mm: moved(places_mm) - places_mm, points_mm))
    assert volumes.min() > 0.3


def test_sizes_are_those_asked_for() -> None:
    for size_mm in (1.5, 5.0):
        shift_mm = np.linalg.norm(drawn("bending", size_mm)(TUBE.vertices_mm) - TUBE.vertices_mm, axis=1)
        assert shift_mm.max() == pytest.approx(size_mm, rel=0.01)
        shift_mm = np.linalg.norm(drawn("indentation", size_mm)(LINE_MM) - LINE_MM, axis=1)
        assert 0.7 * size_mm < shift_mm.max() < size_mm
    assert not (drawn("none", 0.0)(LINE_MM) - LINE_MM).any()


def test_a_dilation_widens_the_wall_and_leaves_its_axis() -> None:
    found = drawn("dilation", 5.0)
    assert isinstance(found, Dilation)
    np.testing.assert_allclose(found(found.centre_mm[None]), found.centre_mm[None])
    across = np.cross(found.axis, [1.0, 0.3, 0.2])
    at_wall_mm = found.centre_mm + 6.0 * across / np.linalg.norm(across)
    assert np.linalg.norm(found(at_wall_mm[None]) - found.centre_mm) == pytest.approx(6.0 * 1.4)
    far_mm = found.centre_mm + 31.0 * across / np.linalg.norm(across)
    np.testing.assert_array_equal(found(far_mm[None]), far_mm[None])
    assert drawn("dilation", 1.5).share < found.share


def test_a_bend_is_one_period_of_a_cosine_along_the_vessel() -> None:
    found = drawn("bending", 2.0)
    ends_mm = found.centre_mm + np.outer([-1.0, -0.5, 0.0, 0.5, 1.0], found.half_length_mm * found.along)
    shift_mm = (found(ends_mm) - ends_mm) @ found.across
    np.testing.assert_allclose(shift_mm, [-2.0, 0.0, 2.0, 0.0, -2.0], atol=1e-9)


def test_an_unknown_deformation_is_refused() -> None:
    with pytest.raises(InputError, match="deformation: expected one of bending, dilation"):
        drawn("torsion", 1.0)
