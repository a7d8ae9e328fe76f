"""Processes that share the cores of one machine, and end with the one that started them, however that ends."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

# Kernels of OpenBLAS for x86-64 with AVX2, which newer processors run too; other kernels round differently.
KERNELS = "Haswell"
_KERNEL_SETTING = "OPENBLAS_CORETYPE"
LOOK_EVERY_S = 0.5
TIME_TO_END_S = 20.0
# Exit code as a shell gives it for SIGTERM.
TERMINATED = 143
_told_to_end = False


class StoppablePool(ProcessPoolExecutor):
    """A pool whose processes stop at once where its block is left by an exception, a Ctrl-C among them.

    A plain pool lets every process finish its task first, which may take minutes. Here the tasks are unwound, so that
    what they have half written is removed.
    """

    def submit(self, function: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Hand a task over, as ``ProcessPoolExecutor.submit`` does.

        Parameters
        ----------
        function : callable
            The task, which can be pickled.
        *given
            Its arguments by place.
        **named
            Its arguments by name.

        Returns
        -------
        Future
            Its result to come.
        """
        return super().submit(_Task(function), *given, **named)

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> bool | None:
        """Wait for the processes; those of a block left by an exception are told to end first."""
        if kind is not None:
            self._stop()
        return super().__exit__(kind, *rest)

    def _stop(self) -> None:
        processes = list((self._processes or {}).values())
        self.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + TIME_TO_END_S
        for process in processes:
            process.join(max(deadline - time.monotonic(), 0.0))
            if process.is_alive():
                process.kill()


@dataclass(frozen=True)
class _Task:
    """A task that is not begun any more by a process that was told to end."""

    function: Callable[..., Any]

    def __call__(self, *given: Any, **named: Any) -> Any:
        try:
            return self.function(*given, **named)
        finally:
            if _told_to_end:
                os._exit(TERMINATED)


def process_pool(workers: int) -> StoppablePool:
    """Make a pool of processes, each a fresh interpreter with one thread for its linear algebra.

    Parameters
    ----------
    workers : int
        Number of processes.

    Returns
    -------
    StoppablePool
        The pool, to be closed by the caller (``with``).

    Notes
    -----
    Forking after Open3D or torch has started its threads can hang. Threads of several processes that compete
    for the same cores make each of them take several times as long.
    """
    return StoppablePool(workers, get_context("spawn"), initializer=_begin, initargs=(os.getpid(),))


def end_with_parent(parent: int, *, gently: bool) -> None:
    """End this process once its parent is gone: a parent that is killed cannot take its children with it.

    Parameters
    ----------
    parent : int
        Number of the parent's process.
    gently : bool
        Whether SIGTERM comes first, so that a run ends as FAILED; what has not ended some seconds later is killed.

    Notes
    -----
    Linux could send a signal of its own accord, but it does so when the *thread* that started the process ends, which
    in a pool may be any.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_EVERY_S)
        if gently:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(TIME_TO_END_S)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True, name="parent watch").start()


def _begin(parent: int) -> None:
    # The keyboard's signal goes to all processes of a terminal: the one that started these sees to them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    end_with_parent(parent, gently=False)
    _take_one_thread()


def _end(*_: object) -> None:
    """Unwind the task; the second signal, which a broken pool sends, must not cut the first one short."""
    global _told_to_end
    if not _told_to_end:
        _told_to_end = True
        raise SystemExit(TERMINATED)


def _take_one_thread() -> None:
    # What is loaded later reads its limit then.
    os.environ["OMP_NUM_THREADS"] = "1"
    # A limit reaches only what is loaded: both bring a library of their own.
    import numpy  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


@contextmanager
def same_kernels() -> Iterator[None]:
    """Have processes that start in this block round as on every x86-64 processor with AVX2.

    OpenBLAS chooses its kernels by the processor, and the last bits of a product differ between them. Numbers that are
    compared by a digest are therefore made in processes of one kernel. Where the processor has no AVX2, or the user
    has chosen kernels, nothing is changed.
    """
    import numpy as np

    features = getattr(getattr(np, "_core", None), "_multiarray_umath", None)
    has_avx2 = bool(getattr(features, "__cpu_features__", {}).get("AVX2"))
    if not has_avx2 or _KERNEL_SETTING in os.environ:
        yield
        return
    os.environ[_KERNEL_SETTING] = KERNELS
    try:
        yield
    finally:
        del os.environ[_KERNEL_SETTING]


@contextmanager
def one_open3d_thread() -> Iterator[None]:
    """Let Open3D use one thread, which neither the environment nor a limit on linear algebra can bring about.

    Its RANSAC gives the same result every time only then. Open3D before 0.20 has no such setting and is left
    as it is.
    """
    import open3d

    limit = getattr(open3d.utility, "set_max_threads", None)
    if limit is None:
        yield
        return
    limit(1)
    try:
        yield
    finally:
        limit(0)
