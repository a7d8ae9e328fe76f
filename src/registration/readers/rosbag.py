"""Tracked sweeps from and to ROS 2 bags (``.db3`` and ``.mcap``), without an installation of ROS."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.readers.calibration_file import read_calibration
from registration.readers.ros_messages import grey_image, rigid_pose, stamp_s
from registration.readers.ros_tf import TransformTree
from registration.readers.streams import distinct_times
from registration.sweep import TrackedSweep

CALIBRATION_FILE = "calibration.yaml"
IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
TF_TYPES = ("tf2_msgs/msg/TFMessage",)


@dataclass(frozen=True)
class RosbagReader:
    """Read a tracked sweep from a ROS 2 bag, whose lengths are metres and whose times are those of the headers.

    ``image_topic`` carries Image (mono8, rgb8, bgr8, rgba8, bgra8) or CompressedImage (JPEG, PNG). Poses come from
    ``pose_topic`` (PoseStamped or TransformStamped), or, where that is None, from the chain ``world`` to ``ee`` of
    ``tf_topics``; a topic that ends in ``_static`` holds at all times. ``calibration`` is a YAML or XML file; without
    it, ``calibration.yaml`` in the bag's folder. ``out_of_order`` says what to do with headers whose times run
    backwards: ``refuse``, or ``sort`` by them. ``tf_max_gap_s`` bounds the gap over which a link of the chain may be
    interpolated.
    """

    image_topic: str
    pose_topic: str | None = None
    world: str | None = None
    ee: str | None = None
    tf_topics: tuple[str, ...] | list[str] = ("/tf", "/tf_static")
    calibration: str | Path | None = None
    out_of_order: str = "refuse"
    tf_max_gap_s: float = 0.1

    def __post_init__(self) -> None:
        if self.pose_topic is None and (self.world is None or self.ee is None):
            raise InputError("pose_topic: expected a topic, or world and ee of a tf2 chain, received neither")
        if self.out_of_order not in ("refuse", "sort"):
            raise InputError(f"out_of_order: expected refuse or sort, received {self.out_of_order!r}")
        if not self.tf_max_gap_s > 0:
            raise InputError(f"tf_max_gap_s: expected a number above 0, received {self.tf_max_gap_s!r}")

    def __call__(self, path: Path) -> TrackedSweep:
        """Read the sweep. Raises InputError, naming the bag, for missing topics or types and unreadable messages."""
        path = bag_folder(path)
        calibration_path = Path(self.calibration) if self.calibration else path / CALIBRATION_FILE
        calibration = read_calibration(calibration_path)
        with _opened(path) as reader:
            image_times_s, images = self._images(reader, path)
            pose_times_s, world_T_ee = self._poses(reader, path)
        order = np.argsort(image_times_s, kind="stable")
        if self.out_of_order == "refuse" and (np.diff(image_times_s) < 0).any():
            raise InputError(
                f"{path}: expected images of {self.image_topic} in the order of their header times, "
                f"found times that run backwards (out_of_order=sort accepts them)"
            )
        return TrackedSweep(images[order], image_times_s[order], world_T_ee, pose_times_s, calibration)

    def _images(self, reader: Any, path: Path) -> tuple[np.ndarray, np.ndarray]:
        times: list[float] = []
        images: list[np.ndarray] = []
        for _, message in _messages(reader, self.image_topic, IMAGE_TYPES, path):
            name = f"{path}: {self.image_topic} message {len(images)}"
            times.append(stamp_s(message))
            images.append(grey_image(message, name))
            if images[-1].shape != images[0].shape:
                raise InputError(
                    f"{name}: expected the first image's size {images[0].shape}, found {images[-1].shape}"
                )
        if not images:
            raise InputError(f"{path}: expected images on {self.image_topic}, found none")
        return np.array(times, dtype=np.float64), np.stack(images)

    def _poses(self, reader: Any, path: Path) -> tuple[np.ndarray, np.ndarray]:
        if self.pose_topic is None:
            return self._tf_poses(reader, path)
        times: list[float] = []
        poses: list[np.ndarray] = []
        for _, message in _messages(reader, self.pose_topic, POSE_TYPES, path):
            name = f"{path}: {self.pose_topic} message {len(poses)}"
            self._check_frames(message, name)
            times.append(stamp_s(message))
            poses.append(rigid_pose(message, name))
        if not poses:
            raise InputError(f"{path}: expected poses on {self.pose_topic}, found none")
        times_s, world_T_ee = np.array(times, dtype=np.float64), np.stack(poses)
        if self.out_of_order == "sort":
            order = np.argsort(times_s, kind="stable")
            times_s, world_T_ee = times_s[order], world_T_ee[order]
        return distinct_times(times_s, world_T_ee, f"{path}: {self.pose_topic}")

    def _check_frames(self, message: Any, name: str) -> None:
        """A pose of another body, or in another frame, than the settings say is refused."""
        said = {"world": message.header.frame_id, "ee": getattr(message, "child_frame_id", "")}
        for key, wanted in (("world", self.world), ("ee", self.ee)):
            if wanted and said[key] and said[key].lstrip("/") != wanted.lstrip("/"):
                raise InputError(f"{name}: expected {key} {wanted!r}, found frame {said[key]!r}")

    def _tf_poses(self, reader: Any, path: Path) -> tuple[np.ndarray, np.ndarray]:
        assert self.world is not None and self.ee is not None
        tree = TransformTree()
        present = {connection.topic for connection in reader.connections}
        for topic in (topic for topic in self.tf_topics if topic in present):
            for _, message in _messages(reader, topic, TF_TYPES, path):
                for link in message.transforms:
                    time_s = None if topic.endswith("_static") else stamp_s(link)
                    parent_T_child = rigid_pose(link, f"{path}: {topic} {link.child_frame_id}")
                    tree.add(link.child_frame_id, link.header.frame_id, time_s, parent_T_child)
        if self.out_of_order == "sort":
            for stream in tree.moving.values():
                stream.sort(key=lambda entry: entry[0])
        return tree.poses(self.world, self.ee, self.tf_max_gap_s, str(path))


def bag_folder(path: Path) -> Path:
    """The folder of a bag, given it or the ``.db3`` or ``.mcap`` file in it."""
    folder = path.parent if path.suffix in (".db3", ".mcap") else path
    if not (folder / "metadata.yaml").is_file():
        raise InputError(f"{path}: expected a ROS 2 bag (a folder with metadata.yaml), found none")
    return folder


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An open reader of the bag; whatever it stumbles over becomes one sentence that names the bag."""
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.rosbag2 import ReaderError
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except (AnyReaderError, ReaderError, SerdeError, sqlite3.Error, OSError, EOFError) as failure:
        raise InputError(
            f"{path}: expected a readable ROS 2 bag, found a broken one ({failure})"
        ) from failure


def _messages(reader: Any, topic: str, types: tuple[str, ...], path: Path) -> Iterator[tuple[int, Any]]:
    """The decoded messages of a topic in the order in which they were recorded."""
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if not connections:
        known = ", ".join(f"{connection.topic} ({connection.msgtype})" for connection in reader.connections)
        raise InputError(f"{path}: expected the topic {topic}, found {known or 'no topic'}")
    for connection in connections:
        if connection.msgtype not in types:
            raise InputError(f"{path}: expected {' or '.join(types)} on {topic}, found {connection.msgtype}")
    for connection, time_ns, raw in reader.messages(connections=connections):
        yield time_ns, reader.deserialize(raw, connection.msgtype)
