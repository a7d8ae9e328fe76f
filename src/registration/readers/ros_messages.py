"""What ROS messages say in this project's terms: seconds, millimetres, 8-bit grey."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image
from scipy.spatial.transform import Rotation

from registration import frames
from registration.errors import InputError
from registration.readers.streams import as_grey

# ROS lengths are metres (REP 103, Standard Units of Measure and Coordinate Conventions).
MM_PER_METRE = 1000.0
# Channels of the encodings in sensor_msgs/image_encodings.hpp, and which of them are red, green and blue.
_ENCODINGS: dict[str, tuple[int, tuple[int, ...]]] = {
    "mono8": (1, (0,)),
    "8uc1": (1, (0,)),
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "8uc3": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
}
_QUATERNION_TOLERANCE = 1e-3


def stamp_s(message: Any) -> float:
    """The time in a message's header, in seconds."""
    return float(message.header.stamp.sec) + float(message.header.stamp.nanosec) * 1e-9


def grey_image(message: Any, name: str) -> UInt8[np.ndarray, "height width"]:
    """The picture of a sensor_msgs Image or CompressedImage; ``name`` says whose, for messages."""
    if hasattr(message, "format"):
        try:
            with Image.open(io.BytesIO(bytes(message.data))) as picture:
                return np.asarray(picture.convert("L"), dtype=np.uint8)
        except OSError as failure:
            raise InputError(
                f"{name}: expected a JPEG or PNG picture, found {message.format!r} ({failure})"
            ) from None
    encoding = str(message.encoding).lower()
    if encoding not in _ENCODINGS:
        raise InputError(
            f"{name}: expected an encoding of {', '.join(_ENCODINGS)}, found {message.encoding!r}"
        )
    channels, order = _ENCODINGS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    if step < width * channels or len(data) < height * step:
        raise InputError(
            f"{name}: expected {height} rows of at least {width * channels} bytes, "
            f"found {len(data)} bytes in rows of {step}"
        )
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    pixels = rows.reshape(1, height, width, channels)[..., order]
    return as_grey(pixels, name)[0]


def rigid_pose(message: Any, name: str) -> Float64[np.ndarray, "4 4"]:
    """The transform in a PoseStamped (frame_id_T_body) or TransformStamped (frame_id_T_child), in mm."""
    if hasattr(message, "pose"):
        place, turn = message.pose.position, message.pose.orientation
    else:
        place, turn = message.transform.translation, message.transform.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    position_mm = np.array([place.x, place.y, place.z], dtype=np.float64) * MM_PER_METRE
    norm = float(np.linalg.norm(quaternion))
    if not (abs(norm - 1) <= _QUATERNION_TOLERANCE and np.isfinite(position_mm).all()):
        raise InputError(
            f"{name}: expected a finite position and a unit quaternion, "
            f"found {(position_mm / MM_PER_METRE).tolist()} m and length {norm:.4g}"
        )
    return frames.from_rotation(Rotation.from_quat(quaternion), position_mm)
