"""Record a tracked ultrasound stream from an OpenIGTLink server (PLUS, 3D Slicer, a robot's bridge).

The connection is kept here, because pyigtl's own client holds only the latest message of each device, drops the
others, and does not notice that a server has gone.
"""

from __future__ import annotations

import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from registration import transforms
from registration.checks import require_positive
from registration.errors import InputError
from registration.readers.openigtlink import Arrival, ConnectionEnded, next_message
from registration.readers.plus.calibration_file import read_calibration
from registration.readers.plus.sequence import to_mf
from registration.readers.streams.checks import as_grey, distinct_times
from registration.sweep import ProbeCalibration, TrackedSweep

_POLL_S = 0.1


@dataclass(frozen=True)
class Interruption:
    """A time without connection.

    Parameters
    ----------
    began_s : float
        When it began, in s by the recorder's clock from its start.
    ended_s : float
        When it ended.
    message_cut : bool
        Whether a message was cut in two.
    """

    began_s: float
    ended_s: float
    message_cut: bool


@dataclass(frozen=True)
class Recording:
    """A recorded sweep and how the recording went.

    Parameters
    ----------
    sweep : TrackedSweep
        Frames and poses.
    interruptions : tuple of Interruption
        Times without connection.
    received : dict of str to int
        Messages received by kind and device.
    """

    sweep: TrackedSweep
    interruptions: tuple[Interruption, ...]
    received: dict[str, int]


@dataclass
class _Streams:
    """What has arrived so far."""

    images: list[np.ndarray] = field(default_factory=list)
    image_times_s: list[float] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)
    pose_times_s: list[float] = field(default_factory=list)
    received: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    interruptions: list[Interruption] = field(default_factory=list)
    heard_s: float = 0.0
    connected: bool = False


@dataclass(frozen=True)
class LiveRecorder:
    """Connect to an OpenIGTLink server and record images with poses.

    A lost connection is taken up again as often as needed. Frames that were missed while the connection was
    lost are estimated from the frame rate and counted in ``sweep.dropped``.

    Parameters
    ----------
    image_device : str
        Device that sends the images.
    pose_device : str
        Device that sends TRANSFORM messages that map the end effector to the world, in mm
        (``ProbeToReference``).
    calibration : str or Path
        YAML or XML file of the probe's calibration.
    host : str, optional
        Name or address of the server.
    port : int, optional
        Port of the server.
    orientation : str, optional
        Orientation of the images sent, as PLUS names it.
    give_up_s : float, optional
        Time in s without any message (a server that stays away, a cable that was pulled) after which the
        recording ends.
    """

    image_device: str
    pose_device: str
    calibration: str | Path
    host: str = "127.0.0.1"
    port: int = 18944
    orientation: str = "MF"
    give_up_s: float = 10.0

    def __post_init__(self) -> None:
        require_positive("give_up_s", self.give_up_s)
        if isinstance(self.port, bool) or not 0 < self.port < 65536:
            raise InputError(f"port: expected a number from 1 to 65535, received {self.port!r}")

    @property
    def _server(self) -> str:
        return f"{self.host}:{self.port}"

    def __call__(
        self,
        duration_s: float | None = None,
        max_frames: int | None = None,
        stop: threading.Event | None = None,
        on_frame: Callable[[int], None] | None = None,
    ) -> Recording:
        """Record until a time, a number of frames or an event, whichever comes first; one must be given.

        Parameters
        ----------
        duration_s : float, optional
            Length of the recording in s.
        max_frames : int, optional
            Largest number of frames.
        stop : threading.Event, optional
            Event that ends the recording.
        on_frame : callable, optional
            Called with the number of frames after each.

        Returns
        -------
        Recording
            Sweep and how the recording went.

        Raises
        ------
        InputError
            If no end was given, no connection was made at all, the stream is no OpenIGTLink, or it ended
            without a frame or a pose.
        """
        if duration_s is None and max_frames is None and stop is None:
            raise InputError(
                "duration_s, max_frames, stop: expected at least one end to the recording, received none"
            )
        calibration = read_calibration(Path(self.calibration))
        streams, began = _Streams(), time.monotonic()

        def ended() -> bool:
            late = duration_s is not None and time.monotonic() - began >= duration_s
            full = max_frames is not None and len(streams.images) >= max_frames
            return late or full or (stop is not None and stop.is_set())

        self._record(streams, began, ended, on_frame or (lambda count: None))
        return self._recording(streams, calibration)

    def _record(
        self, streams: _Streams, began: float, ended: Callable[[], bool], on_frame: Callable[[int], None]
    ) -> None:
        """Read messages, taking the connection up again when it is lost."""
        lost_s, cut = None, False
        streams.heard_s = time.monotonic()

        def over() -> bool:
            return ended() or time.monotonic() - streams.heard_s >= self.give_up_s

        while not over():
            connection = self._connect(over)
            if connection is None:
                break
            if lost_s is not None:
                streams.interruptions.append(Interruption(lost_s, time.monotonic() - began, cut))
            streams.connected = True
            with connection:
                cut = self._receive(connection, streams, over, on_frame)
            lost_s = time.monotonic() - began
            if cut:
                streams.dropped["message cut by a lost connection"] += 1
        if not streams.connected and not ended():
            raise InputError(
                f"{self._server}: expected an OpenIGTLink server within {self.give_up_s:g} s, found none"
            )

    def _connect(self, over: Callable[[], bool]) -> socket.socket | None:
        """A connection, or None where the recording is over before there is one."""
        while not over():
            try:
                connection = socket.create_connection((self.host, self.port), timeout=_POLL_S)
                connection.settimeout(_POLL_S)
                return connection
            except OSError:
                time.sleep(_POLL_S / 2)
        return None

    def _receive(
        self,
        connection: socket.socket,
        streams: _Streams,
        over: Callable[[], bool],
        on_frame: Callable[[int], None],
    ) -> bool:
        """Take messages until the connection or the recording ends; whether a message was cut in two by it."""
        while not over():
            message = next_message(connection, over, self._server)
            if isinstance(message, ConnectionEnded):
                return message.message_cut
            streams.heard_s = time.monotonic()
            streams.received[f"{message.kind} {message.device}"] += 1
            if (message.kind, message.device) == ("TRANSFORM", self.pose_device):
                self._take_pose(message, streams)
            elif (message.kind, message.device) == ("IMAGE", self.image_device):
                self._take_image(message, streams)
                on_frame(len(streams.images))
        return False

    def _take_pose(self, message: Arrival, streams: _Streams) -> None:
        matrix, status = message.decoded()
        if status != "OK":
            streams.dropped[f"{self.pose_device} {status}"] += 1
            return
        streams.poses.append(matrix.astype(np.float64))
        streams.pose_times_s.append(message.time_s)

    def _take_image(self, message: Arrival, streams: _Streams) -> None:
        pixels, status = message.decoded()
        if status != "OK":
            streams.dropped[f"{self.image_device} {status}"] += 1
            return
        name = f"{self._server}: {self.image_device}"
        if pixels.ndim not in (3, 4) or len(pixels) != 1:
            raise InputError(f"{name}: expected single frames, found pixels of shape {pixels.shape}")
        streams.images.append(to_mf(as_grey(pixels, name), self.orientation, Path(name))[0])
        streams.image_times_s.append(message.time_s)

    def _recording(self, streams: _Streams, calibration: ProbeCalibration) -> Recording:
        name = self._server
        if not streams.images or not streams.poses:
            heard = ", ".join(f"{key} ({count})" for key, count in streams.received.items()) or "nothing"
            raise InputError(
                f"{name}: expected images of {self.image_device} and transforms of {self.pose_device}, found {heard}"
            )
        sizes = {image.shape for image in streams.images}
        if len(sizes) > 1:
            raise InputError(f"{name}: expected images of one size, found {len(sizes)} sizes")
        poses = np.stack(streams.poses)
        transforms.require_rigid(poses, f"{name}: {self.pose_device}")
        pose_times_s, world_T_ee = distinct_times(
            np.array(streams.pose_times_s), transforms.nearest_rigid(poses), name
        )
        image_times_s = np.array(streams.image_times_s)
        missed = _missed_frames(image_times_s, len(streams.interruptions))
        if missed:
            streams.dropped["missed while the connection was lost (estimated)"] += missed
        sweep = TrackedSweep(
            np.stack(streams.images),
            image_times_s,
            world_T_ee,
            pose_times_s,
            calibration,
            dict(streams.dropped),
        )
        return Recording(sweep, tuple(streams.interruptions), dict(streams.received))


def _missed_frames(image_times_s: np.ndarray, interruptions: int) -> int:
    """How many frames fit into the longest gaps, one gap an interruption, at the usual frame rate."""
    steps_s = np.diff(image_times_s)
    if not interruptions or len(steps_s) < 2:
        return 0
    usual_s = float(np.median(steps_s))
    longest_s = np.sort(steps_s)[-interruptions:]
    return int(sum(max(0, round(step_s / usual_s) - 1) for step_s in longest_s)) if usual_s > 0 else 0
