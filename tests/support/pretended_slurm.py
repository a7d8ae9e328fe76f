"""A Slurm that is only pretended: jobs are run, or ended otherwise, in the process that sends them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import pytest

from experiments.running import array_task, slurm_launcher, slurm_queue
from experiments.running.array_task import ArrayTask
from experiments.running.slurm_queue import SlurmState
from experiments.running.slurm_settings import SlurmSettings


class PretendedSlurm:
    """``ends`` has, by a job's place in its array, the state that it ends in without having run."""

    def __init__(self, ends: Mapping[int, SlurmState] | None = None) -> None:
        self.ends = dict(ends or {})
        self.arrays: list[list[str]] = []
        self.settings: list[SlurmSettings] = []
        self.environments: list[Mapping[str, str]] = []
        self.cancelled: list[str] = []
        self.state_of: dict[str, SlurmState] = {}

    def submit(
        self,
        keys: Sequence[str],
        folder: Path,
        settings: SlurmSettings,
        name: str,
        environment: Mapping[str, str],
    ) -> list[str]:
        number = len(self.arrays) + 1
        self.arrays.append(list(keys))
        self.settings.append(settings)
        self.environments.append(dict(environment))
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SLURM_ARRAY_JOB_ID", str(number))
            for task, key in enumerate(keys):
                patch.setenv("SLURM_ARRAY_TASK_ID", str(task))
                self.state_of[f"{number}_{task}"] = self.ends.get(task, SlurmState("COMPLETED"))
                if task not in self.ends:
                    ArrayTask(str(folder), key)()
        return [f"{number}_{task}" for task in range(len(keys))]

    def states(self, ids: Iterable[str]) -> dict[str, SlurmState] | None:
        return {one: self.state_of.get(one, SlurmState("UNKNOWN")) for one in ids}

    def cancel(self, ids: Sequence[str]) -> None:
        self.cancelled += ids
        for one in self.state_of:
            if one.split("_")[0] in ids:
                self.state_of[one] = SlurmState("CANCELLED")


def pretend(
    patch: pytest.MonkeyPatch, ends: Mapping[int, SlurmState] | None = None, module: ModuleType = array_task
) -> PretendedSlurm:
    """Put a pretended Slurm into the place of a real one."""
    slurm = PretendedSlurm(ends)
    patch.setattr(module, "submit", slurm.submit)
    patch.setattr(module, "require_submitit", lambda: None)
    patch.setattr(slurm_queue, "require_slurm", lambda: None)
    patch.setattr(slurm_queue, "states", slurm.states)
    patch.setattr(slurm_queue, "cancel", slurm.cancel)
    patch.setattr(slurm_launcher, "LATE_S", 0.0)
    return slurm
