"""The messages of a ROS 2 bag (``.db3`` and ``.mcap``), with or without its metadata.yaml."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, beside, read_regular, refusing, require_regular
from registration.readers.plus.calibration_file import read_yaml
from registration.readers.rosbag.messages import BrokenMessageError, stamp_s

SUFFIXES = (".db3", ".mcap")
METADATA = "metadata.yaml"
TIMES = ("header", "recorded")
UNREADABLE = "message that cannot be read"
NO_TIME = "message without a header time"
# Drivers that never set a header leave it at 1970. Clocks of robots count from 1970, or from when they were started.
_UNSET_BEFORE_S = 86400.0


@dataclass(frozen=True)
class TopicMessages:
    """What one topic holds.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Time of each message in s.
    values : list
        Value of each message.
    dropped : collections.Counter
        Messages left out, counted by reason.
    """

    times_s: np.ndarray
    values: list[Any]
    dropped: Counter[str]


def find_bag(path: Path) -> Path:
    """Find the folder of a bag with metadata.yaml, or its only file where there is no metadata.

    Parameters
    ----------
    path : Path
        Folder, or one of the files in it.

    Returns
    -------
    Path
        Folder or file.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if path.suffix.lower() in SUFFIXES and path.is_file():
        metadata = path.parent / METADATA
        listed = metadata.is_file() and path.name in read_regular(metadata, LARGEST_TEXT_BYTES).decode(
            errors="replace"
        )
        return path.parent if listed else path
    if (path / METADATA).is_file():
        return path
    files = (
        sorted(file for file in path.glob("*") if file.suffix.lower() in SUFFIXES) if path.is_dir() else []
    )
    files = [file for file in files if not file.name.startswith(".")]
    if len(files) != 1:
        found = f"{len(files)} files of bags without it" if files else "none"
        raise InputError(
            f"{path}: expected a ROS 2 bag (a folder with {METADATA}, or a single .mcap or .db3), found {found}"
        )
    return files[0]


@contextmanager
def opened_bag(path: Path) -> Iterator[Any]:
    """Open a bag; whatever its reader stumbles over becomes one sentence that names the bag.

    Parameters
    ----------
    path : Path
        Folder or file of the bag.

    Yields
    ------
    rosbags.highlevel.AnyReader
        Open reader.

    Raises
    ------
    InputError
        If the bag cannot be read.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with refusing(path, "a readable ROS 2 bag"):
        _require_plain_bag(path)
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader


def messages(reader: Any, topic: str, types: tuple[str, ...], path: Path) -> Iterator[tuple[int, Any]]:
    """Read the messages of a topic in the order of recording.

    Parameters
    ----------
    reader : rosbags.highlevel.AnyReader
        Open reader of the bag.
    topic : str
        Topic.
    types : tuple of str
        Types of messages that are read.
    path : Path
        Name of the bag, for messages.

    Yields
    ------
    time_ns : int
        Time of recording in ns.
    message : Any
        Message, None where its bytes do not decode.

    Raises
    ------
    InputError
        If the topic is missing or of another type.
    """
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if not connections:
        known = ", ".join(f"{connection.topic} ({connection.msgtype})" for connection in reader.connections)
        raise InputError(f"{path}: expected the topic {topic}, found {known or 'no topic'}")
    for connection in connections:
        if connection.msgtype not in types:
            raise InputError(f"{path}: expected {' or '.join(types)} on {topic}, found {connection.msgtype}")
    for connection, time_ns, raw in reader.messages(connections=connections):
        yield time_ns, _decoded(reader, raw, connection.msgtype)


def topic_messages(
    read: Iterator[tuple[int, Any]], value_of: Callable[[Any, str], Any], times: str, name: str
) -> TopicMessages:
    """Collect every message of a topic that holds a value.

    Parameters
    ----------
    read : iterator of (int, Any)
        Times of recording in ns and messages.
    value_of : callable
        Gets a message and its name, and raises BrokenMessageError where there is no value in it.
    times : str
        Which time counts: that of the header or that of recording.
    name : str
        Name of the topic, for messages.

    Returns
    -------
    TopicMessages
        Times, values and what was left out.

    Raises
    ------
    InputError
        If no message is left, or no header has a time.
    """
    times_s: list[float] = []
    values: list[Any] = []
    dropped: Counter[str] = Counter()
    first = ""
    for number, (time_ns, message) in enumerate(read):
        if message is None:
            dropped[UNREADABLE] += 1
            continue
        try:
            values.append(value_of(message, f"{name} message {number}"))
        except BrokenMessageError as broken:
            dropped["message without a valid value"] += 1
            first = first or f": {broken}"
            continue
        times_s.append(stamp_s(message) if times == "header" else time_ns * 1e-9)
    if not values:
        found = f"{sum(dropped.values())} broken ones{first}" if dropped else "none"
        raise InputError(f"{name}: expected valid messages, found {found}")
    timed = np.array(times_s, dtype=np.float64)
    keep = with_time(timed, name) if times == "header" else np.ones(len(timed), dtype=bool)
    if not keep.all():
        dropped[NO_TIME] += int((~keep).sum())
    return TopicMessages(
        timed[keep], [value for value, kept in zip(values, keep, strict=True) if kept], dropped
    )


def with_time(times_s: np.ndarray, name: str) -> np.ndarray:
    """Tell which header times were set: those at 0 were not, unless the clock began there.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times in s.
    name : str
        Name of the topic, for messages.

    Returns
    -------
    ndarray of bool, shape (n,)
        Which were set.

    Raises
    ------
    InputError
        If none was.
    """
    unset = times_s == 0
    if len(times_s) > 1 and unset.all():
        raise InputError(
            f"{name}: expected times in the headers, found 0 in all {len(times_s)} "
            "(acquisition=ros2 acquisition.times=recorded takes the times of recording)"
        )
    began_there = times_s[~unset].min(initial=np.inf) < _UNSET_BEFORE_S
    return (
        ~unset if unset.any() and not began_there and not unset.all() else np.ones(len(times_s), dtype=bool)
    )


def _decoded(reader: Any, raw: bytes, kind: str) -> Any:
    try:
        return reader.deserialize(raw, kind)
    except Exception:  # whatever the library stumbles over: the other messages may be whole
        return None


def _require_plain_bag(path: Path) -> None:
    """Refuse metadata that name files elsewhere, and files that are none, before the library opens them."""
    if not path.is_dir():
        require_regular(path)
        return
    about = read_yaml(path / METADATA).get("rosbag2_bagfile_information")
    listed = about.get("relative_file_paths") if isinstance(about, dict) else None
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise InputError(f"{path / METADATA}: expected relative_file_paths, found none")
    for name in listed:
        require_regular(beside(path / METADATA, name))
