"""An artery and a vein in one image: each pixel of a mask belongs to the right one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from experiments.datasets.vessel_pair import ARTERY, DISTRICTS, VEIN, PairSimulator, draw_pair, pair_anatomy
from experiments.errors import InputError
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.phantom.shapes import VesselLine

SETTINGS = PhantomSettings(
    subset="random", anatomy_seed=3, scanner=Scanner(height_px=96, width_px=96), motion=Motion(frames=3)
)


def rim_mm(line: VesselLine) -> np.ndarray:
    """Points on the wall in planes across the vessel's general direction."""
    points_mm, radius_mm, wide_mm = (
        values[::20] for values in (line.points_mm, line.radius_mm, line.radius_mm * line.widening)
    )
    angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    across = np.stack(
        [wide_mm[:, None] * np.cos(angle), radius_mm[:, None] * np.sin(angle), 0 * wide_mm[:, None] * angle],
        -1,
    )
    return (points_mm[:, None] + across).reshape(-1, 3)


@pytest.mark.parametrize("district", DISTRICTS)
def test_the_lumens_stay_a_millimetre_apart(district: str) -> None:
    for seed in range(25):
        artery, vein = (rim_mm(line) for line in draw_pair(district, seed))
        assert cKDTree(artery).query(vein)[0].min() > 1.0, seed


def test_sizes_and_place_are_those_of_the_district() -> None:
    for seed in range(10):
        for district, ranges in DISTRICTS.items():
            artery, vein = draw_pair(district, seed)
            low_mm, high_mm = ranges.artery_radius_mm
            assert 0.9 * low_mm < artery.radius_mm.min() and artery.radius_mm.max() < 1.1 * high_mm
            assert (vein.widening > 1.1).all() and (artery.widening == 1.0).all()
    first, second = draw_pair("carotid", 0)[0], draw_pair("carotid", 0)[0]
    np.testing.assert_array_equal(first.points_mm, second.points_mm)
    assert {bool(draw_pair("femoral", seed)[0].points_mm[0, 0] < 0) for seed in range(10)} == {True, False}


def test_labels_are_two_vessels_each_where_it_was_drawn() -> None:
    still = dataclasses.replace(SETTINGS, deformation=Deformation(bend_mm=0.0, pressure_mm=0.0))
    maker = PairSimulator(still, 0, "femoral")
    view = maker.view(1)
    picture, labels, _ = maker.frame(1, view)
    assert picture.shape == labels.shape == (96, 96) and set(np.unique(labels)) == {0, VEIN, ARTERY}
    artery, vein = draw_pair("femoral", 3)
    for label, line in ((ARTERY, artery), (VEIN, vein)):
        assert ndimage.label(labels == label)[1] == 1
        # Where the vessel's own line meets the image is inside its own label.
        image_mm = (line.points_mm - view.tissue_T_image[:3, 3]) @ view.tissue_T_image[:3, :3]
        across_mm, deep_mm, _ = image_mm[np.abs(image_mm[:, 2]).argmin()]
        columns_mm, rows_mm = maker.imager.beams.pixel_places_mm
        row = np.abs(rows_mm[:, 0] - deep_mm).argmin()
        column = np.abs(columns_mm[0] - across_mm).argmin()
        assert labels[row, column] == label


def test_labels_cover_the_surface_that_made_the_image() -> None:
    maker = PairSimulator(SETTINGS, 0, "femoral")
    for frame in range(2):
        view = maker.view(frame)
        _, labels, _ = maker.frame(frame, view)
        _, shown, _ = super(PairSimulator, maker).frame(frame, view)
        np.testing.assert_array_equal(labels > 0, shown)
    anatomy, of_artery = pair_anatomy("femoral", 3)
    assert 0 < of_artery.sum() < len(anatomy.surface.triangles)


def test_a_district_that_is_not_known_is_named() -> None:
    with pytest.raises(InputError, match="district: expected one of carotid, femoral, received 'arm'"):
        draw_pair("arm", 0)
