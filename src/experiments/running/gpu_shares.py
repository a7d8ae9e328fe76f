"""Which GPUs each of several processes on one machine gets: those of its own, as long as there are enough."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

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


def next_gpus(gpus: Sequence[str], in_use: Iterable[str], count: int = 1) -> str | None:
    """Choose the GPUs for the process that starts next: the first of those that the fewest processes are at.

    Parameters
    ----------
    gpus : sequence of str
        GPUs to choose from.
    in_use : iterable of str
        GPUs of the processes that are running.
    count : int, optional
        How many the process needs.

    Returns
    -------
    str or None
        The GPUs, as ``CUDA_VISIBLE_DEVICES`` has them; None where there is no choice.
    """
    if len(gpus) <= count:
        return None
    load = Counter(in_use)
    chosen = sorted(gpus, key=lambda gpu: load[gpu])[:count]
    return ",".join(gpu for gpu in gpus if gpu in chosen)


def gpus_needed(config: Mapping[str, Any]) -> int:
    """How many GPUs a job computes on at the same time, if it uses any.

    Parameters
    ----------
    config : mapping
        A resolved configuration.

    Returns
    -------
    int
        ``trainer.devices`` of a training, else 1.
    """
    trainer = config.get("trainer")
    devices = trainer.get("devices", 1) if isinstance(trainer, Mapping) else 1
    return devices if isinstance(devices, int) and devices > 0 else 1
