"""A reconstructed surface brought to the CT by the known pose and deformation."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.analysis.registration.simulated_truth import surface_in_ct
from registration import transforms
from registration.geometry.shapes import Mesh
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings


def settings(bend_mm: float) -> PhantomSettings:
    return PhantomSettings(
        subset="artery",
        scanner=Scanner(height_px=32, width_px=32),
        motion=Motion(frames=20, length_mm=90.0),
        deformation=Deformation(bend_mm=bend_mm, pressure_mm=0.0),
    )


@pytest.mark.parametrize("bend_mm", [0.0, 3.0])
def test_the_vessel_as_swept_comes_back_to_where_the_ct_has_it(bend_mm: float) -> None:
    truth = simulate_sweep(settings(bend_mm), 0, pictures=False)
    swept_mm = truth.deformation.as_swept(truth.anatomy.vertices_mm)
    world_mm = transforms.apply(transforms.invert_rigid(truth.ct_T_world), swept_mm)
    seen, material = surface_in_ct(truth, Mesh(world_mm, truth.anatomy.triangles))
    assert np.allclose(seen.vertices_mm, swept_mm)
    apart_mm = np.linalg.norm(material.vertices_mm - truth.anatomy.vertices_mm, axis=1)
    assert np.median(apart_mm) < 0.05
    moved_mm = np.linalg.norm(seen.vertices_mm - truth.anatomy.vertices_mm, axis=1)
    assert (np.median(moved_mm) > 0.5) == (bend_mm > 0)
    assert np.array_equal(material.triangles, truth.anatomy.triangles)
