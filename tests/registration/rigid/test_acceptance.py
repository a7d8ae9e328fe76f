"""Motions named by what they do to a vessel, and verdicts by the rule that decides them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import PrincipalFrame
from registration.rigid.acceptance import (
    AcceptanceCriteria,
    displacement_mm,
    named_motion,
    probes,
    weak_motion,
)
from registration.rigid.result import percent

OBLIQUE = Rotation.from_rotvec([0.7, -0.4, 1.1])
CENTRE = np.array([20.0, -300, 41])
VESSEL = PrincipalFrame(CENTRE, OBLIQUE.as_matrix(), np.array([20.0, 4.0, 3.0]))
CALM = {"settled": True, "inlier_share": 0.95, "gap": 8.0, "expected_mm": 0.4, "weak": ()}


def motion(turn: list[float], shift_mm: list[float]) -> np.ndarray:
    """A motion given along the vessel's own axes, about its centre."""
    about = transforms.rotate_about(Rotation.from_rotvec(OBLIQUE.apply(turn)), CENTRE)
    return transforms.compose(transforms.translation(OBLIQUE.apply(shift_mm)), about)


@pytest.mark.parametrize(
    "turn, shift_mm, names",
    [
        ([0, 0, 0], [6, 0, 0], ("slide",)),
        ([0, 0, 0], [-6, 0, 0], ("slide",)),
        ([0, 0, 0], [0, 2, -3], ("shift",)),
        ([2.0, 0, 0], [0, 0, 0], ("roll",)),
        ([np.pi, 0, 0], [0, 0, 0], ("roll",)),
        ([0, 0.2, 0], [0, 0, 0], ("tilt",)),
        ([0, 0, np.pi], [0, 0, 0], ("flip",)),
        ([1.5, 0, 0], [6, 0, 0], ("slide", "roll")),
    ],
)
def test_a_motion_is_named(turn: list[float], shift_mm: list[float], names: tuple[str, ...]) -> None:
    assert named_motion(motion(turn, shift_mm), VESSEL) == names


def test_a_motion_too_small_to_matter_has_no_name() -> None:
    assert named_motion(motion([0, 0, 0], [0.2, 0, 0]), VESSEL, min_mm=0.5) == ()
    assert named_motion(np.eye(4), VESSEL) == ()


def test_a_result_is_accepted_with_what_speaks_for_it() -> None:
    verdict, reason = AcceptanceCriteria()(**CALM)
    assert verdict == "accepted"
    assert "worse by 8.0 standard errors" in reason
    assert "the predicted TRE without deformation is up to 0.4 mm (95 %, over the fixed points)" in reason
    assert "no other pose" in AcceptanceCriteria()(**(CALM | {"gap": float("inf")}))[1]
    assert "no error was predicted" in AcceptanceCriteria()(**(CALM | {"expected_mm": float("nan")}))[1]


@pytest.mark.parametrize("expected_mm", [0.0, 1e-15, 4e-4])
def test_clouds_without_noise_promise_no_error_of_nothing(expected_mm: float) -> None:
    verdict, reason = AcceptanceCriteria()(**(CALM | {"expected_mm": expected_mm}))
    assert verdict == "accepted"
    assert "the clouds fit without noise, which predicts nothing" in reason
    assert "0.0 mm" not in reason
    assert "should" not in reason


def test_several_axes_that_are_tried_ask_for_a_larger_gap() -> None:
    assert AcceptanceCriteria().needed_gap(1) == 2.0
    # A third of the normal tail beyond 2: 0.0228 / 3.
    assert AcceptanceCriteria().needed_gap(3) == pytest.approx(2.428, abs=1e-3)
    close = CALM | {"gap": 2.2}
    assert AcceptanceCriteria()(**close)[0] == "accepted"
    verdict, reason = AcceptanceCriteria()(**close, tries=3)
    assert verdict == "ambiguous"
    assert "worse by 2.2 standard errors, at least 2.4 are needed" in reason


def test_a_rival_that_is_better_is_not_called_worse() -> None:
    _, reason = AcceptanceCriteria()(**(CALM | {"gap": -5.23}))
    assert "another pose explains the clouds as well, or better by 5.2 standard errors" in reason


@pytest.mark.parametrize(
    "change, verdict, said",
    [
        ({"inlier_share": 0.3}, "failed", "only 30 % of the moving points"),
        ({"settled": False}, "failed", "had not settled"),
        (
            {"gap": 1.2, "weak": ("slide", "roll")},
            "ambiguous",
            r"another pose \(slide, roll\).* 1.2 standard errors",
        ),
        (
            {"expected_mm": 3.1, "weak": ("slide",)},
            "ambiguous",
            r"pose open \(slide\).* TRE without deformation is up to 3\.1 mm \(95 %, over the fixed points\), "
            "at most 2 mm",
        ),
    ],
)
def test_a_result_is_not_accepted_for_a_reason(change: dict[str, object], verdict: str, said: str) -> None:
    found = AcceptanceCriteria()(**(CALM | change))
    assert found[0] == verdict
    assert re.search(said, found[1])


@pytest.mark.parametrize(
    "expected_mm, said", [(2.4, "2.4 mm"), (2.04, "2.04 mm"), (2.0004, "just over 2 mm")]
)
def test_a_value_above_its_limit_is_shown_above_it(expected_mm: float, said: str) -> None:
    _, reason = AcceptanceCriteria()(**(CALM | {"expected_mm": expected_mm}))
    assert reason.endswith(f"is up to {said} (95 %, over the fixed points), at most 2 mm is accepted")


@pytest.mark.parametrize(
    "probability, said",
    [(0.0, "less than 1 %"), (0.0099, "less than 1 %"), (0.01, "1 %"), (0.874, "87 %"), (1.0, "over 99 %")],
)
def test_no_probability_is_called_certain(probability: float, said: str) -> None:
    assert percent(probability) == said


def test_probes_roll_and_slide_about_the_vessels_own_axis() -> None:
    tried = probes(VESSEL, 3.0)
    assert [named_motion(one, VESSEL) for one in tried] == [("roll",)] * 3 + [("slide",)] * 2
    np.testing.assert_allclose(transforms.rotation_angle_deg(tried), [30, 90, 180, 0, 0], atol=1e-6)
    along = (transforms.apply_each(tried, np.tile(CENTRE, (5, 1))) - CENTRE) @ VESSEL.axes[:, 0]
    np.testing.assert_allclose(along, [0, 0, 0, 3, -3], atol=1e-9)


def test_the_weakest_motion_is_where_samples_spread_most() -> None:
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((5000, 6)) * [0.1, 0.1, 0.1, 2.0, 0.2, 0.1]
    weakest = weak_motion(samples)
    assert abs(weakest[3]) == pytest.approx(2.0, rel=0.05)
    assert np.abs(np.delete(weakest, 3)).max() < 0.1


def test_displacements_are_root_mean_squares() -> None:
    points = np.array([[1.0, 0, 0], [3.0, 0, 0]])
    half = transforms.rotate_about(Rotation.from_rotvec([0, 0, np.pi]), np.zeros(3))
    found = displacement_mm(np.stack([transforms.translation((3.0, 4, 0)), half]), points)
    np.testing.assert_allclose(found, [5, np.sqrt((4 + 36) / 2)])


@pytest.mark.parametrize("settings", [{"max_tre_mm": 0.0}, {"min_gap": -1.0}, {"min_inlier_share": 1.5}])
def test_settings_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        AcceptanceCriteria(**settings)
