"""The pool: fresh interpreters with one thread each."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from experiments import files
from experiments.process_pool import one_open3d_thread, process_pool

CHILD = """
import os, sys, time
from experiments import process_pool
process_pool.LOOK_EVERY_S = 0.05
process_pool.TIME_TO_END_S = 0.3
if {stubborn}:
    import signal
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
process_pool.end_with_parent(os.getppid(), gently={gently})
open(sys.argv[1], "w").write(str(os.getpid()))
time.sleep(60)
"""
PARENT = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', sys.argv[1], sys.argv[2]]).wait()"


@pytest.mark.parametrize(("gently", "stubborn"), [(True, False), (True, True), (False, True)])
def test_a_child_ends_when_its_parent_is_killed(tmp_path: Path, gently: bool, stubborn: bool) -> None:
    child = CHILD.format(gently=gently, stubborn=stubborn)
    parent = subprocess.Popen([sys.executable, "-c", PARENT, child, str(tmp_path / "pid")])
    deadline = time.monotonic() + 20
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    pid = int((tmp_path / "pid").read_text())
    os.kill(pid, 0)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    while lives(pid):
        assert time.monotonic() < deadline, "the child goes on"
        time.sleep(0.02)


def lives(pid: int) -> bool:
    try:
        # One that has ended and that nobody waits for is still listed.
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except (FileNotFoundError, ProcessLookupError):
        return False


def threads(_: int) -> tuple[int, list[int], str | None]:
    """The process, the threads of every library of its linear algebra, which is loaded first, and what others read."""
    assert np.ones((2, 2)) @ np.ones(2) is not None
    counts = [library["num_threads"] for library in threadpool_info()]
    return os.getpid(), counts, os.environ.get("OMP_NUM_THREADS")


def test_each_process_has_one_thread() -> None:
    with process_pool(2) as pool:
        found = list(pool.map(threads, range(4)))
    assert {process for process, *_ in found}.isdisjoint({os.getpid()})
    assert all(counts and set(counts) == {1} for _, counts, _ in found)
    assert {limit for *_, limit in found} == {"1"}


def half_written(folder: Path, number: int) -> None:
    """Begin a folder, and take a minute over it."""
    with files.staged(folder / str(number)) as stage:
        (stage / "begun").write_text("")
        for _ in range(600):
            time.sleep(0.1)


@pytest.mark.parametrize("reason", [KeyboardInterrupt, ValueError])
def test_a_block_that_is_left_stops_its_tasks_and_what_they_have_half_written_is_removed(
    tmp_path: Path, reason: type[BaseException]
) -> None:
    begun = time.monotonic()
    with pytest.raises(reason), process_pool(2) as pool:
        tasks = [pool.submit(half_written, tmp_path, number) for number in range(7)]
        while len(list(tmp_path.rglob("begun"))) < 2:
            assert time.monotonic() < begun + 20
            time.sleep(0.02)
        raise reason
    # A task takes a minute; none was finished, and none was begun after those two.
    assert time.monotonic() < begun + 40
    assert all(task.cancelled() or task.exception() is not None for task in tasks)
    assert not list(tmp_path.iterdir())


def test_the_keyboards_signal_is_left_to_the_process_that_started_the_pool() -> None:
    with process_pool(1) as pool:
        assert pool.submit(signal.getsignal, signal.SIGINT).result() is signal.SIG_IGN


def test_open3d_has_one_thread_inside_and_all_again_outside() -> None:
    import open3d

    before = open3d.utility.get_max_threads()
    with one_open3d_thread():
        assert open3d.utility.get_max_threads() == 1
    assert open3d.utility.get_max_threads() == before
