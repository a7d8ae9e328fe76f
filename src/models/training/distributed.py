"""A training on several devices: a process for each, which see the same batches and compute a part of each.

Lightning would start these processes itself by running the whole program again, or send them live objects. Here the
process that asked for the training starts them, hears of each epoch, and alone goes on afterwards.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import socket
import threading
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from typing import Any

from models.processor import fixed_threads
from models.training.phase import Progressed
from models.training.sampling import Share

LOOK_EVERY_S = 0.5
TIME_TO_END_S = 10.0


def run_shared(
    run: Callable[..., Progressed],
    arguments: Sequence[Any],
    devices: int,
    on_epoch: Callable[[Mapping[str, float]], None] | None,
) -> Progressed:
    """Train in as many processes as there are devices.

    Parameters
    ----------
    run : callable
        A function of a module, which each process calls with ``arguments``, ``on_epoch`` and its ``share``.
    arguments : sequence
        Its first arguments, which can be pickled.
    devices : int
        Number of processes.
    on_epoch : callable or None
        Called here with each epoch's measures.

    Returns
    -------
    Progressed
        The result of the first process.

    Raises
    ------
    RuntimeError
        If a process ends before the training does.
    """
    context, port = get_context("spawn"), _free_port()
    reports = context.Queue()
    processes = [
        context.Process(
            target=_share, args=(run, tuple(arguments), Share(number, devices), port, reports), daemon=True
        )
        for number in range(devices)
    ]
    try:
        for process in processes:
            process.start()
        result = _heard(processes, reports, on_epoch)
        for process in processes:
            process.join(TIME_TO_END_S)
        return result
    finally:
        _end(processes)


def shared_report(report: dict[str, float]) -> dict[str, float]:
    """Make the measures of an epoch the same in all processes: what they decide by them must be.

    Parameters
    ----------
    report : dict of str to float
        Measures of this process, whose training loss is of its part of each batch.

    Returns
    -------
    dict of str to float
        Those of the first process, with the training loss of whole batches and the largest memory of a process.
    """
    import torch.distributed as group

    every: list[dict[str, float]] = [{} for _ in range(group.get_world_size())]
    group.all_gather_object(every, report)
    losses = [each["train_loss"] for each in every]
    return {
        **every[0],
        "train_loss": sum(losses) / len(losses),
        "peak_memory_mb": max(each["peak_memory_mb"] for each in every),
    }


def _heard(
    processes: Sequence[BaseProcess], reports: Any, on_epoch: Callable[[Mapping[str, float]], None] | None
) -> Progressed:
    """Pass on what the processes report until the first has its result."""
    while True:
        try:
            kind, content = reports.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            dead = [process.exitcode for process in processes if process.exitcode not in (None, 0)]
            if dead:
                how = f"signal {-dead[0]}" if dead[0] < 0 else f"exit code {dead[0]}"
                raise RuntimeError(
                    f"a process of the training ended by {how} before the training did"
                ) from None
            continue
        if kind == "failed":
            raise content
        if kind == "done":
            result: Progressed = content
            return result
        if on_epoch is not None:
            on_epoch(content)


def _share(
    run: Callable[..., Progressed], arguments: Sequence[Any], share: Share, port: int, reports: Any
) -> None:
    """What each process does."""
    threading.Thread(target=_end_with_parent, daemon=True, name="parent watch").start()
    # Ctrl-C reaches all processes of a terminal; the one that started these ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ |= {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(port),
        "NODE_RANK": "0",
        "LOCAL_RANK": str(share.number),
        "WORLD_SIZE": str(share.processes),
    }
    first = share.number == 0
    try:
        with fixed_threads(arguments[0].trainer.threads):
            done = run(*arguments, _reporter(reports) if first else None, share)
        if first:
            reports.put(("done", done))
    except Exception as failure:
        reports.put(("failed", _sendable(failure)))


def _reporter(reports: Any) -> Callable[[Mapping[str, float]], None]:
    return lambda report: reports.put(("epoch", dict(report)))


def _sendable(failure: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(failure))
    except Exception:  # an exception whose arguments are not those of its class
        return RuntimeError(f"{type(failure).__name__}: {failure}")
    return failure


def _end_with_parent() -> None:
    """End this process once the one that started it is gone, which could not take it along when it was killed."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _end(processes: Sequence[BaseProcess]) -> None:
    """End what is still running: after a failure the others wait in vain for the one that failed."""
    started = [process for process in processes if process.pid is not None]
    for process in started:
        if process.is_alive():
            process.terminate()
    for process in started:
        process.join(TIME_TO_END_S)
        if process.is_alive():
            process.kill()
            process.join()


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
