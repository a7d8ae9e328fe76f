"""ROS messages in this project's terms, from messages made by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.ros_messages import grey_image, rigid_pose, stamp_s


def vector(*values: float) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip("xyzw", values, strict=False)))


def picture(data: list[int], height: int, width: int, step: int, encoding: str = "mono8") -> SimpleNamespace:
    return SimpleNamespace(
        data=np.array(data, np.uint8), height=height, width=width, step=step, encoding=encoding
    )


def test_stamp_is_seconds_and_nanoseconds() -> None:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1_700_000_000, nanosec=250_000_000))
    assert stamp_s(SimpleNamespace(header=header)) == 1_700_000_000.25


def test_rows_may_be_longer_than_the_picture() -> None:
    assert grey_image(picture([1, 2, 99, 3, 4, 99], 2, 2, 3), "a").tolist() == [[1, 2], [3, 4]]


def test_blue_comes_first_in_bgr() -> None:
    assert grey_image(picture([100, 0, 0], 1, 1, 3, "bgr8"), "a").tolist() == [[11]]
    assert grey_image(picture([100, 0, 0], 1, 1, 3, "RGB8"), "a").tolist() == [[30]]


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (picture([1, 2], 1, 2, 1), "a: expected 1 rows of at least 2 bytes, found 2 bytes in rows of 1"),
        (picture([1, 2, 3], 2, 2, 2), "a: expected 2 rows of at least 2 bytes, found 3 bytes in rows of 2"),
        (picture([1], 1, 1, 1, "mono16"), "a: expected an encoding of mono8"),
        (SimpleNamespace(format="png", data=b"no picture"), "a: expected a JPEG or PNG picture, found 'png'"),
    ],
)
def test_broken_pictures_are_refused(message: SimpleNamespace, text: str) -> None:
    with pytest.raises(InputError, match=text):
        grey_image(message, "a")


def test_pose_and_transform_in_millimetres() -> None:
    quarter = np.sqrt(0.5)
    place, turn = vector(0.1, -0.2, 0.3), vector(0, 0, quarter, quarter)
    pose = SimpleNamespace(pose=SimpleNamespace(position=place, orientation=turn))
    expected = [[0, -1, 0, 100], [1, 0, 0, -200], [0, 0, 1, 300], [0, 0, 0, 1]]
    np.testing.assert_allclose(rigid_pose(pose, "a"), expected, atol=1e-9)
    link = SimpleNamespace(transform=SimpleNamespace(translation=place, rotation=turn))
    np.testing.assert_allclose(rigid_pose(link, "a"), expected, atol=1e-9)


@pytest.mark.parametrize(("position", "turn"), [((0, 0, np.nan), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 0, 0.9))])
def test_broken_poses_are_refused(position: tuple[float, ...], turn: tuple[float, ...]) -> None:
    message = SimpleNamespace(pose=SimpleNamespace(position=vector(*position), orientation=vector(*turn)))
    with pytest.raises(InputError, match="a: expected a finite position and a unit quaternion"):
        rigid_pose(message, "a")
