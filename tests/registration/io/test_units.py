"""Metres and centimetres suspected from a vessel's size, refused with a hint, and converted when said."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube
from vessels import bent_tube

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.io.units import suspected_unit, to_millimetres, typical_radius_mm

TUBE = tube(straight(60.0), 4.0, around=64)


def scaled(mesh: Mesh, scale: float) -> Mesh:
    return Mesh(scale * mesh.vertices_mm, mesh.triangles)


def test_the_typical_radius_of_an_open_tube_is_its_radius() -> None:
    assert typical_radius_mm(TUBE) == pytest.approx(4.0, rel=0.005)
    assert typical_radius_mm(scaled(TUBE, 0.01)) == pytest.approx(0.04, rel=0.005)


def test_millimetres_are_taken_as_they_are() -> None:
    assert to_millimetres(TUBE, None) is TUBE
    assert to_millimetres(TUBE, "mm").vertices_mm.tolist() == TUBE.vertices_mm.tolist()


@pytest.mark.parametrize("unit, scale", [("m", 0.001), ("cm", 0.1)])
@pytest.mark.parametrize("vessel", [TUBE, bent_tube()], ids=["open", "closed"])
def test_another_unit_is_refused_with_its_name_and_converted_when_said(
    vessel: Mesh, unit: str, scale: float
) -> None:
    given = scaled(vessel, scale)
    message = (
        f"model: expected a vessel in millimetres, .*looks like {unit}: pass units={unit} to convert it or"
    )
    with pytest.raises(InputError, match=message) as refusal:
        to_millimetres(given, None, "model")
    assert "\n" not in str(refusal.value)
    np.testing.assert_allclose(to_millimetres(given, unit).vertices_mm, vessel.vertices_mm)
    np.testing.assert_array_equal(to_millimetres(given, "mm").vertices_mm, given.vertices_mm)


@pytest.mark.parametrize(
    "diagonal, radius, unit",
    [
        (94.0, 5.8, "mm"),
        (0.094, 0.0058, "m"),
        (9.4, 0.58, "cm"),
        (400.0, 11.0, "mm"),
        (0.4, 0.011, "m"),
        (30.0, 0.25, "cm"),
        (5e4, 3e3, None),
        (1e-6, 1e-7, None),
        (5.0, 0.0, None),
    ],
)
def test_what_size_is_taken_for_what_unit(diagonal: float, radius: float, unit: str | None) -> None:
    assert suspected_unit(diagonal, radius) == unit


def test_a_size_that_is_no_vessels_in_any_unit_says_so() -> None:
    with pytest.raises(
        InputError, match="which is no vessel's size in mm, cm or m: pass units=mm to take it as it is"
    ):
        to_millimetres(scaled(TUBE, 1000.0), None)
    flat = Mesh(np.array([[0.0, 0, 0], [90, 0, 0], [0, 90, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="typical radius of 0, which is no vessel's size"):
        to_millimetres(flat, None)


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(InputError, match="units: expected one of mm, cm, m, received 'inch'"):
        to_millimetres(TUBE, "inch")
