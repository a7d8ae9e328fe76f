"""The pool: fresh interpreters with one thread each."""

from __future__ import annotations

import os

import numpy as np
from threadpoolctl import threadpool_info

from experiments.processes import process_pool


def threads(_: int) -> tuple[int, list[int]]:
    """The process and the threads of every library of its linear algebra, which is loaded first."""
    assert np.ones((2, 2)) @ np.ones(2) is not None
    return os.getpid(), [library["num_threads"] for library in threadpool_info()]


def test_each_process_has_one_thread() -> None:
    with process_pool(2) as pool:
        found = list(pool.map(threads, range(4)))
    assert {process for process, _ in found}.isdisjoint({os.getpid()})
    assert all(counts and set(counts) == {1} for _, counts in found)
