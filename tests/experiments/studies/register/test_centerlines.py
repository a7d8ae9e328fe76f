"""Centerlines that are named, or found next to their surface, in its unit and axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tubes import tube

from experiments.errors import InputError
from experiments.studies.register.centerlines import (
    CenterlineSource,
    bends,
    centerline_candidates,
    centerline_of,
)
from registration.geometry.shapes import Centerline, Polyline
from registration.io.centerlines import write_centerline

POINTS = np.stack([np.linspace(0, 8, 40) ** 2 / 4, np.full(40, 5.0), np.linspace(0, 60, 40)], axis=1)
LINE = Centerline((Polyline(POINTS, np.full(40, 3.0)),))
SURFACE = tube(POINTS, 3.0)


def source(path: Path, unit: str | None = None, space: str = "lps") -> CenterlineSource:
    return CenterlineSource("moving", path, SURFACE, unit, space)


@pytest.mark.parametrize(
    "surface, line",
    [
        ("surface.ply", "centerline.csv"),
        ("surface.stl", "centerline.vtp"),
        ("cloud.ply", "centerline.csv"),
        ("aorta-surface.stl", "aorta-centerline.vtp"),
        ("iliac.ply", "iliac-centerline.csv"),
    ],
)
def test_the_one_beside_the_surface_is_found_by_its_name(tmp_path: Path, surface: str, line: str) -> None:
    assert centerline_of(source(tmp_path / surface), None) == (None, None)
    write_centerline(tmp_path / line, LINE)
    write_centerline(tmp_path / "other-centerline.csv", LINE)
    found, path = centerline_of(source(tmp_path / surface), None)
    assert path == tmp_path / line
    assert found is not None
    np.testing.assert_allclose(found.lines[0].points_mm, POINTS, atol=1e-5)
    assert centerline_of(source(tmp_path / surface), "none") == (None, None)


def test_one_that_lies_elsewhere_is_left_alone_unless_it_was_named(tmp_path: Path) -> None:
    away = Centerline((Polyline(POINTS + np.array([300.0, 0.0, 0.0]), LINE.lines[0].radius_mm),))
    write_centerline(tmp_path / "centerline.csv", away)
    assert centerline_of(source(tmp_path / "surface.ply"), None) == (None, None)
    with pytest.raises(
        InputError, match=r"moving_centerline: expected the centerline of .*one that lies elsewhere"
    ):
        centerline_of(source(tmp_path / "surface.ply"), str(tmp_path / "centerline.csv"))


@pytest.mark.parametrize("suffix", [".csv", ".vtp"])
def test_it_has_the_unit_and_the_axes_of_its_surface(tmp_path: Path, suffix: str) -> None:
    metres = Centerline((Polyline(POINTS * [-1e-3, -1e-3, 1e-3], LINE.lines[0].radius_mm / 1000),))
    write_centerline(tmp_path / f"line{suffix}", metres)
    found, _ = centerline_of(source(tmp_path / "a.ply", "m", "ras"), str(tmp_path / f"line{suffix}"))
    assert found is not None
    np.testing.assert_allclose(found.lines[0].points_mm, POINTS, atol=2e-3)
    np.testing.assert_allclose(found.lines[0].radius_mm, 3.0, atol=1e-3)


def test_files_that_are_no_centerline_are_refused_by_the_setting(tmp_path: Path) -> None:
    (tmp_path / "line.csv").write_text("x,y\n1,2\n")
    for given, message in (
        (tmp_path / "line.csv", "expected the columns line, x, y, z, radius_mm"),
        (tmp_path / "none.vtp", "expected a file, received nothing there"),
        (tmp_path / "line.obj", "expected a centerline as .vtp or .csv, received .obj"),
    ):
        with pytest.raises(InputError, match=f"moving_centerline: .*{message}"):
            centerline_of(source(tmp_path / "a.ply"), str(given))


def test_a_line_bends_or_it_does_not() -> None:
    assert bends(POINTS)
    assert not bends(np.outer(np.linspace(0, 60, 40), [0.3, -0.5, 0.8]) + 7.0)


def test_names_beside_nothing(tmp_path: Path) -> None:
    assert centerline_candidates(tmp_path / "surface.ply") == []
