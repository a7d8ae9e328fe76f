"""Errors that sweeps share, and pairs that cannot be compared, on shapes and numbers made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from experiments.errors import InputError
from experiments.studies.consistency.repeats import Repeat, common, pair
from registration.geometry.shapes import Mesh

AXIS_MM = straight(30.0)
TUBE = tube(AXIS_MM, 4.0)


def repeat(seen: Mesh | None, material: Mesh | None = None, error: str = "") -> Repeat:
    return Repeat({"error": error}, np.zeros(3), seen, seen if material is None else material)


def test_what_all_sweeps_share_is_their_mean_where_all_show_the_vessel() -> None:
    # Two sweeps: 0.2 and 0.4 too far out at the first place, opposite at the second, one of them missing at the third.
    found = common([np.array([0.2, 0.3, np.nan]), np.array([0.4, -0.3, 5.0])])
    assert found["msd_covered_mm"] == pytest.approx(0.15)
    assert found["bias_mm"] == pytest.approx(0.15)
    assert found["covered_second"] == pytest.approx(2 / 3)
    with pytest.raises(InputError, match="sweeps: expected a part of the vessel that all sweeps show"):
        common([np.array([np.nan, 1.0]), np.array([1.0, np.nan])])


def test_a_pair_is_measured_as_tracked_and_without_deformation() -> None:
    found = pair(repeat(TUBE), repeat(tube(AXIS_MM, 4.5), material=TUBE), (2000, 0))
    assert found["msd_mm"] == pytest.approx(0.5, abs=0.02)
    assert found["hd95_covered_mm"] == pytest.approx(0.5, abs=0.02)
    assert found["msd_tissue_mm"] == pytest.approx(0.0, abs=1e-4)
    assert found["error"] == ""


def test_pairs_that_cannot_be_compared_are_infinitely_far_apart() -> None:
    along = (AXIS_MM[-1] - AXIS_MM[0]) / np.linalg.norm(AXIS_MM[-1] - AXIS_MM[0])
    beyond = Mesh(TUBE.vertices_mm + 50 * along, TUBE.triangles)
    for other, reason in (
        (repeat(beyond), "a common part"),
        (repeat(None, error="no surface"), "no surface"),
    ):
        found = pair(repeat(TUBE), other, (500, 0))
        assert found["hd95_mm"] == found["hd95_tissue_mm"] == np.inf
        assert reason in found["error"]
