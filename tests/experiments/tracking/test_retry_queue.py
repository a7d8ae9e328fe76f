"""Calls to a server that goes away: none is lost, none is made twice, their order is kept."""

from __future__ import annotations

import pytest

from experiments.tracking.retry_queue import Deferred


class Server:
    """Takes calls while it is ``up``."""

    def __init__(self) -> None:
        self.up = True
        self.taken: list[int] = []
        self.asked = 0

    def take(self, number: int) -> None:
        self.asked += 1
        if not self.up:
            raise ConnectionError("no answer")
        self.taken.append(number)


@pytest.fixture
def server() -> Server:
    return Server()


def deferred(said: list[str], retry_every_s: float = 1000.0) -> Deferred:
    return Deferred(lambda error: isinstance(error, ConnectionError), said.append, retry_every_s)


def test_an_answered_call_is_made_at_once_and_nothing_is_said(server: Server) -> None:
    said: list[str] = []
    calls = deferred(said)
    for number in range(3):
        calls(lambda number=number: server.take(number))
        assert server.taken[-1] == number
    assert calls.last(0) and not said and not calls.waiting


def test_what_is_not_answered_waits_in_order_and_is_made_once(server: Server) -> None:
    said: list[str] = []
    calls = deferred(said)
    calls(lambda: server.take(0))
    server.up = False
    for number in (1, 2, 3):
        calls(lambda number=number: server.take(number))
    assert server.taken == [0] and calls.waiting == 3
    assert len(said) == 1 and "does not answer" in said[0]
    server.up = True
    assert calls.last(0)
    assert server.taken == [0, 1, 2, 3]
    assert len(said) == 2 and "answers again" in said[1]


def test_a_server_that_is_away_is_not_asked_at_every_call(server: Server) -> None:
    calls = deferred([])
    server.up = False
    for number in range(5):
        calls(lambda number=number: server.take(number))
    assert server.asked == 1
    again = deferred([], retry_every_s=0.0)
    for number in range(3):
        again(lambda number=number: server.take(number))
    assert server.asked == 4


def test_it_comes_back_in_the_middle(server: Server) -> None:
    calls = deferred([], retry_every_s=0.0)
    server.up = False
    calls(lambda: server.take(0))
    server.up = True
    calls(lambda: server.take(1))
    assert server.taken == [0, 1]


def test_last_gives_up_in_time_and_says_so(server: Server) -> None:
    calls = deferred([])
    server.up = False
    calls(lambda: server.take(0))
    assert not calls.last(0.02, pause_s=0.01)
    assert calls.waiting == 1
    assert 2 <= server.asked <= 5


def test_another_error_passes_through_and_does_not_block_what_follows(server: Server) -> None:
    calls = deferred([])

    def wrong() -> None:
        raise ValueError("a metric without a name")

    with pytest.raises(ValueError, match="without a name"):
        calls(wrong)
    calls(lambda: server.take(1))
    assert server.taken == [1]
