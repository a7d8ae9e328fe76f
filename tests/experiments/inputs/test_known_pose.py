"""Which pose is known, and how far a search may go from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.inputs.known_pose import InitialPose, initial_pose
from registration import transforms
from registration.errors import InputError
from registration.io.landmarks import LandmarkPairs
from registration.io.transforms import write_transform
from registration.rigid.search_cone import SearchCone

CORNERS = np.array([[0.0, 0, 0], [30, 0, 0], [0, 20, 0]])
PAIRS = LandmarkPairs(("a", "b", "c"), CORNERS, CORNERS + np.array([5.0, 6.0, 7.0]))


def test_a_file_goes_before_landmarks(tmp_path: Path) -> None:
    write_transform(tmp_path / "pose.h5", transforms.translation((1.0, 2.0, 3.0)))
    from_file = initial_pose(tmp_path / "pose.h5", PAIRS)
    assert from_file is not None and from_file.source == "file"
    np.testing.assert_allclose(from_file.fixed_T_moving, transforms.translation((1.0, 2.0, 3.0)))
    from_landmarks = initial_pose(None, PAIRS)
    assert from_landmarks is not None and from_landmarks.source == "landmarks"
    np.testing.assert_allclose(
        from_landmarks.fixed_T_moving, transforms.translation((5.0, 6.0, 7.0)), atol=1e-12
    )
    assert initial_pose(None, None) is None


@pytest.mark.parametrize(
    "angle_deg, radius_mm, cone",
    [
        (None, None, None),
        (10.0, 3.0, SearchCone(10.0, 3.0)),
        (10.0, None, SearchCone(angle_deg=10.0)),
        (None, 3.0, SearchCone(radius_mm=3.0)),
    ],
)
def test_a_bound_that_is_not_given_is_the_usual_one(
    angle_deg: float | None, radius_mm: float | None, cone: SearchCone | None
) -> None:
    found = initial_pose(None, PAIRS, angle_deg, radius_mm)
    assert found is not None
    assert found.search_cone == cone


@pytest.mark.parametrize(
    "angle_deg, radius_mm, message",
    [
        (200.0, None, "search_cone_deg: expected a number above 0 and at most 180, received 200"),
        (None, -1.0, "search_radius_mm: expected a number above 0, received -1"),
    ],
)
def test_a_bound_out_of_range_goes_by_the_name_the_user_gave_it(
    angle_deg: float | None, radius_mm: float | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        initial_pose(None, PAIRS, angle_deg, radius_mm)


def test_a_bound_around_nothing_is_refused() -> None:
    with pytest.raises(
        InputError, match="search_cone_deg: expected an initial pose or landmarks to search around"
    ):
        initial_pose(None, None, 10.0, None)
    with pytest.raises(InputError, match="search_radius_mm: expected an initial pose or landmarks"):
        initial_pose(None, None, None, 5.0)


def test_only_rigid_poses_from_known_sources() -> None:
    with pytest.raises(InputError, match="fixed_T_moving: expected a right-handed rotation"):
        InitialPose(np.diag([1.0, 1, -1, 1]), "file")
    with pytest.raises(InputError, match="source: expected one of file, landmarks, received 'guess'"):
        InitialPose(np.eye(4), "guess")
