"""Tracked sweeps to ROS 2 bags: mono8 images, stamped poses in metres, the calibration next to them."""

from __future__ import annotations

import heapq
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from registration.errors import InputError
from registration.io.atomic import atomic_folder
from registration.readers.plus.calibration_file import calibration_yaml
from registration.readers.rosbag.messages import MM_PER_METRE
from registration.readers.rosbag.reader import CALIBRATION_FILE, IMAGE_TYPES, POSE_TYPES
from registration.sweep import TrackedSweep

STORAGES = ("sqlite3", "mcap")
_MAX_TIME_S = 2**31


def write_bag(
    path: Path,
    sweep: TrackedSweep,
    storage: str = "mcap",
    image_topic: str = "/us/image",
    pose_topic: str = "/robot/ee_pose",
    world: str = "world",
) -> None:
    """Write a sweep as a bag; both streams keep their own times, to the nanosecond.

    Parameters
    ----------
    path : Path
        Folder, which must be absent or empty.
    sweep : TrackedSweep
        Sweep.
    storage : {'mcap', 'sqlite3'}, optional
        Kind of storage.
    image_topic : str, optional
        Topic of the frames.
    pose_topic : str, optional
        Topic of the poses.
    world : str, optional
        Coordinate frame in the headers of the poses.

    Raises
    ------
    InputError
        If a setting is another, a time is larger than the 32 bits of ROS can hold, or the frames differ in
        calibration.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    if storage not in STORAGES:
        raise InputError(f"storage: expected {' or '.join(STORAGES)}, received {storage!r}")
    times_s = np.concatenate([sweep.image_times_s, sweep.pose_times_s])
    if np.abs(times_s).max(initial=0) >= _MAX_TIME_S:
        raise InputError(f"sweep: expected times below {_MAX_TIME_S} s for a ROS bag, received larger ones")
    sweep.require_one_calibration("a ROS bag")
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with atomic_folder(path) as stage:
        # The writer wants to make the bag's folder itself, and names the files in it after the folder.
        bag = stage / path.name
        with Writer(bag, version=9, storage_plugin=plugin) as writer:
            _write_streams(writer, sweep, image_topic, pose_topic, world)
        for file in bag.iterdir():
            file.rename(stage / file.name)
        bag.rmdir()
        (stage / CALIBRATION_FILE).write_text(calibration_yaml(sweep.calibration), encoding="utf-8")


def _write_streams(writer: Any, sweep: TrackedSweep, image_topic: str, pose_topic: str, world: str) -> None:
    """Write both streams merged in the order of time, one message at a time."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    image_connection = writer.add_connection(image_topic, IMAGE_TYPES[0], typestore=store)
    pose_connection = writer.add_connection(pose_topic, POSE_TYPES[0], typestore=store)
    images = ((_nanoseconds(time_s), 0, index) for index, time_s in enumerate(sweep.image_times_s))
    poses = ((_nanoseconds(time_s), 1, index) for index, time_s in enumerate(sweep.pose_times_s))
    for time_ns, kind, index in heapq.merge(sorted(images), poses):
        if kind == 0:
            connection, message = image_connection, _image_message(store.types, sweep.images[index], time_ns)
        else:
            connection = pose_connection
            message = _pose_message(store.types, sweep.world_T_ee[index], time_ns, world)
        # Headers may speak of times before 0, the time of recording may not.
        writer.write(connection, max(0, time_ns), store.serialize_cdr(message, connection.msgtype))


def _nanoseconds(time_s: float) -> int:
    return round(float(time_s) * 1e9)


def _header(types: Any, time_ns: int, frame_id: str) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _image_message(types: Any, image: np.ndarray, time_ns: int) -> Any:
    height, width = image.shape
    return types[IMAGE_TYPES[0]](
        header=_header(types, time_ns, "image"),
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(image).reshape(-1),
    )


def _pose_message(types: Any, world_T_ee: np.ndarray, time_ns: int, world: str) -> Any:
    position_m = world_T_ee[:3, 3] / MM_PER_METRE
    quaternion = Rotation.from_matrix(world_T_ee[:3, :3]).as_quat()
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](*map(float, position_m)),
        orientation=types["geometry_msgs/msg/Quaternion"](*map(float, quaternion)),
    )
    return types[POSE_TYPES[0]](header=_header(types, time_ns, world), pose=pose)
