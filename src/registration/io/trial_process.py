"""Reading a file in a process of its own first, where the library may crash or never end over a broken one.

HDF5 checks little of what it follows: a changed byte can end the process, or keep it busy for good. What is read here
first has then been read once without harm, under a limit of time and memory. One process loads the library and makes
a copy of itself for every file, so that only the first file waits for loading.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

from registration.errors import InputError

# A whole file takes hundredths of a second; large ones get more, and even a slow disk gives so many bytes a second.
TRIAL_S = 8.0
BYTES_PER_S = 5e6
MOST_S = 600.0
MEMORY_BYTES = 4 << 30
# For each line, a list of a file, seconds and bytes: how the process ended that read it, as os.wait tells it.
_TRIALS = """
import json, os, resource, signal, sys
{load}
for line in sys.stdin.buffer:
    path, seconds, size = json.loads(line)
    child = os.fork()
    if child == 0:
        try:
            resource.setrlimit(resource.RLIMIT_AS, (size, size))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGALRM])
            signal.setitimer(signal.ITIMER_REAL, seconds)
            {read}
            os._exit(0)
        finally:
            os._exit(1)
    print(os.waitpid(child, 0)[1], flush=True)
"""
_LOAD, _READ = "import SimpleITK", "SimpleITK.ReadTransform(path)"


def require_harmless_transform(path: Path) -> None:
    """Raise InputError unless another process can read a transform of ITK in reasonable time and memory.

    Parameters
    ----------
    path : Path
        File of a transform.

    Raises
    ------
    InputError
        If the process fails, crashes or does not end.
    """
    status = path.stat()
    _try(path.absolute(), path, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _try(place: Path, named: Path, size: int, _changed_ns: int) -> None:
    """Once for each content of a file, as far as its size and time tell."""
    within_s = min(TRIAL_S + size / BYTES_PER_S, MOST_S)
    code = _trials().end_of_reading(place, within_s)
    if code == -signal.SIGALRM:
        raise InputError(
            f"{named}: expected a transform that is read within {within_s:.0f} s, received a file that keeps its "
            "reader busy"
        )
    if code:
        how = "crashes" if code < 0 else "cannot be read as one"
        raise InputError(f"{named}: expected a complete ITK transform, received a file that {how}")


class _Trials:
    """The process that reads files in copies of itself; it ends when its input does, with its owner at the latest."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = os.getpid()
        atexit.register(self.end)

    def end_of_reading(self, path: Path, within_s: float) -> int:
        """The exit code of a process that read this file: 0, or above 0, or minus the signal that ended it."""
        request = json.dumps([str(path), within_s, MEMORY_BYTES]).encode() + b"\n"
        with self._lock:
            # Once more with a new process where somebody ended this one.
            answer = self._ask(request) or self._ask(request)
        return os.waitstatus_to_exitcode(int(answer)) if answer else 1

    def _ask(self, request: bytes) -> bytes:
        """The answer, a line; nothing where the process ended over it, and the next request gets a new one."""
        answer = b""
        try:
            with contextlib.suppress(BrokenPipeError):
                self._process = process = self._process or self._start()
                assert process.stdin and process.stdout
                process.stdin.write(request)
                process.stdin.flush()
                answer = process.stdout.readline()
        finally:
            if (
                not answer
            ):  # an interrupt among the causes: what comes late would be taken for the next file's answer
                self.end()
        return answer

    @staticmethod
    def _start() -> subprocess.Popen[bytes]:
        # Isolated, so that neither the current folder nor the environment decides what is imported; in a session of
        # its own, so that an interrupt from the keyboard is this process's alone to answer.
        return subprocess.Popen(
            [sys.executable, "-I", "-c", _TRIALS.format(load=_LOAD, read=_READ)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def end(self) -> None:
        """End the process and what it reads."""
        process, self._process = self._process, None
        if process is None or os.getpid() != self._owner:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        assert process.stdin and process.stdout
        process.stdout.close()
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()


@functools.cache
def _trials_of(_process: int, _load: str, _read: str) -> _Trials:
    return _Trials()


def _trials() -> _Trials:
    """What belongs to this process: one that a fork inherited answers to its parent."""
    return _trials_of(os.getpid(), _LOAD, _READ)
