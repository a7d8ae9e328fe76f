"""OpenIGTLink messages from a socket, complete or refused, decoded by ``pyigtl``.

Protocol: Tokuda et al., Int. J. Med. Robotics 5(4), 2009; http://openigtlink.org/developers/spec.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pyigtl.messages import MessageBase  # type: ignore[import-untyped]

from registration.errors import InputError

_HEADER_BYTES = 58
_MAX_BODY_BYTES = 1 << 28
_RECEIVED_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Arrival:
    """One complete message.

    Parameters
    ----------
    kind : str
        Kind of message: ``IMAGE``, ``TRANSFORM``, ...
    device : str
        Device that it is of.
    time_s : float
        Its time in s.
    header : bytes
        Header as sent.
    body : bytes
        Body as sent.
    """

    kind: str
    device: str
    time_s: float
    header: bytes
    body: bytes

    def decoded(self) -> tuple[np.ndarray, str]:
        """Decode an image or a transform.

        PLUS sends the status of a tool with its transform, in the meta data of header version 2.

        Returns
        -------
        content : ndarray
            Pixels (slices, rows, columns, ...) of an image, or the 4x4 matrix of a transform.
        status : str
            Status of the tool, OK where none is sent.

        Raises
        ------
        InputError
            If the message does not decode.
        """
        message = MessageBase.create_message(self.kind)
        try:
            message.unpack(MessageBase.parse_header(self.header), self.body)
        except (struct.error, ValueError, KeyError, IndexError, NotImplementedError) as failure:
            raise InputError(
                f"{self.device}: expected a readable {self.kind} message, found another ({failure})"
            ) from failure
        status = str(message.metadata.get("Status", message.metadata.get("status", "OK")))
        return np.asarray(message.image if self.kind == "IMAGE" else message.matrix), status


@dataclass(frozen=True)
class ConnectionEnded:
    """The connection or the recording ended: there is no further message.

    Parameters
    ----------
    message_cut : bool
        Whether it ended in the middle of a message.
    """

    message_cut: bool


def next_message(
    connection: socket.socket, ended: Callable[[], bool], name: str
) -> Arrival | ConnectionEnded:
    """Wait for a message.

    Parameters
    ----------
    connection : socket.socket
        Connection with a timeout.
    ended : callable
        Asked whenever the timeout passes; True ends the waiting.
    name : str
        Name of the server, for messages.

    Returns
    -------
    Arrival or ConnectionEnded
        Message, or the end of the connection.

    Raises
    ------
    InputError
        If the stream is no OpenIGTLink.
    """
    header, complete = _read(connection, _HEADER_BYTES, ended)
    if not complete:
        return ConnectionEnded(message_cut=bool(header) and not ended())
    try:
        fields = MessageBase.parse_header(header)
    except (struct.error, UnicodeDecodeError) as failure:
        raise InputError(f"{name}: expected OpenIGTLink messages, found others") from failure
    if fields["header_version"] not in (1, 2) or fields["body_size"] > _MAX_BODY_BYTES:
        raise InputError(f"{name}: expected OpenIGTLink messages, found others")
    body, complete = _read(connection, int(fields["body_size"]), ended)
    if not complete:
        return ConnectionEnded(message_cut=not ended())
    return Arrival(fields["message_type"], fields["device_name"], float(fields["timestamp"]), header, body)


def _read(connection: socket.socket, count: int, ended: Callable[[], bool]) -> tuple[bytes, bool]:
    """Exactly ``count`` bytes, or what came of them before the end; whether all came."""
    received = bytearray()
    while len(received) < count:
        try:
            part = connection.recv(min(count - len(received), _RECEIVED_AT_ONCE))
        except TimeoutError:
            if ended():
                return bytes(received), False
            continue
        except OSError:
            return bytes(received), False
        if not part:
            return bytes(received), False
        received += part
    return bytes(received), True
