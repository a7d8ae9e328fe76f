"""Anatomies: designed, drawn at random, and a user's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.phantom.anatomy import anatomy_of, from_lines, from_mesh, is_closed
from registration.phantom.random_anatomy import draw_lines
from registration.phantom.settings import PhantomSettings
from registration.phantom.shapes import signed_volume_mm3, spline_line, surround


def test_skin_must_lie_in_front_of_the_vessel() -> None:
    line = spline_line(np.array([[0.0, 0, -10], [0, 0, 10]]), np.full(2, 4.0))
    with pytest.raises(InputError, match="skin_y_mm"):
        from_lines((line,), -3.0)


def test_centerline_lies_in_the_vessel_at_its_radius() -> None:
    anatomy = anatomy_of(PhantomSettings(subset="vein"))
    assert anatomy.centerline is not None
    main = anatomy.centerline.lines[0]
    inner = slice(40, -40)
    depth_mm = -anatomy.distance.at(main.points_mm[inner])
    # Distances are capped at far_mm.
    assert (depth_mm > np.minimum(main.radius_mm[inner], anatomy.distance.far_mm) - 0.1).all()


@pytest.mark.parametrize("seed", [0, 1, 5, 17, 1003])
def test_random_anatomies_are_closed_lie_under_the_skin_and_repeat(seed: int) -> None:
    anatomy = anatomy_of(PhantomSettings(subset="random", anatomy_seed=seed))
    assert is_closed(anatomy.surface)
    assert signed_volume_mm3(anatomy.surface) > 300
    assert anatomy.surface.vertices_mm[:, 1].min() > anatomy.skin_y_mm + 2
    assert anatomy.surface.vertices_mm[:, 1].max() < anatomy.skin_y_mm + 40
    for one, other in zip(draw_lines(seed), draw_lines(seed), strict=True):
        np.testing.assert_array_equal(one.points_mm, other.points_mm)


def test_random_anatomies_vary_in_all_they_should() -> None:
    family = [draw_lines(seed) for seed in range(60)]
    radii_mm = [float(np.median(lines[0].radius_mm)) for lines in family]
    assert min(radii_mm) < 2.7
    assert max(radii_mm) > 4.4
    assert {len(lines) for lines in family} == {1, 2, 3}
    narrowest = [lines[0].radius_mm.min() / np.median(lines[0].radius_mm) for lines in family]
    assert 0.2 < np.mean(np.array(narrowest) < 0.75) < 0.8
    bends_mm = [np.ptp(lines[0].points_mm[:, 0]) for lines in family]
    assert max(bends_mm) > 3 * min(bends_mm)


def test_mesh_is_laid_along_the_sweep_and_back_exactly(tmp_path: Path) -> None:
    import open3d as o3d

    line = spline_line(np.array([[0.0, 0, -30], [4, 1, 0], [0, 0, 30]]), np.full(3, 4.0), 1.4)
    ct_T_own = transforms.from_rotation(
        Rotation.from_euler("xyz", (70, 20, 130), degrees=True), np.array([200.0, -90.0, 40.0])
    )
    surface = surround((line,))
    there = Mesh(transforms.apply(ct_T_own, surface.vertices_mm), surface.triangles)
    path = tmp_path / "vessel.ply"
    o3d.io.write_triangle_mesh(
        str(path),
        o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(there.vertices_mm), o3d.utility.Vector3iVector(there.triangles)
        ),
    )
    anatomy = from_mesh(path)
    size_mm = np.ptp(anatomy.surface.vertices_mm, axis=0)
    assert size_mm[2] > size_mm[0] > size_mm[1]
    back_mm = transforms.apply(anatomy.ct_T_bed, anatomy.surface.vertices_mm)
    np.testing.assert_allclose(np.sort(back_mm, axis=0), np.sort(there.vertices_mm, axis=0), atol=1e-4)


def test_open_surfaces_are_told_from_closed_ones() -> None:
    line = spline_line(np.array([[0.0, 0, -5], [0, 0, 5]]), np.full(2, 3.0))
    mesh = surround((line,), pitch_mm=0.8)
    assert is_closed(mesh)
    assert not is_closed(Mesh(mesh.vertices_mm, mesh.triangles[1:]))
    turned = mesh.triangles.copy()
    turned[0] = turned[0, ::-1]
    assert not is_closed(Mesh(mesh.vertices_mm, turned))
