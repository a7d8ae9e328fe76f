"""What a rigid method is given in Python: lists work, and what is no cloud is refused in one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vessels import bent_tube

from registration.errors import InputError
from registration.perturbation.perturbation import Piece, draw
from registration.rigid.comparators import (
    FpfhFastGlobal,
    FpfhFeatures,
    FpfhRansac,
    GeneralisedICP,
    SingleStartICP,
)
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import frame_of_points
from registration.rigid.stages import Stages
from registration.rigid.uncertainty import Uncertainty

CLOUD = draw(bent_tube(), 400, Piece(), np.random.default_rng(0))
FEATURES = FpfhFeatures(2.0, 12.0)
METHODS = [
    MultiStartICP(stages=Stages(fine_points=300), uncertainty=Uncertainty(replicates=20)),
    SingleStartICP(),
    GeneralisedICP(50.0, 1e-3),
    FpfhRansac(FEATURES, 3.0),
    FpfhFastGlobal(FEATURES, 3.0),
]
EACH = pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)


@pytest.mark.parametrize("method", METHODS[:3], ids=lambda method: type(method).__name__)
def test_lists_and_other_numbers_give_what_arrays_give(method: Any) -> None:
    moving = CLOUD + np.array([1.0, 2.0, -1.0])
    plain = method(moving, CLOUD, np.eye(4))
    for given in (moving.tolist(), [tuple(point) for point in moving], np.asfortranarray(moving)):
        found = method(given, CLOUD.tolist(), np.eye(4).tolist())
        np.testing.assert_allclose(found.fixed_T_moving, plain.fixed_T_moving, atol=1e-9)
    single = method(moving.astype(np.float32), CLOUD, np.eye(4))
    np.testing.assert_allclose(single.fixed_T_moving, plain.fixed_T_moving, atol=1e-2)


@EACH
@pytest.mark.parametrize(
    "cloud, said",
    [
        (CLOUD[:, :2], r"expected points of shape \(n, 3\), received shape \(400, 2\); points in a plane"),
        (CLOUD.T, r"expected points of shape \(n, 3\), received shape \(3, 400\); transpose it, points.T"),
        (CLOUD[0], r"expected points of shape \(n, 3\), received shape \(3,\); one point is points\[None\]"),
        (CLOUD[None], r"expected points of shape \(n, 3\), received shape \(1, 400, 3\)"),
        ([[1.0, 2.0, 3.0], [1.0, 2.0]], "expected points as an array of numbers"),
        ([["a", "b", "c"]] * 9, "expected points as an array of numbers"),
        ([], "expected at least .* points, received 0"),
        (
            np.ma.masked_greater(CLOUD, 5.0),
            "expected points that all count, received an array with masked ones",
        ),
        (CLOUD / 1000, "expected coordinates in millimetres, received a cloud .* looks like metres"),
    ],
    ids=["plane", "transposed", "one", "stacked", "ragged", "text", "none", "masked", "metres"],
)
def test_what_is_no_cloud_is_refused_by_name(method: Any, cloud: Any, said: str) -> None:
    with pytest.raises(InputError, match=f"^moving_mm: {said}"):
        method(cloud, CLOUD)
    with pytest.raises(InputError, match=f"^fixed_mm: {said}"):
        method(CLOUD, cloud)


@EACH
@pytest.mark.parametrize("initial", [np.eye(3), np.eye(4)[None], "identity", [[1.0, 2.0]]])
def test_an_initial_pose_is_one_matrix(method: Any, initial: Any) -> None:
    with pytest.raises(InputError, match=r"^initial: expected a matrix of shape \(4, 4\), received"):
        method(CLOUD, CLOUD, initial)


def test_centerlines_and_frames_are_checked() -> None:
    method = METHODS[0]
    with pytest.raises(InputError, match=r"moving_centerline_mm: expected points of shape \(n, 3\)"):
        method(CLOUD, CLOUD, moving_centerline_mm=[[0.0, 1.0]], fixed_centerline_mm=CLOUD[:5])
    assert frame_of_points([0, 1, 1], 3).tolist() == [0, 1, 1]
    with pytest.raises(InputError, match="moving_frame: expected whole numbers"):
        frame_of_points([0.5, 1.0, 2.0], 3)
    for beyond in (np.inf, 1e300, np.nan):
        with pytest.raises(InputError, match="moving_frame: expected whole numbers"):
            frame_of_points([0.0, 1.0, beyond], 3)
    with pytest.raises(InputError, match="moving_frame: expected one frame for each of 2 points"):
        frame_of_points([[1, 2], [3]], 2)
    with pytest.raises(InputError, match="moving_frame: expected one frame for each of 3 points, received 2"):
        frame_of_points([0, 1], 3)


@pytest.mark.parametrize("fixed", ["flat", "tube"])
def test_a_flat_cloud_has_a_result_that_is_not_accepted(fixed: str) -> None:
    flat = np.c_[np.random.default_rng(0).random((400, 2)) * 50.0, np.zeros(400)]
    assert METHODS[0](flat, flat if fixed == "flat" else CLOUD).verdict != "accepted"


def test_targets_are_checked_and_may_be_a_list() -> None:
    result = METHODS[0](CLOUD + 1.0, CLOUD)
    assert result.tre_interval_mm(CLOUD[:5].tolist()) == result.tre_interval_mm(CLOUD[:5])
    with pytest.raises(
        InputError, match=r"^targets_mm: expected points of shape \(n, 3\), received shape \(3,\)"
    ):
        result.tre_interval_mm(np.zeros(3))


def test_a_result_is_shown_on_one_screen() -> None:
    result: RigidResult = METHODS[0](CLOUD + 1.0, CLOUD)
    shown = repr(result)
    assert len(result.candidates) > 5
    assert len(shown.splitlines()) <= 12
    assert max(map(len, shown.splitlines())) <= 200
    for part in ("verdict='", "rmse_mm=", f"candidates={len(result.candidates)}", "fixed_T_moving=[["):
        assert part in shown
    assert "verdict='not judged'" in repr(METHODS[1](CLOUD + 1.0, CLOUD))
