"""Pieces that continue a vessel are kept, on its axis and as wide; what lies beside it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hollow_bodies import capped, together
from tubes import straight, tube

from registration.centerline.extractor import CenterlineExtractor
from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.reconstruction.vessel_pieces import VesselPieces

WAY = np.array([2.0, 3.0, 6.0]) / 7
LINE = straight(60.0)
ACROSS = np.cross(WAY, [1.0, 0, 0]) / np.linalg.norm(np.cross(WAY, [1.0, 0, 0]))
FIRST = tube(LINE[:40], 3.0)


def bent(angle_deg: float, gap_mm: float, radius_mm: float = 3.0) -> Mesh:
    """A tube that goes on after a gap in which the vessel turns."""
    turn = np.deg2rad(angle_deg)
    way = np.cos(turn) * WAY + np.sin(turn) * ACROSS
    halfway = np.cos(turn / 2) * WAY + np.sin(turn / 2) * ACROSS
    return tube(LINE[39] + gap_mm * halfway + np.arange(0, 15, 0.8)[:, None] * way, radius_mm)


@pytest.mark.parametrize(
    "other, kept",
    [
        (tube(LINE[45:], 3.0), True),
        (tube(LINE[60:], 2.0), True),
        (tube(LINE[45:][::-1], 3.0), True),
        (bent(40.0, 8.0), True),
        # A branch that leaves the wall, its neck not seen.
        (tube(LINE[20] + np.arange(4.5, 16, 0.8)[:, None] * ACROSS, 1.5), True),
        # Beside the vessel, along it and across; too wide; too far; a speck; closed.
        (tube(LINE[:30] + 10 * ACROSS, 3.0), False),
        (tube(LINE[20] + np.arange(9, 20, 0.8)[:, None] * ACROSS, 1.5), False),
        (tube(LINE[45:], 12.0), False),
        (tube(LINE[45:] + 40 * WAY, 3.0), False),
        (tube(LINE[45:] + 12 * ACROSS, 3.0), False),
        (tube(LINE[45:47], 3.0), False),
        (capped(tube(LINE[45:], 3.0)), False),
    ],
)
def test_a_second_piece(other: Mesh, kept: bool) -> None:
    largest, smaller = sorted((FIRST, other), key=lambda mesh: -mesh.areas_mm2.sum())
    found = VesselPieces()(together(FIRST, other))
    assert found.kept == 1 + kept
    assert found.dropped == 1 - kept
    area_mm2 = largest.areas_mm2.sum() + kept * smaller.areas_mm2.sum()
    assert found.area_mm2 == pytest.approx(area_mm2)
    assert found.mesh.areas_mm2.sum() == pytest.approx(area_mm2)
    whole_mm2 = FIRST.areas_mm2.sum() + other.areas_mm2.sum()
    assert found.share_dropped == pytest.approx(1 - area_mm2 / whole_mm2)


@pytest.mark.parametrize(("gap_mm", "kept"), [(1.5, 2), (6.0, 1)])
def test_a_branch_that_begins_outside_the_box_of_its_trunk_is_kept_where_it_is_near(
    gap_mm: float, kept: int
) -> None:
    upright = np.column_stack([np.zeros(50), np.zeros(50), np.arange(50) * 0.8])
    away_mm = 3.0 + gap_mm + np.arange(0, 12, 0.8)
    branch = np.column_stack([away_mm, np.zeros(len(away_mm)), np.full(len(away_mm), 20.0)])
    assert VesselPieces()(together(tube(upright, 3.0), tube(branch, 1.5))).kept == kept


def test_pieces_join_one_after_another_and_each_has_its_line() -> None:
    mesh = together(tube(LINE[:22], 3.0), tube(LINE[30:48], 3.0), tube(LINE[55:], 3.0))
    found = VesselPieces()(mesh)
    assert (found.kept, found.dropped) == (3, 0)
    lines = CenterlineExtractor()(mesh).lines
    assert len(lines) == 3
    assert sorted(round(line.length_mm, 1) for line in lines) == pytest.approx([13.6, 16.0, 16.8], abs=0.3)
    for line in lines:
        away_mm = line.points_mm - LINE[0]
        assert np.linalg.norm(away_mm - (away_mm @ WAY)[:, None] * WAY, axis=1).max() < 0.1


def test_one_piece_is_returned_as_it_is() -> None:
    assert VesselPieces()(FIRST).mesh is FIRST
    with pytest.raises(InputError, match="gap_radii"):
        VesselPieces(gap_radii=0.0)
