"""Meshes as programs write them, made ready: each repair on a mesh that was broken in a known way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tubes import straight, tube
from vessels import bent_tube

from registration.errors import InputError
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.mesh_repair import repair
from registration.geometry.shapes import Mesh
from registration.io.surfaces import read_surface

TUBE = bent_tube()


def same_surface(found: Mesh, expected: Mesh) -> None:
    """The same triangles, wound the same way, in any order."""

    def canonical(mesh: Mesh) -> list[list[float]]:
        corners = mesh.corners_mm.round(6)
        first = np.lexsort(np.moveaxis(corners, 2, 0)[::-1], axis=1)[:, 0]
        turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3]
        return sorted(turned.reshape(-1, 9).tolist())

    assert canonical(found) == canonical(expected)


def test_a_sound_mesh_stays_as_it_is() -> None:
    done = repair(TUBE)
    same_surface(done.mesh, TUBE)
    counts = (done.vertices_merged, done.triangles_dropped, done.triangles_turned, done.pieces_dropped)
    assert counts == (0, 0, 0, 0)
    assert done.area_dropped_mm2 == 0


def test_corners_of_their_own_become_shared() -> None:
    loose = Mesh(TUBE.corners_mm.reshape(-1, 3), np.arange(3 * len(TUBE.triangles)).reshape(-1, 3))
    done = repair(loose)
    same_surface(done.mesh, TUBE)
    assert done.vertices_merged == 3 * len(TUBE.triangles) - len(TUBE.vertices_mm)
    assert mesh_quality(done.mesh).watertight


@pytest.mark.parametrize("shape", [TUBE, tube(straight(), 3.0)], ids=["closed", "open"])
def test_triangles_wound_the_other_way_are_turned_over(shape: Mesh) -> None:
    for share in (0.0, 0.3, 1.0):
        odd = np.random.default_rng(0).random(len(shape.triangles)) < share
        done = repair(
            Mesh(shape.vertices_mm, np.where(odd[:, None], shape.triangles[:, ::-1], shape.triangles))
        )
        same_surface(done.mesh, shape)
        assert done.triangles_turned == odd.sum()


def test_empty_and_double_triangles_are_dropped() -> None:
    first = TUBE.triangles[0]
    extra = np.array([first, first[[1, 2, 0]], first[::-1], [first[0], first[0], first[1]]])
    done = repair(Mesh(TUBE.vertices_mm, np.concatenate([TUBE.triangles, extra])))
    same_surface(done.mesh, TUBE)
    assert done.triangles_dropped == 4


def test_the_largest_piece_is_kept() -> None:
    small = tube(straight(8.0), 1.0)
    both = Mesh(
        np.concatenate([small.vertices_mm - 300.0, TUBE.vertices_mm]),
        np.concatenate([small.triangles, TUBE.triangles + len(small.vertices_mm)]),
    )
    done = repair(both)
    same_surface(done.mesh, TUBE)
    assert done.pieces_dropped == 1
    assert done.area_dropped_mm2 == pytest.approx(small.areas_mm2.sum())


def test_a_mesh_without_area_is_refused() -> None:
    with pytest.raises(InputError, match="mesh: expected triangles with area, received none"):
        repair(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]])))


def test_the_real_aorta_was_wound_inwards(real_data: Path) -> None:
    aorta = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    assert isinstance(aorta, Mesh)
    done = repair(aorta)
    assert done.triangles_turned == len(aorta.triangles)
    assert mesh_quality(done.mesh).volume_mm3 == pytest.approx(13184, rel=1e-3)
