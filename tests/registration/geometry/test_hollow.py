"""The lumen of a hollow body is found however its walls are joined; a vessel with one wall is left as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hollow_bodies import capped, hollow, nearest, ring, rod, together, zero_surface
from scipy.spatial import cKDTree
from tubes import helix, straight, tube

from registration.centerline.extractor import CenterlineExtractor
from registration.errors import InputError
from registration.geometry.hollow import find_lumen, genus, vessel_surface
from registration.geometry.mesh_repair import repair
from registration.geometry.mesh_topology import borders
from registration.geometry.shapes import Mesh, Polyline
from registration.metrics.surface_distance import SurfaceDistance

LINE = straight(40.0)
BEND = np.array([[15 * np.cos(a), 15 * np.sin(a), 0] for a in np.linspace(0, 1.2 * np.pi, 120)])


def axis_apart_mm(found_mm: np.ndarray, line_mm: np.ndarray) -> np.ndarray:
    """Distance of points to a line given by many."""
    line = Polyline(line_mm, np.zeros(len(line_mm)))
    return cKDTree(line.at(np.arange(0.0, line.length_mm, 0.02))).query(found_mm)[0]


def test_the_genus_counts_holes_through_a_body() -> None:
    assert genus(tube(LINE, 4.0)) == 0
    assert genus(capped(tube(LINE, 4.0))) == 0
    assert genus(hollow(LINE, 6.0, 4.0)) == 1
    assert genus(ring(20.0, 4.0)) == 1


@pytest.mark.parametrize(
    "line_mm, outer_mm, inner_mm, ends, handles",
    [
        (LINE, 6.0, 4.0, ("joined", "joined"), 1),
        (LINE, 4.4, 4.0, ("joined", "joined"), 1),
        (LINE, 12.0, 3.0, ("joined", "joined"), 1),
        # As CAD programs write it: triangles from end to end.
        (LINE[[0, -1]], 6.0, 4.0, ("joined", "joined"), 1),
        (helix(turns=0.8, points=80), 5.5, 4.0, ("joined", "joined"), 1),
        (BEND, 6.0, 4.0, ("joined", "joined"), 1),
        (LINE, 6.0, 4.0, ("joined", "open"), 0),
        (LINE, 6.0, 4.0, ("closed", "joined"), 0),
        (LINE, 6.0, 4.0, ("open", "open"), 0),
        (LINE, 6.0, 4.0, ("closed", "closed"), 0),
    ],
)
def test_the_centerline_of_a_hollow_tube_is_that_of_its_lumen(
    line_mm: np.ndarray, outer_mm: float, inner_mm: float, ends: tuple[str, str], handles: int
) -> None:
    body = hollow(line_mm, outer_mm, inner_mm, ends)
    lumen = find_lumen(body)
    assert lumen is not None
    assert lumen.genus == handles
    assert lumen.joined == ("joined" in ends)
    (line,) = CenterlineExtractor()(body).lines
    # The last points come from the mouth's border, which follows whole triangles.
    apart_mm = axis_apart_mm(line.points_mm, line_mm)
    assert apart_mm[3:-3].max() < 0.03 * inner_mm
    assert apart_mm.max() < 0.15 * inner_mm
    # 32 sides touch the inscribed circle at cos(pi / 32) of the radius.
    assert np.median(line.radius_mm) == pytest.approx(inner_mm, rel=0.01)
    length_mm = np.linalg.norm(np.diff(line_mm, axis=0), axis=1).sum()
    assert line.length_mm == pytest.approx(length_mm, rel=0.01)


def test_a_body_wound_inwards_or_unevenly_has_the_same_lumen() -> None:
    body = hollow(LINE, 6.0, 4.0)
    turned = Mesh(body.vertices_mm, np.ascontiguousarray(body.triangles[:, ::-1]))
    rng = np.random.default_rng(0)
    mixed = body.triangles.copy()
    some = rng.random(len(mixed)) < 0.3
    mixed[some] = mixed[some][:, ::-1]
    wanted = vessel_surface(body)
    for mesh in (vessel_surface(turned), repair(Mesh(body.vertices_mm, mixed)).mesh):
        assert SurfaceDistance(wanted)(mesh.vertices_mm).max() < 1e-9
        assert len(mesh.triangles) == len(wanted.triangles)


def test_a_rough_hollow_tube_has_its_lumen() -> None:
    body = hollow(straight(40.0, 1.0), 6.0, 4.0)
    shift_mm = np.random.default_rng(0).normal(0, 0.15, body.vertices_mm.shape)
    (line,) = CenterlineExtractor()(Mesh(body.vertices_mm + shift_mm, body.triangles)).lines
    assert axis_apart_mm(line.points_mm, LINE).max() < 0.5
    assert np.median(line.radius_mm) == pytest.approx(4.0, abs=0.3)


def hollow_fork() -> Mesh:
    joint = [0, 0, 30]
    middle = nearest(rod([0, 0, -10], joint), rod(joint, [20, 0, 70]), rod(joint, [-20, 0, 70]))

    def wall(points_mm: np.ndarray) -> np.ndarray:
        apart_mm, height_mm = middle(points_mm), points_mm[:, 2]
        return np.maximum.reduce([apart_mm - 6, 3.5 - apart_mm, -height_mm, height_mm - 60])

    return zero_surface(wall, (-27, -8, -2), (27, 8, 62), 1.0)


def test_a_hollow_fork_of_genus_two_has_two_lines_in_its_lumen() -> None:
    body = hollow_fork()
    assert genus(body) == 2
    lines = CenterlineExtractor()(body).lines
    assert len(lines) == 2
    middle = nearest(
        rod([0, 0, -10], [0, 0, 30]), rod([0, 0, 30], [20, 0, 70]), rod([0, 0, 30], [-20, 0, 70])
    )
    for line in lines:
        apart_mm = middle(line.points_mm)
        # At the joint the largest sphere lies between the branches.
        assert np.median(apart_mm) < 0.1
        assert np.percentile(apart_mm, 80) < 0.5
        assert (apart_mm < 3.5).all()
        assert np.median(line.radius_mm) == pytest.approx(3.5, abs=0.15)


def test_a_channel_through_a_block_is_its_lumen() -> None:
    def block(points_mm: np.ndarray) -> np.ndarray:
        outside_mm = (np.abs(points_mm) - [15, 15, 30]).max(axis=1)
        return np.maximum(outside_mm, 4 - np.hypot(points_mm[:, 0], points_mm[:, 1]))

    (line,) = CenterlineExtractor()(zero_surface(block, (-17.3, -17.3, -32.3), (18, 18, 33), 1.0)).lines
    apart_mm = np.hypot(line.points_mm[:, 0], line.points_mm[:, 1])
    assert apart_mm[3:-3].max() < 0.1
    assert apart_mm.max() < 0.6
    assert line.length_mm == pytest.approx(60.0, abs=2.0)
    assert np.median(line.radius_mm) == pytest.approx(4.0, abs=0.15)


@pytest.mark.parametrize(
    "make",
    [
        lambda: tube(LINE, 4.0),
        lambda: capped(tube(LINE, 4.0)),
        lambda: tube(helix(8.0, 20.0, 1.0, 120), 3.0),
        lambda: tube(BEND, 4.0),
        lambda: ring(20.0, 4.0),
        lambda: ring(6.0, 4.0),
        # A bubble in a vessel is no lumen, nor is a tube beside one.
        lambda: together(capped(tube(LINE, 4.0)), capped(tube(LINE[20:27], 2.0))),
        lambda: together(capped(tube(LINE, 4.0)), capped(tube(LINE + 20.0, 3.0))),
    ],
)
def test_vessels_with_one_wall_are_left_alone(make: Callable[[], Mesh]) -> None:
    assert find_lumen(make()) is None


def test_loops_are_refused_unless_their_ends_are_given() -> None:
    loop = ring(20.0, 4.0)
    with pytest.raises(
        InputError, match=r"branches like a tree, received one that closes to a loop at .*genus 1"
    ):
        CenterlineExtractor()(loop)
    with pytest.raises(InputError, match="closes to a loop"):
        CenterlineExtractor()(together(ring(20.0, 6.0), loop))
    angle = np.linspace(0.3, 2.0, 200)
    truth_mm = np.stack([20 * np.cos(angle), 20 * np.sin(angle), 0 * angle], axis=1)
    (line,) = CenterlineExtractor()(loop, truth_mm[[0, -1]]).lines
    assert axis_apart_mm(line.points_mm, truth_mm).max() < 0.3


def test_a_vessel_that_parts_and_joins_again_is_refused_with_the_place() -> None:
    ways = [rod([0, 0, 0], [0, 0, 30]), rod([0, 0, 70], [0, 0, 100])]
    for side in (10, -10):
        ways += [rod([0, 0, 30], [side, 0, 50]), rod([side, 0, 50], [0, 0, 70])]
    field = nearest(*ways)
    vessel = zero_surface(lambda points_mm: field(points_mm) - 4, (-16, -6, -6), (16, 6, 106), 1.2)
    with pytest.raises(InputError, match=r"closes to a loop at .*genus 1"):
        CenterlineExtractor()(vessel)


def test_what_may_or_may_not_be_a_lumen_is_refused() -> None:
    half = together(capped(tube(LINE, 6.0)), capped(tube(LINE[:31], 4.0)))
    with pytest.raises(
        InputError, match=r"received a cavity or hole 2[0-9]\.?[0-9]* mm long and .* mm wide in a body 40 mm"
    ):
        find_lumen(half)
    side = np.array([0.0, 0, 4.5])
    two = together(
        capped(tube(LINE, 12.0)), *(capped(tube(LINE[3:-3] + move, 2.0)) for move in (side, -side))
    )
    with pytest.raises(InputError, match="expected one lumen in a hollow body, received 2 cavities"):
        find_lumen(two)


def test_a_sphere_count_too_large_is_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    from registration.centerline import medial_axis
    from registration.centerline.vessel_walls import Walls

    mesh = tube(LINE, 4.0)
    walls = Walls(mesh, capped(mesh))
    assert len(borders(mesh)) == 2
    many = len(medial_axis.medial_axis(mesh, walls, 4.0).radius_mm)
    monkeypatch.setattr(medial_axis, "MAX_SPHERES", many // 3)
    few = medial_axis.medial_axis(mesh, walls, 4.0)
    assert 0.05 * many < len(few.radius_mm) <= many // 3
