"""Tracked sweeps from and to ROS 2 bags (``.db3`` and ``.mcap``), without an installation of ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.input_files import refusing
from registration.readers.plus.calibration_file import read_calibration
from registration.readers.rosbag.bags import (
    NO_TIME,
    TIMES,
    UNREADABLE,
    find_bag,
    messages,
    opened_bag,
    topic_messages,
    with_time,
)
from registration.readers.rosbag.messages import BrokenMessageError, image_pixels, rigid_pose, stamp_s
from registration.readers.rosbag.transforms import TransformTree
from registration.readers.streams.checks import distinct_times
from registration.readers.streams.image_files import grey_stack
from registration.readers.streams.pose_values import MM_PER_UNIT, require_unit
from registration.sweep import POSE_DROPPED, TrackedSweep

CALIBRATION_FILE = "calibration.yaml"
IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
TF_TYPES = ("tf2_msgs/msg/TFMessage",)


@dataclass(frozen=True)
class RosbagReader:
    """Read a tracked sweep from a ROS 2 bag. Messages that hold no value are left out and counted.

    Parameters
    ----------
    image_topic
        Carries Image (mono8, mono16, rgb8, bgr8, rgba8, bgra8) or CompressedImage (JPEG, PNG).
    pose_topic
        Carries PoseStamped or TransformStamped. None: the chain from ``world`` to ``ee`` of ``tf_topics``.
    world, ee
        Names of coordinate frames: the ends of the tf2 chain, or those that the poses' headers must name.
    tf_topics
        Topics of the chain's links; one that ends in ``_static`` holds at all times.
    calibration
        A YAML or XML file. None: ``calibration.yaml`` in the bag's folder.
    out_of_order
        What to do with times that run backwards: ``refuse``, or ``sort`` by them.
    tf_max_gap_s
        A link of the chain is interpolated over no longer gap.
    times
        ``header``, or ``recorded`` where the headers have no times.
    units
        Of positions: ``m`` or ``mm``. None: metres, as ROS has them, refused if they span what no sweep does.
    """

    image_topic: str
    pose_topic: str | None = None
    world: str | None = None
    ee: str | None = None
    tf_topics: tuple[str, ...] | list[str] = ("/tf", "/tf_static")
    calibration: str | Path | None = None
    out_of_order: str = "refuse"
    tf_max_gap_s: float = 0.1
    times: str = "header"
    units: str | None = None

    def __post_init__(self) -> None:
        if self.pose_topic is None and (self.world is None or self.ee is None):
            raise InputError("pose_topic: expected a topic, or world and ee of a tf2 chain, received neither")
        if self.out_of_order not in ("refuse", "sort"):
            raise InputError(f"out_of_order: expected refuse or sort, received {self.out_of_order!r}")
        if not self.tf_max_gap_s > 0:
            raise InputError(f"tf_max_gap_s: expected a number above 0, received {self.tf_max_gap_s!r}")
        if self.times not in TIMES:
            raise InputError(f"times: expected {' or '.join(TIMES)}, received {self.times!r}")
        if self.units not in (None, *MM_PER_UNIT):
            raise InputError(f"units: expected mm, m or none, received {self.units!r}")

    def __call__(self, path: Path) -> TrackedSweep:
        """Read a sweep.

        Parameters
        ----------
        path : Path
            Folder or file of the bag.

        Returns
        -------
        TrackedSweep
            Frames and poses as recorded.

        Raises
        ------
        InputError
            If a topic is missing or of another type, or messages cannot be read.
        """
        path = find_bag(path)
        folder = path if path.is_dir() else path.parent
        calibration = read_calibration(
            Path(self.calibration) if self.calibration else folder / CALIBRATION_FILE
        )
        dropped: Counter[str] = Counter()
        with refusing(path, "a readable ROS 2 bag"), opened_bag(path) as reader:
            image_times_s, images = self._images(reader, path, dropped)
            pose_times_s, world_T_ee = self._poses(reader, path, dropped)
        if self.units is None:
            setting = "set acquisition=ros2 acquisition.units=mm, or =m to take them as they are"
            require_unit(world_T_ee[:, :3, 3], "m", str(path), setting)
        order = np.argsort(image_times_s, kind="stable")
        if self.out_of_order == "refuse" and (np.diff(image_times_s) < 0).any():
            raise InputError(
                f"{path}: expected images of {self.image_topic} in the order of their header times, "
                f"found times that run backwards (out_of_order=sort accepts them)"
            )
        with refusing(path, "a tracked sweep"):
            return TrackedSweep(
                images[order], image_times_s[order], world_T_ee, pose_times_s, calibration, dict(dropped)
            )

    def _images(self, reader: Any, path: Path, dropped: Counter[str]) -> tuple[np.ndarray, np.ndarray]:
        sizes: list[tuple[int, ...]] = []

        def pixels(message: Any, name: str) -> np.ndarray:
            found = image_pixels(message, name)
            sizes.append(found.shape[:2])
            if sizes[-1] != sizes[0]:
                raise InputError(f"{name}: expected the first image's size {sizes[0]}, found {sizes[-1]}")
            return found

        name = f"{path}: {self.image_topic}"
        read = messages(reader, self.image_topic, IMAGE_TYPES, path)
        found = topic_messages(read, pixels, self.times, name)
        dropped.update({f"image: {reason}": count for reason, count in found.dropped.items()})
        return found.times_s, grey_stack(found.values, name)

    def _poses(self, reader: Any, path: Path, dropped: Counter[str]) -> tuple[np.ndarray, np.ndarray]:
        if self.pose_topic is None:
            return self._tf_poses(reader, path, dropped)

        def pose(message: Any, name: str) -> np.ndarray:
            self._check_frames(message, name)
            return rigid_pose(message, name, self._mm_per_unit)

        name = f"{path}: {self.pose_topic}"
        found = topic_messages(messages(reader, self.pose_topic, POSE_TYPES, path), pose, self.times, name)
        dropped.update({POSE_DROPPED + reason: count for reason, count in found.dropped.items()})
        times_s, world_T_ee = found.times_s, np.stack(found.values)
        if self.out_of_order == "sort":
            order = np.argsort(times_s, kind="stable")
            times_s, world_T_ee = times_s[order], world_T_ee[order]
        return distinct_times(times_s, world_T_ee, name)

    @property
    def _mm_per_unit(self) -> float:
        return MM_PER_UNIT[self.units or "m"]

    def _check_frames(self, message: Any, name: str) -> None:
        """Refuse a pose of another body, or in another coordinate frame, than the settings name."""
        recorded = {"world": message.header.frame_id, "ee": getattr(message, "child_frame_id", "")}
        for key, wanted in (("world", self.world), ("ee", self.ee)):
            if wanted and recorded[key] and recorded[key].lstrip("/") != wanted.lstrip("/"):
                raise InputError(f"{name}: expected {key} {wanted!r}, found frame {recorded[key]!r}")

    def _tf_poses(self, reader: Any, path: Path, dropped: Counter[str]) -> tuple[np.ndarray, np.ndarray]:
        assert self.world is not None and self.ee is not None
        tree = TransformTree()
        present = {connection.topic for connection in reader.connections}
        for topic in (topic for topic in self.tf_topics if topic in present):
            static = topic.endswith("_static")
            for time_ns, message in messages(reader, topic, TF_TYPES, path):
                if message is None:
                    dropped[f"{POSE_DROPPED}{topic}: {UNREADABLE}"] += 1
                else:
                    self._add_links(tree, message.transforms, None if static else time_ns * 1e-9)
        self._finish_chain(tree, path, dropped)
        return tree.poses(self.world, self.ee, self.tf_max_gap_s, str(path))

    def _add_links(self, tree: TransformTree, links: Iterable[Any], recorded_s: float | None) -> None:
        """Add the links of one message; ``recorded_s`` is None for static ones."""
        for link in links:
            child, parent = link.child_frame_id, link.header.frame_id
            time_s = recorded_s if recorded_s is None or self.times == "recorded" else stamp_s(link)
            try:
                tree.add(child, parent, time_s, rigid_pose(link, child, self._mm_per_unit))
            except BrokenMessageError:
                tree.add_broken(child, parent)

    def _finish_chain(self, tree: TransformTree, path: Path, dropped: Counter[str]) -> None:
        """Leave out what has no time, sort if asked to, and count what was left out, for the links of the chain."""
        for pair in tree.chain_links(str(self.world), str(self.ee), str(path)):
            name = f"{pair[0]} to {pair[1]}"
            if tree.broken[pair]:
                dropped[f"{POSE_DROPPED}{name} without a valid transform"] += tree.broken[pair]
            stream = tree.moving.get(pair)
            if stream is None:
                continue
            if self.times == "header":
                keep = with_time(np.array([time_s for time_s, _ in stream]), f"{path}: {name}")
                if not keep.all():
                    dropped[f"{POSE_DROPPED}{name}: {NO_TIME}"] += int((~keep).sum())
                    tree.moving[pair] = stream = [one for one, kept in zip(stream, keep, strict=True) if kept]
            if self.out_of_order == "sort":
                stream.sort(key=lambda entry: entry[0])
