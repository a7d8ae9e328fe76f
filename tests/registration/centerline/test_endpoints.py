"""Ends of trees of spheres that are placed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from registration.centerline.endpoints import BranchEnd, branch_ends
from registration.centerline.medial_axis import MedialAxis

NONE = np.zeros(0, dtype=np.int64)


def comb(heights: dict[int, int]) -> tuple[MedialAxis, np.ndarray]:
    """A trunk of 0 to 40 along z with radius 4, and teeth of radius 1 at some places; the way from its foot."""
    centres, radius, links = [[0.0, 0, z] for z in range(41)], [4.0] * 41, [(z, z + 1) for z in range(40)]
    away = [float(z) for z in range(41)]
    for place, height in heights.items():
        before = place
        for step in range(1, height + 1):
            centres.append([float(step), 0, place])
            radius.append(1.0)
            away.append(place + step)
            links.append((before, len(centres) - 1))
            before = len(centres) - 1
    first, second = np.array(links).T
    graph = csr_array((np.ones(len(links)), (first, second)), shape=(len(centres),) * 2)
    return MedialAxis(np.array(centres), np.array(radius), graph), np.array(away)


def test_a_branch_counts_from_so_many_radii_of_the_trunk_on() -> None:
    # Tooth at 10 reaches 5 mm, tooth at 20 reaches 7: 1.5 radii of the trunk are 6.
    axis, away_mm = comb({10: 5, 20: 7})
    main = np.ones(len(away_mm), dtype=bool)
    assert branch_ends(axis, main, away_mm, 1.5, NONE) == (BranchEnd(40, ()), BranchEnd(52, ()))
    assert [found.node for found in branch_ends(axis, main, away_mm, 1.0, NONE)] == [40, 52, 45]
    assert [found.node for found in branch_ends(axis, main, away_mm, 3.0, NONE)] == [40]


def test_only_main_spheres_are_ends() -> None:
    axis, away_mm = comb({20: 9})
    main = np.ones(len(away_mm), dtype=bool)
    main[43:] = False
    # Of the tooth's nine spheres only two are main: they do not reach far enough.
    assert [found.node for found in branch_ends(axis, main, away_mm, 1.5, NONE)] == [40]


def test_marked_spheres_go_with_their_branch() -> None:
    axis, away_mm = comb({10: 5, 20: 7})
    main = np.ones(len(away_mm), dtype=bool)
    top, tooth = branch_ends(axis, main, away_mm, 1.5, np.array([45, 51, 39]))
    # The mark on the short tooth goes to what the tooth hangs on.
    assert sorted(top.marked) == [39, 45]
    assert tooth.marked == (51,)


def test_a_farther_branch_takes_the_trunks_place() -> None:
    axis, away_mm = comb({30: 25})
    found = branch_ends(axis, np.ones(len(away_mm), dtype=bool), away_mm, 1.5, NONE)
    assert [branch_end.node for branch_end in found] == [65, 40]


@pytest.mark.parametrize("length_mm, ends", [(5.0, 0), (7.0, 1)])
def test_what_is_not_longer_than_wide_has_no_end(length_mm: float, ends: int) -> None:
    centres_mm = np.array([[0.0, 0, 0], [0, 0, length_mm]])
    axis = MedialAxis(centres_mm, np.array([4.0, 4.0]), csr_array(([length_mm], ([0], [1])), shape=(2, 2)))
    found = branch_ends(axis, np.ones(2, dtype=bool), np.array([0.0, length_mm]), 1.5, NONE)
    assert len(found) == ends
