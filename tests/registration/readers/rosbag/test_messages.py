"""ROS messages in this project's terms, from messages made by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.rosbag.messages import BrokenMessageError, image_pixels, rigid_pose, stamp_s


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
    assert image_pixels(picture([1, 2, 99, 3, 4, 99], 2, 2, 3), "a").tolist() == [[1, 2], [3, 4]]


def test_blue_comes_first_in_bgr() -> None:
    assert image_pixels(picture([100, 2, 3], 1, 1, 3, "bgr8"), "a").tolist() == [[[3, 2, 100]]]
    assert image_pixels(picture([100, 2, 3], 1, 1, 3, "RGB8"), "a").tolist() == [[[100, 2, 3]]]
    assert image_pixels(picture([100, 2, 3, 0], 1, 1, 4, "bgra8"), "a").tolist() == [[[3, 2, 100]]]


@pytest.mark.parametrize(
    ("big", "data"), [(0, [1, 2, 99, 99, 0, 128, 99, 99]), (1, [2, 1, 99, 99, 128, 0, 99, 99])]
)
@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_16_bits_in_either_order_of_bytes(big: int, data: list[int], encoding: str) -> None:
    message = picture(data, 2, 1, 4, encoding)
    message.is_bigendian = big
    found = image_pixels(message, "a")
    assert found.dtype == np.uint16
    assert found.tolist() == [[513], [32768]]


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (picture([1, 2], 1, 2, 1), "a: expected 1 rows of at least 2 bytes, found 2 bytes in rows of 1"),
        (picture([1, 2, 3], 2, 2, 2), "a: expected 2 rows of at least 2 bytes, found 3 bytes in rows of 2"),
        (picture([1], 1, 1, 1, "mono16"), "a: expected 1 rows of at least 2 bytes"),
        (picture([], 0, 0, 0), "a: expected 0 rows of at least 0 bytes"),
        (
            SimpleNamespace(format="png", data=b"no picture"),
            r"a: expected a readable PNG image .*format 'png'",
        ),
    ],
)
def test_broken_pictures_are_told_from_what_is_not_read(message: SimpleNamespace, text: str) -> None:
    with pytest.raises(BrokenMessageError, match=text):
        image_pixels(message, "a")


@pytest.mark.parametrize("encoding", ["bayer_rggb8", "32FC1", "yuv422", "rgb16"])
def test_encodings_that_are_not_read_are_refused_at_once(encoding: str) -> None:
    with pytest.raises(
        InputError, match=f"a: expected an encoding of mono8, .* found '{encoding}'"
    ) as refused:
        image_pixels(picture([1], 1, 1, 1, encoding), "a")
    assert not isinstance(refused.value, BrokenMessageError)


def test_pose_and_transform_in_millimetres() -> None:
    quarter = np.sqrt(0.5)
    place, turn = vector(0.1, -0.2, 0.3), vector(0, 0, quarter, quarter)
    pose = SimpleNamespace(pose=SimpleNamespace(position=place, orientation=turn))
    expected = [[0, -1, 0, 100], [1, 0, 0, -200], [0, 0, 1, 300], [0, 0, 0, 1]]
    np.testing.assert_allclose(rigid_pose(pose, "a"), expected, atol=1e-9)
    link = SimpleNamespace(transform=SimpleNamespace(translation=place, rotation=turn))
    np.testing.assert_allclose(rigid_pose(link, "a"), expected, atol=1e-9)


@pytest.mark.parametrize("length", [0.991, 1.003, 1.009])
def test_a_quaternion_within_a_percent_of_unit_length_is_scaled(length: float) -> None:
    quarter = length * np.sqrt(0.5)
    link = SimpleNamespace(
        transform=SimpleNamespace(translation=vector(1, 2, 3), rotation=vector(0, 0, quarter, quarter))
    )
    found = rigid_pose(link, "a", 1.0)
    np.testing.assert_allclose(found, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-9)


@pytest.mark.parametrize(
    ("position", "turn"),
    [
        ((0, 0, np.nan), (0, 0, 0, 1)),
        ((0, 0, 0), (0, 0, 0, 0.98)),
        ((0, 0, 0), (0, 0, 0, 0)),
        ((0, 0, 0), (np.nan,) * 4),
    ],
)
def test_broken_poses_are_refused(position: tuple[float, ...], turn: tuple[float, ...]) -> None:
    message = SimpleNamespace(pose=SimpleNamespace(position=vector(*position), orientation=vector(*turn)))
    with pytest.raises(BrokenMessageError, match="a: expected a finite position and a unit quaternion"):
        rigid_pose(message, "a")
