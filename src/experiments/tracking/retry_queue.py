"""Calls to a server that may go away: made at once while it answers, kept in order and made later where it does not."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

Call = Callable[[], object]


class Deferred:
    """Makes calls in the order they come; once one is not answered, it and all that follow wait.

    ``server_unreachable`` tells an exception that means "no answer" from any other, which passes through.
    ``say`` gets one sentence when calls begin to wait and one when they have been made. While they wait,
    a new call tries the first of them again, at most every ``retry_every_s``.
    """

    def __init__(
        self,
        server_unreachable: Callable[[Exception], bool],
        say: Callable[[str], None],
        retry_every_s: float = 30.0,
    ) -> None:
        self._server_unreachable = server_unreachable
        self._say = say
        self._retry_every_s = retry_every_s
        self._waiting: deque[Call] = deque()
        self._tried_s = 0.0
        self._away = False

    @property
    def waiting(self) -> int:
        """How many calls have not been made."""
        return len(self._waiting)

    def __call__(self, call: Call) -> None:
        """Make the call, now or later.

        Parameters
        ----------
        call : Call
            A call to the tracking server.
        """
        self._waiting.append(call)
        if len(self._waiting) == 1 or time.monotonic() - self._tried_s >= self._retry_every_s:
            self.make()

    def make(self) -> bool:
        """Make all calls that wait, as far as they are answered; whether none is left.

        Returns
        -------
        bool
            True if all were made.
        """
        while self._waiting:
            try:
                self._waiting[0]()
            except Exception as error:
                if not self._server_unreachable(error):
                    self._waiting.popleft()
                    raise
                self._tried_s = time.monotonic()
                if not self._away:
                    self._say(
                        f"The tracking server does not answer; what is logged waits, the run goes on ({error})."
                    )
                self._away = True
                return False
            self._waiting.popleft()
        if self._away:
            self._say("The tracking server answers again; what had waited is logged.")
        self._away = False
        return True

    def last(self, wait_s: float, pause_s: float = 5.0) -> bool:
        """Try for up to ``wait_s`` to make what waits; whether none is left.

        Parameters
        ----------
        wait_s : float
            Longest time to wait in s.
        pause_s : float, optional
            Time between two tries in s.

        Returns
        -------
        bool
            True if all were made.
        """
        deadline = time.monotonic() + wait_s
        while not self.make():
            if time.monotonic() + pause_s > deadline:
                return False
            time.sleep(pause_s)
        return True
