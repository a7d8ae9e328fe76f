"""A tracked sweep from wherever it lies: the reader is chosen by what the path is."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields
from pathlib import Path

from registration.errors import InputError
from registration.readers.folder import FolderReader
from registration.readers.plus.fields import SUFFIXES
from registration.readers.plus.reader import PlusReader
from registration.readers.rosbag.bags import METADATA
from registration.readers.rosbag.bags import SUFFIXES as BAG_SUFFIXES
from registration.readers.rosbag.reader import RosbagReader
from registration.sweep import TrackedSweep


@dataclass(frozen=True)
class AutoReader:
    """Read a plain folder, a PLUS sequence file or a ROS 2 bag, each by the reader given for it.

    A folder that holds nothing but a sweep under the name ``sweep`` (as ``study=convert`` leaves it) stands
    for that.

    Parameters
    ----------
    folder : FolderReader, optional
        Reader for plain folders.
    plus : PlusReader, optional
        Reader for PLUS sequence files.
    ros2 : RosbagReader, optional
        Reader for bags; the default takes the topics that this project writes, other bags need
        ``acquisition=ros2`` with topics.
    """

    folder: FolderReader = field(default_factory=FolderReader)
    plus: PlusReader = field(default_factory=PlusReader)
    ros2: RosbagReader = field(
        default_factory=lambda: RosbagReader(image_topic="/us/image", pose_topic="/robot/ee_pose")
    )

    def __call__(self, path: Path) -> TrackedSweep:
        """Read a sweep.

        Parameters
        ----------
        path : Path
            Folder, sequence file or bag.

        Returns
        -------
        TrackedSweep
            Frames and poses as recorded.

        Raises
        ------
        InputError
            If the path is none of the three, or its reader refuses it.
        """
        try:
            return self._read(path)
        except InputError as refusal:
            raise InputError(f"{refusal}{self._option_of(str(refusal))}") from refusal

    def _option_of(self, message: str) -> str:
        """Which option has the settings that a reader's message advises: this reader has none of them itself."""
        if "acquisition=" in message:
            return ""
        for option in ("folder", "plus", "ros2"):
            names = [each.name for each in fields(getattr(self, option))]
            advised = [name for name in names if re.search(rf"\bset {name}\b|\b{name}=", message)]
            if advised:
                settings = " or ".join(f"acquisition.{name}=" for name in advised)
                return f" (pass acquisition={option} and {settings})"
        return ""

    def _read(self, path: Path) -> TrackedSweep:
        if path.is_file() and path.suffix.lower() in SUFFIXES:
            return self.plus(path)
        if path.suffix.lower() in BAG_SUFFIXES or (path / METADATA).is_file():
            return self.ros2(path)
        if (path / "sweep.yaml").is_file():
            return self.folder(path)
        if _holds_bag_file(path):
            return self.ros2(path)
        inside = [path / "sweep", *(path / f"sweep.igs{suffix}" for suffix in SUFFIXES)]
        for candidate in inside:
            if candidate.exists():
                return self(candidate)
        raise InputError(
            f"{path}: expected a folder with sweep.yaml, a PLUS sequence ({', '.join(SUFFIXES)}) or a ROS 2 bag, found "
            f"{'none of them' if path.exists() else 'nothing'}"
        )


def _holds_bag_file(path: Path) -> bool:
    return any(
        file.suffix.lower() in BAG_SUFFIXES and not file.name.startswith(".") for file in path.glob("*")
    )
