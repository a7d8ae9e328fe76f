"""Messages come whole or not at all, however the network cuts them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.openigtlink import Arrival, ConnectionEnded, next_message

pyigtl = pytest.importorskip("pyigtl")
MATRIX = np.array([[0, -1, 0, 10], [1, 0, 0, -20], [0, 0, 1, 30], [0, 0, 0, 1]], dtype=np.float32)
TRANSFORM = pyigtl.TransformMessage(MATRIX, timestamp=12.25, device_name="ProbeToReference").pack()


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Two connected sockets, the second with a short timeout."""
    near, far = socket.socketpair()
    far.settimeout(0.05)
    with near, far:
        yield near, far


def test_message_in_single_bytes(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    sender = threading.Thread(
        target=lambda: [near.sendall(TRANSFORM[i : i + 1]) for i in range(len(TRANSFORM))]
    )
    sender.start()
    message = next_message(far, lambda: False, "server")
    sender.join(timeout=5)
    assert isinstance(message, Arrival)
    assert (message.kind, message.device, message.time_s) == ("TRANSFORM", "ProbeToReference", 12.25)
    matrix, status = message.decoded()
    np.testing.assert_array_equal(matrix, MATRIX)
    assert status == "OK"


@pytest.mark.parametrize(("sent", "cut"), [(0, False), (10, True), (58, True), (80, True)])
def test_closed_connection(pair: tuple[socket.socket, socket.socket], sent: int, cut: bool) -> None:
    near, far = pair
    near.sendall(TRANSFORM[:sent])
    near.close()
    assert next_message(far, lambda: False, "server") == ConnectionEnded(message_cut=cut)


def test_end_of_the_recording_is_no_cut(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    near.sendall(TRANSFORM[:70])
    assert next_message(far, lambda: True, "server") == ConnectionEnded(message_cut=False)


def test_other_protocols_are_refused(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    near.sendall(b"SSH-2.0-OpenSSH_9.2p1 Debian-2 and so on, more than a header's worth of it")
    with pytest.raises(InputError, match="server: expected OpenIGTLink messages, found others"):
        next_message(far, lambda: False, "server")


def test_broken_image_is_refused(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    whole = pyigtl.ImageMessage(np.zeros((1, 4, 5), np.uint8), timestamp=1.0, device_name="US").pack()
    # The size says more pixels than there are.
    broken = bytearray(whole)
    broken[58 + 7] = 200
    near.sendall(bytes(broken))
    message = next_message(far, lambda: False, "server")
    assert isinstance(message, Arrival)
    with pytest.raises(InputError, match="US: expected a readable IMAGE message"):
        message.decoded()
