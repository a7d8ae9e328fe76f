"""Contents of ROS messages in this project's terms: seconds, millimetres, pixels by their meaning."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.readers.streams.image_files import decode_image
from registration.readers.streams.pose_values import MM_PER_UNIT, unit_quaternions

# ROS lengths are metres (REP 103, Standard Units of Measure and Coordinate Conventions).
MM_PER_METRE = MM_PER_UNIT["m"]
# Bytes and channels of the encodings in sensor_msgs/image_encodings.hpp, and which are red, green and blue.
_ENCODINGS: dict[str, tuple[int, int, tuple[int, ...]]] = {
    "mono8": (1, 1, (0,)),
    "8uc1": (1, 1, (0,)),
    "mono16": (2, 1, (0,)),
    "16uc1": (2, 1, (0,)),
    "rgb8": (1, 3, (0, 1, 2)),
    "bgr8": (1, 3, (2, 1, 0)),
    "8uc3": (1, 3, (2, 1, 0)),
    "rgba8": (1, 4, (0, 1, 2)),
    "bgra8": (1, 4, (2, 1, 0)),
    "8uc4": (1, 4, (2, 1, 0)),
}


class BrokenMessageError(InputError):
    """One message holds no value; the others of its topic may."""


def stamp_s(message: Any) -> float:
    """Read the time in a message's header.

    Parameters
    ----------
    message : Any
        Message with a header.

    Returns
    -------
    float
        Time in s.
    """
    return float(message.header.stamp.sec) + float(message.header.stamp.nanosec) * 1e-9


def image_pixels(message: Any, name: str) -> np.ndarray:
    """Decode the picture of a sensor_msgs Image or CompressedImage.

    Parameters
    ----------
    message : Any
        Message.
    name : str
        Its name, for messages.

    Returns
    -------
    ndarray, shape (h, w) or (h, w, 3)
        Grey of 8 or 16 bits, or colour of 8 bits.

    Raises
    ------
    BrokenMessageError
        If the bytes are no picture.
    InputError
        If the encoding is not read.
    """
    if hasattr(message, "format"):
        try:
            return decode_image(bytes(message.data), name)
        except InputError as failure:
            raise BrokenMessageError(f"{failure} (format {message.format!r})") from None
    encoding = str(message.encoding).lower()
    if encoding not in _ENCODINGS:
        raise InputError(
            f"{name}: expected an encoding of {', '.join(_ENCODINGS)}, found {message.encoding!r}"
        )
    size, channels, order = _ENCODINGS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    row = width * channels * size
    if not row or not height or step < row or len(data) < height * step:
        raise BrokenMessageError(
            f"{name}: expected {height} rows of at least {row} bytes, found {len(data)} bytes in rows of {step}"
        )
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    if size > 1:
        swapped = bool(message.is_bigendian) != (sys.byteorder == "big")
        wide = rows.view(np.uint16)
        return wide.byteswap() if swapped else wide
    pixels = rows.reshape(height, width, channels)[..., order]
    return pixels if len(order) > 1 else pixels[..., 0]


def rigid_pose(message: Any, name: str, mm_per_unit: float = MM_PER_METRE) -> Float64[np.ndarray, "4 4"]:
    """Convert a PoseStamped (frame_id_T_body) or a TransformStamped (frame_id_T_child) to a matrix in mm.

    Parameters
    ----------
    message : Any
        Message.
    name : str
        Its name, for messages.
    mm_per_unit : float, optional
        Millimetres in the unit of its positions.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform in mm.

    Raises
    ------
    BrokenMessageError
        If the position is not finite or the quaternion off length 1 by more than 1 %; others are scaled to
        length 1.
    """
    if hasattr(message, "pose"):
        place, turn = message.pose.position, message.pose.orientation
    else:
        place, turn = message.transform.translation, message.transform.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    position = np.array([place.x, place.y, place.z], dtype=np.float64)
    if not (unit_quaternions(quaternion[None])[0] and np.isfinite(position).all()):
        raise BrokenMessageError(
            f"{name}: expected a finite position and a unit quaternion, "
            f"found {position.tolist()} and length {np.linalg.norm(quaternion):.4g}"
        )
    return transforms.from_rotation(Rotation.from_quat(quaternion), position * mm_per_unit)
