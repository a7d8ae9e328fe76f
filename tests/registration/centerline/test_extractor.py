"""Centerlines of shapes whose middle is known, and of VMTK's aorta."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tubes import helix, straight, tube

from registration.centerline import extractor
from registration.centerline.extractor import CenterlineExtractor
from registration.centerline.medial_axis import medial_axis
from registration.errors import InputError
from registration.geometry.mesh_topology import borders, keep_triangles, with_caps
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.surfaces import read_centerline, read_surface
from registration.metrics.surface_distance import SurfaceDistance
from registration.phantom.shapes import spline_line, surround
from registration.reconstruction.open_ends import vertex_normals
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.vessel_pieces import VesselPieces


def dense(points_mm: np.ndarray, step_mm: float = 0.02) -> np.ndarray:
    line = Polyline(points_mm, np.zeros(len(points_mm)))
    return line.at(np.arange(0.0, line.length_mm, step_mm))


def apart_mm(line: Polyline, truth_mm: np.ndarray) -> np.ndarray:
    return cKDTree(dense(truth_mm)).query(dense(line.points_mm, 0.1))[0]


@pytest.mark.parametrize(
    "line_mm, radius_mm, rings",
    [(straight(), 4.0, 1), (straight(), 4.0, 6), (helix(), 4.0, 1), (helix(8.0, 20.0, 1.0, 120), 3.0, 1)],
)
def test_open_tubes_to_two_percent_of_the_radius(line_mm: np.ndarray, radius_mm: float, rings: int) -> None:
    (line,) = CenterlineExtractor()(tube(line_mm[::rings], radius_mm)).lines
    assert apart_mm(line, line_mm).mean() < 0.02 * radius_mm
    # 32 sides touch the inscribed circle at cos(pi / 32) of the radius.
    np.testing.assert_allclose(line.radius_mm, radius_mm, rtol=0.02)
    assert line.length_mm == pytest.approx(
        Polyline(line_mm[::rings], line_mm[::rings, 0] * 0).length_mm, rel=0.01
    )


def test_a_taper_starts_at_the_wide_end() -> None:
    line_mm = straight()
    radius_mm = np.linspace(2.0, 5.0, len(line_mm))
    (line,) = CenterlineExtractor()(tube(line_mm, radius_mm)).lines
    np.testing.assert_allclose(line.points_mm[[0, -1]], line_mm[[-1, 0]], atol=0.1)
    assert np.abs(line.radius_mm[[0, -1]] - [5, 2]).max() < 0.1


@pytest.fixture(scope="module")
def fork() -> tuple[Mesh, np.ndarray]:
    joint = np.array([0.0, 0, 30])
    ends = [joint + 30 * np.array([side * np.sin(0.5), 0, np.cos(0.5)]) for side in (1, -1)]
    lines = (
        spline_line(np.array([[0.0, 0, 0], joint]), np.array([4.0, 4.0])),
        *(spline_line(np.array([joint, end]), np.array([3.0, 3.0])) for end in ends),
    )
    domes = [np.linspace([0.0, 0, -4], [0, 0, 0], 200)]
    domes += [np.linspace(end, end + 3 * (end - joint) / 30, 200) for end in ends]
    truth_mm = np.concatenate([*(line.points_mm for line in lines), *domes])
    return surround(lines, pitch_mm=0.6, blend_mm=0.0), truth_mm


def test_a_fork_gives_two_lines_on_one_trunk(fork: tuple[Mesh, np.ndarray]) -> None:
    mesh, truth_mm = fork
    lines = CenterlineExtractor()(mesh).lines
    assert len(lines) == 2
    for line in lines:
        assert cKDTree(truth_mm).query(dense(line.points_mm, 0.1))[0].mean() < 0.02 * 3
        # From the tip of one half sphere, over 60 mm between their centres, to that of the other.
        np.testing.assert_allclose(line.points_mm[0], [0, 0, -4], atol=0.3)
        assert line.length_mm == pytest.approx(4 + 60 + 3, rel=0.01)
    shared = (lines[0].points_mm[:20, None] == lines[1].points_mm[None, :20]).all(axis=2).any(axis=1)
    assert shared.all()


def test_ends_may_be_given(fork: tuple[Mesh, np.ndarray]) -> None:
    mesh, truth_mm = fork
    given_mm = truth_mm[[200, 450]]
    (line,) = CenterlineExtractor()(mesh, given_mm).lines
    np.testing.assert_allclose(line.points_mm[[0, -1]], given_mm, atol=0.3)
    with pytest.raises(InputError, match="ends_mm: expected at least two points inside"):
        CenterlineExtractor()(mesh, np.array([[0.0, 0, 10], [50, 0, 0]]))


def noisy(mesh: Mesh) -> Mesh:
    shift_mm = np.random.default_rng(0).normal(0, 0.5, mesh.vertices_mm.shape)
    return Mesh(mesh.vertices_mm + shift_mm, mesh.triangles)


@pytest.mark.parametrize("line_mm", [straight(), helix()])
def test_noise_of_half_a_millimetre_on_tubes(line_mm: np.ndarray) -> None:
    (line,) = CenterlineExtractor()(noisy(tube(line_mm, 4.0))).lines
    beside_mm = apart_mm(line, line_mm)
    assert beside_mm.mean() < 0.15
    assert np.percentile(beside_mm, 95) < 0.3
    assert np.abs(line.radius_mm - 4).mean() < 0.25
    assert line.length_mm == pytest.approx(Polyline(line_mm, line_mm[:, 0] * 0).length_mm, rel=0.01)


def test_noise_of_half_a_millimetre_on_a_fork(fork: tuple[Mesh, np.ndarray]) -> None:
    mesh, truth_mm = fork
    lines = CenterlineExtractor()(noisy(mesh)).lines
    assert len(lines) == 2
    for line in lines:
        assert cKDTree(truth_mm).query(dense(line.points_mm, 0.1))[0].mean() < 0.15
        assert line.length_mm == pytest.approx(4 + 60 + 3, rel=0.015)


def test_a_capped_tube_has_the_line_of_the_open_one() -> None:
    mesh = tube(straight(), 4.0)
    (opened,) = CenterlineExtractor()(mesh).lines
    (capped,) = CenterlineExtractor()(with_caps(mesh, borders(mesh), 6)).lines
    assert capped.length_mm == pytest.approx(40.0, abs=0.02)
    assert apart_mm(capped, opened.points_mm).max() < 0.05
    np.testing.assert_allclose(capped.radius_mm, opened.radius_mm.mean(), atol=0.02)


def test_a_flat_open_vessel_has_one_line_through_its_middle() -> None:
    round_tube = tube(np.array([[0.0, 0, z] for z in np.arange(0, 48, 0.8)]), 1.0, around=48)
    (line,) = CenterlineExtractor()(Mesh(round_tube.vertices_mm * [6, 2, 1], round_tube.triangles)).lines
    assert np.hypot(line.points_mm[:, 0], line.points_mm[:, 1]).mean() < 0.05 * 6
    assert line.length_mm == pytest.approx(47.2, rel=0.01)


def test_blobs_on_a_wall_and_beside_it_are_no_branches() -> None:
    trunk = spline_line(np.array([[0.0, 0, 0], [0, 0, 50]]), np.array([4.0, 4.0]))
    blobs = [
        spline_line(np.array([[0, 5.0, z], [0, 5.0 + reach, z]]), np.array([2.0, 2.0]))
        for z, reach in ((12, 0.2), (38, 1.0))
    ]
    wall = surround((trunk, *blobs), pitch_mm=0.6, blend_mm=0.0)
    alone = surround(
        (spline_line(np.array([[20.0, 0, 5], [20, 0, 25]]), np.array([2.0, 2.0])),), pitch_mm=0.6
    )
    both = Mesh(
        np.concatenate([wall.vertices_mm, alone.vertices_mm]),
        np.concatenate([wall.triangles, alone.triangles + len(wall.vertices_mm)]),
    )
    (line,) = CenterlineExtractor()(both).lines
    assert line.length_mm == pytest.approx(58, rel=0.02)
    # A tube that reaches 15 mm out of the trunk's middle is one.
    side = spline_line(np.array([[0.0, 0, 25], [0, 15, 25]]), np.array([2.0, 2.0]))
    assert len(CenterlineExtractor()(surround((trunk, side), pitch_mm=0.6, blend_mm=0.0)).lines) == 2


def test_a_small_piece_is_sampled_no_finer_than_its_triangles_and_the_vessel_as_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    vessel, small = tube(straight(), 3.0), tube(straight(10.0), 0.1, around=4)
    sizes_mm = []

    def recorded(wall: Mesh, walls: Any, size_mm: float) -> Any:
        sizes_mm.append(size_mm)
        return medial_axis(wall, walls, size_mm)

    monkeypatch.setattr(extractor, "medial_axis", recorded)
    monkeypatch.setattr(VesselPieces, "parts", lambda self, mesh: [vessel, small])
    found = CenterlineExtractor()(vessel)
    # Twice the volume over the area of a capped tube, and the side of a square in a circle of 0.1 mm.
    assert sizes_mm[0] == pytest.approx(3.0 * 40 / 43, rel=0.02)
    assert sizes_mm[1] == pytest.approx(0.1 * np.sqrt(2))
    assert len(found.lines) == 2
    np.testing.assert_array_equal(
        found.lines[0].points_mm, CenterlineExtractor()._lines(vessel, None)[0].points_mm
    )


def test_a_hole_of_a_fifth_of_the_circumference() -> None:
    line_mm = straight()
    whole = tube(line_mm, 4.0, around=64)
    middle_mm = whole.corners_mm.mean(axis=1)
    hole = np.linalg.norm(middle_mm - middle_mm[len(middle_mm) // 4], axis=1) < 0.2 * np.pi * 4.0
    (line,) = CenterlineExtractor()(keep_triangles(whole, ~hole)).lines
    assert apart_mm(line, line_mm).mean() < 0.02 * 4
    assert line.length_mm == pytest.approx(40, rel=0.01)


def test_holes_in_the_wall_change_little() -> None:
    line_mm = helix()
    whole = tube(line_mm, 4.0)
    middle_mm = whole.corners_mm.mean(axis=1)
    holes = np.zeros(len(middle_mm), dtype=bool)
    for centre in (700, 2500, 5200):
        holes |= np.linalg.norm(middle_mm - middle_mm[centre], axis=1) < 2.0
    (line,) = CenterlineExtractor()(keep_triangles(whole, ~holes)).lines
    assert apart_mm(line, line_mm).mean() < 0.02 * 4


def test_a_noisy_cloud_with_missing_frames() -> None:
    line_mm = helix()
    exact = tube(line_mm, 4.0, around=64)
    rng = np.random.default_rng(0)
    ring = np.repeat(np.arange(len(line_mm)), 64)
    kept = np.isin(ring, rng.permutation(len(line_mm))[: int(0.7 * len(line_mm))])
    cloud = OrientedCloud(
        (exact.vertices_mm + rng.normal(0, 0.5, exact.vertices_mm.shape))[kept], vertex_normals(exact)[kept]
    )
    extract = CenterlineExtractor(reconstruct=PoissonSurface(cell_mm=1.2, bridge_mm=5.0))
    (line,) = extract(cloud).lines
    assert apart_mm(line, line_mm).mean() < 0.15
    assert np.abs(line.radius_mm - 4).mean() < 0.2
    with pytest.raises(InputError, match="surface: expected a mesh, or a cloud and a method"):
        CenterlineExtractor()(cloud)


def test_bad_settings_and_surfaces_without_an_inside() -> None:
    for setting in (
        {"branch_reach": 0.5},
        {"step_radii": 0.0},
        {"smoothing_radii": -1.0},
        {"rough_radii": 0.0},
    ):
        with pytest.raises(InputError, match=next(iter(setting))):
            CenterlineExtractor(**setting)
    flat = Mesh(np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(InputError, match="surface: expected"):
        CenterlineExtractor()(flat)


def beside_vmtk(found: Centerline, reference: Centerline) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """For each reference line: distances, differences of radius, and length as a share, where both run."""
    result = []
    for theirs in reference.lines:
        ours = min(found.lines, key=lambda line: np.linalg.norm(line.points_mm[-1] - theirs.points_mm[-1]))
        place_mm = np.arange(0.0, theirs.length_mm, 0.05)
        own_mm = np.arange(0.0, ours.length_mm, 0.1)
        beside_mm, nearest = cKDTree(theirs.at(place_mm)).query(ours.at(own_mm))
        both = (nearest > 0) & (nearest < len(place_mm) - 1)
        radius_mm = np.interp(own_mm, ours.arc_mm, ours.radius_mm)
        theirs_mm = np.interp(place_mm, theirs.arc_mm, theirs.radius_mm)[nearest]
        result.append(
            (beside_mm[both], np.abs(radius_mm - theirs_mm)[both], ours.length_mm / theirs.length_mm)
        )
    return result


def test_the_aorta_between_the_ends_that_vmtk_had(real_data: Path) -> None:
    reference = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    source_mm = reference.lines[0].points_mm[:1]
    ends_mm = np.concatenate([source_mm, [line.points_mm[-1] for line in reference.lines]])
    surface = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    for beside_mm, radius_mm, length in beside_vmtk(CenterlineExtractor()(surface, ends_mm), reference):
        assert beside_mm.mean() <= 0.15
        assert np.percentile(beside_mm, 95) <= 0.4
        assert radius_mm.mean() <= 0.1
        assert length == pytest.approx(1.0, abs=0.015)


def test_the_aorta_with_open_ends_on_its_own(real_data: Path) -> None:
    reference = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    found = CenterlineExtractor()(read_surface(real_data / "vmtk" / "aorta-surface-open-ends.stl"))
    assert len(found.lines) == 2
    for beside_mm, radius_mm, length in beside_vmtk(found, reference):
        assert beside_mm.mean() <= 0.15
        assert np.percentile(beside_mm, 95) <= 0.4
        assert radius_mm.mean() <= 0.1
        # VMTK's line stops up to 2.3 mm before the open ends.
        assert 1.0 < length < 1.03


def test_the_aorta_with_closed_ends_from_cap_to_cap(real_data: Path) -> None:
    reference = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    surface = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    assert isinstance(surface, Mesh)
    found = CenterlineExtractor()(surface)
    assert len(found.lines) == 2
    for beside_mm, radius_mm, _ in beside_vmtk(found, reference):
        assert beside_mm.mean() <= 0.15
        assert np.percentile(beside_mm, 95) <= 0.4
        assert radius_mm.mean() <= 0.1
    caps = SurfaceDistance(surface)
    for line in found.lines:
        np.testing.assert_allclose(caps(line.points_mm[[0, -1]]), 0.0, atol=0.01)
    # What VMTK's first points lack to the caps, straight on: 5.4 mm at the trunk, 3.5 and 2.8 mm at the branches.
    lacking_mm = sorted(
        line.length_mm - theirs.length_mm
        for line, theirs in zip(
            sorted(found.lines, key=lambda line: line.length_mm),
            sorted(reference.lines, key=lambda line: line.length_mm),
            strict=True,
        )
    )
    np.testing.assert_allclose(lacking_mm, [5.4 + 2.8, 5.4 + 3.5], atol=0.015 * 78)


def test_the_aorta_with_noise_of_half_a_millimetre(real_data: Path) -> None:
    reference = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    surface = read_surface(real_data / "vmtk" / "aorta-surface-open-ends.stl")
    assert isinstance(surface, Mesh)
    found = CenterlineExtractor()(noisy(surface))
    assert len(found.lines) == 2
    for beside_mm, radius_mm, length in beside_vmtk(found, reference):
        assert beside_mm.mean() <= 0.25
        assert np.percentile(beside_mm, 95) <= 0.6
        assert radius_mm.mean() <= 0.15
        assert 1.0 < length < 1.03
