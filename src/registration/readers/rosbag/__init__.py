"""ROS 2 bags."""

from registration.readers.rosbag.reader import (
    CALIBRATION_FILE,
    IMAGE_TYPES,
    POSE_TYPES,
    TF_TYPES,
    RosbagReader,
)

__all__ = ["CALIBRATION_FILE", "IMAGE_TYPES", "POSE_TYPES", "TF_TYPES", "RosbagReader"]
