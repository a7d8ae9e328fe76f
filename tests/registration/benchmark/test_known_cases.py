"""Cases with a known deformation: the truth holds, and the swept side is what it is said to be."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from registration import transforms
from registration.benchmark.known_cases import NOISE_MM, KnownSpec, build_known, known_specs
from registration.benchmark.known_vessels import KnownVessel, known_vessel
from registration.benchmark.scoring import material_error_mm
from registration.geometry.open3d_bridge import TriangleScene
from registration.metrics.surface_distance import rms


@cache
def artery() -> KnownVessel:
    return known_vessel("artery")


def test_specs_have_all_sizes_in_every_deformation_and_coverage() -> None:
    specs = list(known_specs(["a", "b", "c"]))
    assert len(specs) == len({spec.number for spec in specs}) == 3 * 4 * 3
    for deformation in ("bending", "dilation", "indentation"):
        for coverage in (0.6, 0.8, 1.0):
            sizes = [s.size_mm for s in specs if (s.deformation, s.coverage) == (deformation, coverage)]
            assert sorted(sizes) == [1.5, 3.0, 5.0]
    assert {spec.size_mm for spec in specs if spec.deformation == "none"} == {0.0}


@pytest.mark.parametrize("coverage", [0.6, 1.0])
def test_the_true_pose_and_displacement_leave_no_error(coverage: float) -> None:
    spec = KnownSpec("artery", "bending", 3.0, coverage, 7)
    case = build_known(spec, artery())
    truth = case.truth
    assert rms(material_error_mm(truth.fixed_T_moving, truth, truth.displacement_mm)) < 1e-9
    assert 2.0 < case.largest_mm < 4.0
    assert truth.covered.mean() == pytest.approx(coverage, abs=0.12)
    again = build_known(spec, artery())
    np.testing.assert_array_equal(case.moving_mm, again.moving_mm)


def test_without_a_deformation_swept_points_lie_on_the_wall_but_for_noise() -> None:
    case = build_known(KnownSpec("artery", "none", 0.0, 0.6, 3), artery())
    assert len(case.moving_mm) == 3000 and len(case.fixed_mm) == 5000
    there_mm = transforms.apply(case.truth.fixed_T_moving, case.moving_mm)
    scene = TriangleScene(artery().surface)
    found = scene.closest(there_mm)
    across_mm = (found.offsets_mm * found.normals).sum(axis=1)
    assert across_mm.std() == pytest.approx(NOISE_MM, rel=0.1)
    np.testing.assert_allclose(case.truth.displacement_mm, 0.0, atol=1e-9)
    assert np.linalg.norm(scene.closest(case.fixed_mm).offsets_mm, axis=1).max() < 1e-3
    # Two samplings: no point recurs, and the start is not the truth.
    assert np.linalg.norm(case.moving_mm - there_mm, axis=1).max() > 1.0
