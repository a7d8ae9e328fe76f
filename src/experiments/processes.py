"""Processes that share the cores of one machine."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context


def process_pool(workers: int) -> ProcessPoolExecutor:
    """A pool of ``workers`` processes, each a fresh interpreter with one thread for its linear algebra.

    Forking after Open3D or torch has started its threads can hang. Threads of several processes that compete for the
    same cores make each of them take several times as long.
    """
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=_take_one_thread)


def _take_one_thread() -> None:
    # A limit reaches only what is loaded: both bring a library of their own.
    import numpy  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
