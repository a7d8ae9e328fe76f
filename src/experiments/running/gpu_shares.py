"""Which GPU each of several processes on one machine gets: one of its own, as long as there are enough."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence

from experiments.provenance import gpu_names

# What CUDA reads to learn which GPUs a process may see; in that process they are counted from 0.
VISIBLE = "CUDA_VISIBLE_DEVICES"


def visible_gpus() -> tuple[str, ...]:
    """List the GPUs that this process may hand out.

    Returns
    -------
    tuple of str
        Numbers or names, as ``CUDA_VISIBLE_DEVICES`` has them: those that it names, else all of the machine.
    """
    named = os.environ.get(VISIBLE)
    if named is None:
        return tuple(str(number) for number in range(len(gpu_names())))
    return tuple(part.strip() for part in named.split(",") if part.strip() and part.strip() != "-1")


def next_gpu(gpus: Sequence[str], in_use: Iterable[str]) -> str | None:
    """Choose the GPU for the process that starts next: the first of those that the fewest processes are at.

    Parameters
    ----------
    gpus : sequence of str
        GPUs to choose from.
    in_use : iterable of str
        GPU of each process that is running.

    Returns
    -------
    str or None
        The GPU; None where there are no two to choose from.
    """
    if len(gpus) < 2:
        return None
    load = Counter(in_use)
    return min(gpus, key=lambda gpu: load[gpu])
