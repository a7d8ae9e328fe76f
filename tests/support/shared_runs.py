"""What the processes of a pretended training on two devices do, where they find it: in a module of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from models.errors import InputError
from models.training.sampling import Share


@dataclass(frozen=True)
class Budget:
    threads: int = 1


@dataclass(frozen=True)
class Small:
    """What is known of a training where it is only pretended."""

    trainer: Budget = field(default_factory=Budget)


SMALL = Small()
Report = Callable[[Mapping[str, float]], None]


def report_and_wait(training: Small, on_epoch: Report | None, share: Share) -> Any:
    if on_epoch is not None:
        on_epoch({"epoch": 0.0})
    time.sleep(600.0)


def fail_in_the_second(training: Small, on_epoch: Report | None, share: Share) -> Any:
    if share.number == 1:
        raise InputError(f"as process {share.number} has it")
    time.sleep(600.0)
