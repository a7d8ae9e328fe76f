"""Deformable registration against displacements that are known: error of material points, not residuals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import rustcpd
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration.cpd import CoherentPointDrift
from registration.deformable.landmark_constraints import LandmarkConstraints
from registration.deformable.point_drift import PointResiduals
from registration.deformable.result import DEFORMED, RIGID_STANDS
from registration.deformable.wall_displacement import WallResiduals
from registration.errors import InputError
from registration.metrics.surface_distance import rms

TUBE = bent_tube()
MIDDLE_MM = TUBE.vertices_mm.mean(axis=0)
AXIS = np.linalg.svd(TUBE.vertices_mm - MIDDLE_MM, full_matrices=False)[2]
POINT = CoherentPointDrift("point")


def bend(points_mm: np.ndarray, size_mm: float = 2.0) -> np.ndarray:
    """A bend across the vessel: one wave over its length, by which the ends and the middle part."""
    along = (points_mm - MIDDLE_MM) @ AXIS[0] / 35.0
    return size_mm * np.outer(np.cos(np.pi * along), AXIS[1])


def clouds(
    motion: Callable[[np.ndarray], np.ndarray], noise_mm: float = 0.15, share: float = 1.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the model, swept points of a share of its length, and which of the model's points were swept."""
    rng = np.random.default_rng(seed)
    model_mm, wall_mm = TUBE.sample(4000, rng), TUBE.sample(int(2500 * share), rng)
    if share < 1:
        more_mm = TUBE.sample(6000, rng)
        along = (more_mm - MIDDLE_MM) @ AXIS[0]
        wall_mm = more_mm[along <= np.quantile(along, share)][: int(2500 * share)]
    swept_mm = wall_mm + motion(wall_mm) + noise_mm * rng.standard_normal(wall_mm.shape)
    seen = (model_mm - MIDDLE_MM) @ AXIS[0] <= ((wall_mm - MIDDLE_MM) @ AXIS[0]).max()
    return model_mm, swept_mm, seen


def error_mm(
    displaced_mm: np.ndarray, motion: Callable[[np.ndarray], np.ndarray], at_mm: np.ndarray
) -> float:
    return rms(np.linalg.norm(displaced_mm - motion(at_mm), axis=1))


def test_a_bend_is_undone_and_its_error_predicted() -> None:
    model_mm, swept_mm, _ = clouds(bend)
    found = CoherentPointDrift()(model_mm, swept_mm)
    before_mm = error_mm(np.zeros_like(model_mm), bend, model_mm)
    after_mm = error_mm(found.displacement(model_mm), bend, model_mm)
    assert found.verdict == DEFORMED and found.converged and not found.plausibility.folds
    assert after_mm < 0.4 * before_mm
    low_mm, high_mm = found.tre_interval_mm(model_mm)
    assert low_mm <= after_mm <= high_mm < before_mm
    np.testing.assert_array_equal(found.moved_mm, model_mm + found.displacement(model_mm))


def test_the_wall_is_matched_without_sliding_along_it() -> None:
    model_mm, swept_mm, _ = clouds(bend, noise_mm=0.3)
    plane = CoherentPointDrift()(model_mm, swept_mm)
    point = POINT(model_mm[:1000], swept_mm[:1000])
    assert error_mm(plane.displacement(model_mm), bend, model_mm) < error_mm(
        point.displacement(model_mm), bend, model_mm
    )


def test_the_rigid_result_stands_where_nothing_deforms() -> None:
    model_mm, swept_mm, _ = clouds(np.zeros_like)
    found = CoherentPointDrift()(model_mm, swept_mm)
    assert found.verdict == RIGID_STANDS and "no deformation" in found.reason
    assert not found.displacement(model_mm).any()
    np.testing.assert_array_equal(found.moved_mm, model_mm)
    assert found.tre_interval_mm(model_mm)[1] < 1.0


def test_what_was_not_swept_is_not_pulled_and_less_sure() -> None:
    model_mm, swept_mm, seen = clouds(bend, share=0.6)
    found = CoherentPointDrift()(model_mm, swept_mm)
    far_mm = model_mm[~seen]
    assert error_mm(found.displacement(model_mm[seen]), bend, model_mm[seen]) < 0.5
    # A method that lets fixed points pull the rest would drag the end back over the swept part, by tens of mm.
    assert np.abs(found.displacement(far_mm)).max() < 6.0
    assert found.tre_interval_mm(far_mm)[1] > 2.0 * found.tre_interval_mm(model_mm[seen])[1]


def test_an_error_beyond_the_cloud_is_none_that_is_predicted() -> None:
    model_mm, swept_mm, _ = clouds(bend)
    found = CoherentPointDrift()(model_mm, swept_mm)
    assert np.isfinite(found.tre_interval_mm(model_mm)).all()
    assert np.isnan(found.tre_interval_mm(model_mm[:20] + np.array([1e5, 0.0, 0.0]))).all()


def test_the_displacement_has_an_inverse() -> None:
    model_mm, swept_mm, _ = clouds(bend)
    found = CoherentPointDrift()(model_mm, swept_mm)
    there_mm = model_mm[:200] + found.displacement(model_mm[:200])
    np.testing.assert_allclose(there_mm + found.inverse(there_mm), model_mm[:200], atol=1e-4)


def test_the_same_clouds_give_the_same_result_in_any_place() -> None:
    model_mm, swept_mm, _ = clouds(bend)
    first, again = (CoherentPointDrift()(model_mm, swept_mm) for _ in range(2))
    np.testing.assert_array_equal(first.moved_mm, again.moved_mm)
    assert first.tre_interval_mm(model_mm) == again.tre_interval_mm(model_mm)
    away_mm = np.array([300.0, -200.0, 100.0])
    shifted = CoherentPointDrift()(model_mm + away_mm, swept_mm + away_mm)
    # Rounding pairs a point in a hundred otherwise, and may end an iteration earlier.
    np.testing.assert_allclose(shifted.moved_mm - away_mm, first.moved_mm, atol=0.1)


def test_the_textbook_method_is_rustcpds() -> None:
    model_mm, swept_mm, _ = clouds(bend)
    few_mm, centre_mm = model_mm[:600], swept_mm.mean(axis=0)
    settings = PointResiduals(sigma0_mm=3.0, max_iterations=20, neighbours=None)
    found = CoherentPointDrift("point", point=settings)(few_mm, swept_mm)
    fit = rustcpd.register_deformable(
        swept_mm - centre_mm, few_mm - centre_mm, alpha=2.0, beta=20.0, sigma2=9.0, max_iterations=20,
        tolerance=1e-5, outlier_weight=0.1, low_rank=300, low_rank_method="pivoted_cholesky",
    )  # fmt: skip
    np.testing.assert_allclose(found.moved_mm, fit.points + centre_mm, atol=1e-9)
    assert np.isnan(found.tre_interval_mm(few_mm)).all()
    assert not found.converged and found.iterations == 20


def test_a_wrong_residual_is_refused() -> None:
    with pytest.raises(InputError, match="residual: expected plane or point, received 'wall'"):
        CoherentPointDrift("wall")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lengths_mm": ()}, "lengths_mm: expected at least one length"),
        ({"lengths_mm": (0.0,)}, "lengths_mm: expected"),
        ({"patches": 4}, "patches: expected"),
        ({"max_iterations": 0}, "max_iterations: expected"),
        ({"min_gain": -1.0}, "min_gain: expected"),
        ({"inflation": 0.0}, "inflation: expected"),
        ({"size_doubt": -0.1}, "size_doubt: expected"),
    ],
)
def test_a_wrong_setting_of_the_wall_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        WallResiduals(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"beta_mm": 0.0}, "beta_mm: expected"),
        ({"roughness_per_mm2": -2.0}, "roughness_per_mm2: expected"),
        ({"outlier_weight": 1.0}, r"outlier_weight: expected a share below 1, received 1\.0"),
        ({"sigma0_mm": 0.0}, "sigma0_mm: expected"),
        ({"rank": 0}, "rank: expected"),
        ({"neighbours": 0}, "neighbours: expected"),
        ({"tolerance": 0.0}, "tolerance: expected"),
    ],
)
def test_a_wrong_setting_of_the_points_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PointResiduals(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", [CoherentPointDrift(), POINT], ids=["plane", "point"])
def test_clouds_that_cannot_be_registered_are_refused(method: CoherentPointDrift) -> None:
    model_mm, swept_mm, _ = clouds(bend)
    with pytest.raises(InputError, match="register rigidly first"):
        method(model_mm, swept_mm + np.array([40.0, 0.0, 0.0]))
    with pytest.raises(InputError, match=r"fixed_mm: expected .*50"):
        method(model_mm, swept_mm[:20])
    with pytest.raises(InputError, match="moving_mm: expected"):
        method(np.full_like(model_mm, np.nan), swept_mm)
    with pytest.raises(InputError, match="fixed_frame: expected 2500 frames, received 3"):
        method(model_mm, swept_mm, fixed_frame=np.zeros(3, dtype=np.int64))


def slide(points_mm: np.ndarray) -> np.ndarray:
    """A stretch along the vessel, which distances along its normals do not show."""
    along = (points_mm - MIDDLE_MM) @ AXIS[0] / 35.0
    return 3.0 * np.outer(np.sin(0.5 * np.pi * along), AXIS[0])


def landmarks_of(
    motion: Callable[[np.ndarray], np.ndarray], deviation_mm: float = 0.2
) -> LandmarkConstraints:
    along_mm = np.linspace(-30, 30, 7)[:, None] * AXIS[0] + MIDDLE_MM
    return LandmarkConstraints(along_mm, along_mm + motion(along_mm), deviation_mm)


@pytest.mark.parametrize("method", [CoherentPointDrift(), POINT], ids=["plane", "point"])
def test_landmarks_show_a_stretch_along_the_vessel(method: CoherentPointDrift) -> None:
    model_mm, swept_mm, _ = clouds(slide)
    few = slice(None, None, 4)
    without, with_them = (
        method(model_mm[few], swept_mm[few], landmarks=landmarks) for landmarks in (None, landmarks_of(slide))
    )
    errors_mm = [error_mm(found.displacement(model_mm), slide, model_mm) for found in (without, with_them)]
    assert errors_mm[1] < 0.85 * errors_mm[0]
    marked = landmarks_of(slide)
    reached_mm = marked.moving_mm + with_them.displacement(marked.moving_mm)
    assert np.linalg.norm(reached_mm - marked.fixed_mm, axis=1).max() < 0.6


def test_a_landmark_pulls_less_the_less_surely_it_was_placed() -> None:
    model_mm, swept_mm, _ = clouds(np.zeros_like)
    wrong = LandmarkConstraints(MIDDLE_MM[None], MIDDLE_MM[None] + 2.0 * AXIS[0], 0.1)
    pulled_mm = []
    for deviation_mm in (0.1, 2.0, 20.0):
        found = CoherentPointDrift()(
            model_mm, swept_mm, landmarks=LandmarkConstraints(wrong.moving_mm, wrong.fixed_mm, deviation_mm)
        )
        posterior = found.predicted.posterior if found.predicted else None
        assert posterior is not None
        pulled_mm.append(float((posterior.mean_mm(wrong.moving_mm) @ AXIS[0])[0]))
    assert pulled_mm[0] > pulled_mm[1] > pulled_mm[2] > -0.2
    assert pulled_mm[2] < 0.5 * pulled_mm[0]


def test_landmarks_narrow_the_predicted_error_where_they_lie() -> None:
    model_mm, swept_mm, _ = clouds(slide)
    marked = landmarks_of(slide)
    # Off the wall, so that the wall says little of them.
    widths_mm = [
        found.tre_interval_mm(marked.moving_mm)[1]
        for found in (
            CoherentPointDrift()(model_mm, swept_mm, landmarks=landmarks) for landmarks in (None, marked)
        )
    ]
    assert widths_mm[1] < widths_mm[0]


@pytest.mark.parametrize(
    ("moving", "fixed", "deviation_mm", "message"),
    [
        (np.zeros((2, 3)), np.zeros((3, 3)), 1.0, "expected pairs, received 2 moving and 3 fixed"),
        (np.zeros((2, 3)), np.zeros((2, 3)), 0.0, "landmarks deviation_mm"),
        (np.full((1, 3), np.nan), np.zeros((1, 3)), 1.0, "landmarks moving_mm"),
        (np.zeros((1, 3)), np.zeros((0, 3)), 1.0, "landmarks fixed_mm"),
    ],
)
def test_landmarks_that_are_no_pairs_are_refused(
    moving: np.ndarray, fixed: np.ndarray, deviation_mm: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LandmarkConstraints(moving, fixed, deviation_mm)


@pytest.mark.parametrize(("motion", "scale"), [("rigid", 1.0), ("similarity", 1.05)])
def test_a_rigid_or_similarity_motion_is_found_as_such(motion: str, scale: float) -> None:
    model_mm, _, _ = clouds(np.zeros_like)
    turn = Rotation.from_rotvec(np.deg2rad(4.0) * AXIS[1]).as_matrix()

    def moved(points_mm: np.ndarray) -> np.ndarray:
        return np.asarray(scale * (points_mm - MIDDLE_MM) @ turn.T + MIDDLE_MM + 1.0 - points_mm)

    swept_mm = model_mm[::2] + moved(model_mm[::2])
    settings = PointResiduals(motion=motion, neighbours=None, tolerance=1e-9, outlier_weight=0.01)
    found = CoherentPointDrift("point", point=settings)(model_mm[::2], swept_mm)
    assert error_mm(found.displacement(model_mm), moved, model_mm) < 0.1
    # All points move together: what is bent is nothing.
    assert found.plausibility.bending_energy_per_mm2 < 1e-12
    assert found.plausibility.jacobian_min == pytest.approx(scale**3, rel=0.01)
    with pytest.raises(InputError, match=f"landmarks: expected none for a {motion} motion"):
        CoherentPointDrift("point", point=settings)(model_mm, swept_mm, landmarks=landmarks_of(np.zeros_like))
    with pytest.raises(InputError, match="motion: expected nonrigid, rigid, similarity"):
        PointResiduals(motion="affine")


def test_the_drifts_objective_never_rises() -> None:
    model_mm, swept_mm, _ = clouds(bend, noise_mm=0.3)
    few_mm, some_mm = model_mm[:250], swept_mm[:300]
    centre_mm, share, weight = some_mm.mean(axis=0), 0.1, 2.0
    moving_mm, fixed_mm = few_mm - centre_mm, some_mm - centre_mm

    def objective(iterations: int) -> float:
        """Negative log-posterior of Myronenko and Song (equations 4 and 13), from what the engine hands back."""
        fit = rustcpd.register_deformable(
            fixed_mm, moving_mm, alpha=weight, beta=20.0, sigma2=9.0, max_iterations=iterations, tolerance=1e-300,
            outlier_weight=share, k=None, low_rank=None,
        )  # fmt: skip
        apart_mm2 = ((fixed_mm[:, None] - fit.points[None]) ** 2).sum(axis=2)
        near = np.exp(-apart_mm2 / (2 * fit.sigma2)).sum(axis=1) * (1 - share) / len(moving_mm)
        density = near * (2 * np.pi * fit.sigma2) ** -1.5 + share / len(fixed_mm)
        return float(
            0.5 * weight * np.trace(fit.weights.T @ fit.kernel @ fit.weights) - np.log(density).sum()
        )

    values = np.array([objective(iterations) for iterations in range(1, 16)])
    assert (np.diff(values) <= 1e-6 * np.abs(values[:-1])).all()
    assert values[-1] < values[0] - 1.0
