"""Losses on the way: plain attenuation by its formula, contact by its width."""

from __future__ import annotations

import numpy as np
import pytest

from registration.phantom.acoustics import Artefacts, Scanner, Tissue
from registration.phantom.beams import Beams
from registration.phantom.transmission import (
    CONTACT_LOSS_DB,
    Contact,
    along_beams_db,
    draw_contact,
    ring_down,
)

BEAMS = Beams(Scanner())


def everywhere() -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.indices(BEAMS.shape)
    return rows.ravel(), columns.ravel()


def test_even_tissue_loses_what_is_not_compensated() -> None:
    tissue = Tissue(attenuation_db_cm_mhz=0.5, compensation_db_cm_mhz=0.3)
    places = everywhere()
    ones = np.ones(len(places[0]), dtype=np.float32)
    loss_db = along_beams_db(BEAMS, tissue, places, ones, ones)
    depth_mm = BEAMS.sample_depth_mm
    inner = (depth_mm > 3) & (depth_mm < 38)
    expected_db = 2 * 0.2 * 9.0 * depth_mm / 10
    np.testing.assert_allclose(loss_db[inner].mean(axis=1), expected_db[inner], atol=0.25)
    np.testing.assert_allclose(loss_db[inner].std(axis=1), 0.0, atol=1e-4)


def test_a_hard_cell_darkens_its_own_beam_below_only() -> None:
    rows, columns = everywhere()
    attenuation = np.ones(len(rows), dtype=np.float32)
    middle = BEAMS.shape[1] // 2
    row = int(np.argmin(np.abs(BEAMS.sample_depth_mm - 15)))
    hard = (np.abs(rows - row) < 8) & (np.abs(columns - middle) < 4)
    attenuation[hard] = 60.0
    loss_db = along_beams_db(BEAMS, Tissue(), (rows, columns), attenuation, np.ones_like(attenuation))
    side = middle + 40
    assert loss_db[row + 30, middle] > loss_db[row + 30, side] + 10
    assert loss_db[row - 20, middle] == pytest.approx(loss_db[row - 20, side], abs=0.01)


def test_contact_is_lost_at_the_ends_over_its_width() -> None:
    loss_db = Contact(np.array([[5.0, 0.0]])).loss_db(0, BEAMS)
    arc_mm, half_mm = BEAMS.beam_arc_mm, BEAMS.half_arc_mm
    assert loss_db[arc_mm < -half_mm + 2].min() > 0.95 * CONTACT_LOSS_DB
    assert loss_db[np.argmin(np.abs(arc_mm + half_mm - 5))] == pytest.approx(CONTACT_LOSS_DB / 2, rel=0.2)
    assert loss_db[np.abs(arc_mm) < 5].max() < 0.1
    assert not Contact(np.zeros((2, 2))).loss_db(1, BEAMS).any()


def test_contact_comes_and_goes_over_a_sweep_and_can_be_switched_off() -> None:
    lost_mm = draw_contact(200, Artefacts(contact_loss_mm=4.0), np.random.default_rng(3)).lost_mm
    assert lost_mm.shape == (200, 2)
    assert (lost_mm == 0).any()
    assert lost_mm.max() > 0.5
    assert np.abs(np.diff(lost_mm, axis=0)).max() < 0.6
    assert not draw_contact(50, Artefacts(contact_loss_mm=0.0), np.random.default_rng(3)).lost_mm.any()


def test_rings_repeat_at_their_distance_in_lost_beams_only() -> None:
    lost_db = np.zeros(BEAMS.shape[1], dtype=np.float32)
    lost_db[3] = CONTACT_LOSS_DB
    rings = ring_down(BEAMS, Artefacts(reverberation_mm=3.0), lost_db)
    assert not rings[:, 4:].any()
    course, depth_mm = rings[:, 3], BEAMS.sample_depth_mm
    peaks = depth_mm[1:-1][(course[1:-1] > course[:-2]) & (course[1:-1] >= course[2:]) & (course[1:-1] > 0.1)]
    np.testing.assert_allclose(np.diff(peaks[:3]), 3.0, atol=0.15)
