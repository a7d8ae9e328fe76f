"""The pool: fresh interpreters with one thread each."""

from __future__ import annotations

import os

import numpy as np
from threadpoolctl import threadpool_info

from experiments.process_pool import one_open3d_thread, process_pool


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


def test_open3d_has_one_thread_inside_and_all_again_outside() -> None:
    import open3d

    before = open3d.utility.get_max_threads()
    with one_open3d_thread():
        assert open3d.utility.get_max_threads() == 1
    assert open3d.utility.get_max_threads() == before
