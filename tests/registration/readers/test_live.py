"""Recording from an OpenIGTLink server on the loopback: nothing lost, the connection kept up, bad streams refused."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from sweeps import known_sweep, world_T_ee

from registration.errors import InputError
from registration.readers.live import LiveRecorder
from registration.readers.plus.calibration_file import calibration_yaml

pyigtl = pytest.importorskip("pyigtl")
Script = Callable[[socket.socket], None]
PICTURES = np.random.default_rng(0).integers(0, 256, (40, 1, 6, 9)).astype(np.uint8)


def image_bytes(index: int, name: str = "Image") -> bytes:
    return pyigtl.ImageMessage(PICTURES[index], timestamp=100 + 0.05 * index, device_name=name).pack()


def pose_bytes(time_s: float, status: str | None = None) -> bytes:
    message = pyigtl.TransformMessage(
        world_T_ee(np.array([time_s - 100]))[0], timestamp=time_s, device_name="ProbeToReference"
    )
    if status is not None:
        message.header_version, message.metadata = 2, {"Status": status}
    return message.pack()


def stream(first: int, last: int) -> bytes:
    """Images ``first`` to ``last`` of a stream, a pose before each, and messages that nobody asked for."""
    return b"".join(
        pose_bytes(99.99 + 0.05 * index)
        + image_bytes(index)
        + pyigtl.StringMessage("hello", device_name="Text").pack()
        + image_bytes(index, "OtherImage")
        for index in range(first, last)
    )


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Callable[..., LiveRecorder]]:
    """A server that plays one script for each connection it gets, then stops; and a recorder that listens to it."""
    (tmp_path / "probe.yaml").write_text(calibration_yaml(known_sweep().calibration))
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(5)
    threads: list[threading.Thread] = []

    def serve(*scripts: Script, pause_s: float = 0.0, **settings: object) -> LiveRecorder:
        def play() -> None:
            for script in scripts:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    script(connection)
                time.sleep(pause_s)

        threads.append(threading.Thread(target=play, daemon=True))
        threads[0].start()
        chosen = {"give_up_s": 2.0, **settings}
        return LiveRecorder(
            "Image",
            "ProbeToReference",
            str(tmp_path / "probe.yaml"),
            port=listener.getsockname()[1],
            **chosen,
        )

    yield serve
    listener.close()
    for thread in threads:
        thread.join(timeout=6)
        assert not thread.is_alive()


def send(data: bytes, part: int = 1 << 20) -> Script:
    def script(connection: socket.socket) -> None:
        for start in range(0, len(data), part):
            connection.sendall(data[start : start + part])

    return script


def test_every_frame_and_pose_arrives(server: Callable[..., LiveRecorder]) -> None:
    counts: list[int] = []
    recording = server(send(stream(0, 40) + pose_bytes(103.0), part=777))(
        max_frames=40, on_frame=counts.append
    )
    sweep = recording.sweep
    np.testing.assert_array_equal(sweep.images, PICTURES[:, 0])
    np.testing.assert_allclose(sweep.image_times_s, 100 + 0.05 * np.arange(40), atol=1e-6)
    np.testing.assert_allclose(sweep.pose_times_s, 99.99 + 0.05 * np.arange(40), atol=1e-6)
    # The protocol sends matrices in single precision.
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(sweep.pose_times_s - 100), atol=5e-4)
    assert counts == list(range(1, 41))
    assert recording.interruptions == ()
    assert sweep.dropped == {}
    assert recording.received["IMAGE OtherImage"] == 39


def test_lost_connection_is_taken_up_again_and_told(server: Callable[..., LiveRecorder]) -> None:
    cut = image_bytes(12)[:-20]
    recording = server(send(stream(0, 12) + cut), send(stream(20, 32)), pause_s=0.3)(max_frames=24)
    np.testing.assert_array_equal(recording.sweep.images, PICTURES[[*range(12), *range(20, 32)], 0])
    assert len(recording.interruptions) == 1
    assert recording.interruptions[0].message_cut
    assert recording.interruptions[0].ended_s > recording.interruptions[0].began_s
    assert recording.sweep.dropped == {
        "message cut by a lost connection": 1,
        "missed while the connection was lost (estimated)": 8,
    }


def test_recording_ends_when_the_server_stays_away(server: Callable[..., LiveRecorder]) -> None:
    recording = server(send(stream(0, 5)), give_up_s=0.4)(duration_s=30.0)
    assert len(recording.sweep.images) == 5


def test_recording_ends_by_duration_and_by_event(server: Callable[..., LiveRecorder]) -> None:
    stop = threading.Event()

    def slow(connection: socket.socket) -> None:
        connection.sendall(stream(0, 3))
        stop.wait(4)

    recording = server(slow)(stop=stop, on_frame=lambda count: stop.set() if count == 3 else None)
    assert len(recording.sweep.images) == 3


def test_invalid_poses_are_dropped_and_counted(server: Callable[..., LiveRecorder]) -> None:
    data = pose_bytes(100.0, "OK") + pose_bytes(100.1, "INVALID") + pose_bytes(100.2, "OK") + stream(10, 12)
    recording = server(send(data))(max_frames=2)
    assert recording.sweep.dropped == {"ProbeToReference INVALID": 1}
    np.testing.assert_allclose(recording.sweep.pose_times_s, [100.0, 100.2, 100.49, 100.54], atol=1e-6)


def test_orientation_is_turned_to_mf(server: Callable[..., LiveRecorder]) -> None:
    recording = server(send(stream(0, 2)), orientation="UN")(max_frames=2)
    np.testing.assert_array_equal(recording.sweep.images, PICTURES[:2, 0, ::-1, ::-1])


def test_stream_of_another_protocol_is_refused(server: Callable[..., LiveRecorder]) -> None:
    with pytest.raises(InputError, match=r"127\.0\.0\.1:\d+: expected OpenIGTLink messages, found others"):
        server(send(b"HTTP/1.1 400 Bad Request\r\n" * 20))(max_frames=1)


def test_devices_that_do_not_send_are_told(server: Callable[..., LiveRecorder]) -> None:
    recorder = server(send(b"".join(image_bytes(i, "Video") for i in range(3))), give_up_s=0.3)
    with pytest.raises(InputError, match=r"expected images of Image .* found IMAGE Video \(3\)"):
        recorder(duration_s=30.0)


def test_absent_server_is_told(tmp_path: Path) -> None:
    (tmp_path / "probe.yaml").write_text(calibration_yaml(known_sweep().calibration))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    recorder = LiveRecorder("Image", "Pose", str(tmp_path / "probe.yaml"), port=port, give_up_s=0.3)
    with pytest.raises(InputError, match=r"expected an OpenIGTLink server within 0\.3 s, found none"):
        recorder(max_frames=1)


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="port"):
        LiveRecorder("Image", "Pose", "probe.yaml", port=0)
    with pytest.raises(InputError, match="give_up_s"):
        LiveRecorder("Image", "Pose", "probe.yaml", give_up_s=0.0)
    with pytest.raises(InputError, match="at least one end to the recording"):
        LiveRecorder("Image", "Pose", "probe.yaml")()
