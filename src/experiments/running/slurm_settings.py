"""What a job asks Slurm for, and the same in the words of submitit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from experiments.errors import InputError

# Slurm may send the warning up to a minute earlier than asked for.
WARNING_S = 90
# Long names of sbatch. What stands in a script's line must stay in it: a line of its own would be run by the shell.
_OPTION = re.compile(r"[a-z][a-z0-9-]*")
_VALUE = re.compile(r"[\w.,:;/@%+=*&|()\[\]~!^ -]*")
# Set by the launcher itself, or by a setting of its own.
_OWN = {
    "partition": "partition",
    "account": "account",
    "qos": "qos",
    "time": "timeout_min",
    "cpus-per-task": "cpus",
    "mem": "memory_gb",
    "gpus-per-node": "gpus",
    "array": "array_parallelism",
    "requeue": "requeue",
    "no-requeue": "requeue",
    **dict.fromkeys(("chdir", "error", "export", "export-file", "get-user-env", "input", "job-name"), ""),
    **dict.fromkeys(
        ("nodes", "ntasks", "ntasks-per-node", "open-mode", "output", "signal", "wait", "wrap"), ""
    ),
}


@dataclass(frozen=True)
class SlurmSettings:
    """What every job of a call asks Slurm for.

    Parameters
    ----------
    partition, account, qos : str or None, optional
        Names that the cluster knows; None for its own default.
    timeout_min : int, optional
        Minutes after which Slurm ends a job.
    cpus : int, optional
        Cores of a job.
    memory_gb : float, optional
        Memory of a job in GB.
    gpus : int, optional
        GPUs of a job.
    array_parallelism : int, optional
        Jobs at the same time.
    array_size : int, optional
        Jobs of one array.
    requeue : bool, optional
        Whether a job is queued again that was preempted or whose node failed.
    timeout_requeues : int, optional
        How often a job is queued again that ran out of time.
    poll_s : float, optional
        Time between two looks at the queue in s.
    sbatch : mapping of str to Any or None, optional
        Further options of sbatch by their long names; true for one that has no value. None for none.

    Raises
    ------
    InputError
        If a setting is out of range or an option may not be set.
    """

    partition: str | None = None
    account: str | None = None
    qos: str | None = None
    timeout_min: int = 240
    cpus: int = 4
    memory_gb: float = 16.0
    gpus: int = 0
    array_parallelism: int = 64
    array_size: int = 1000
    requeue: bool = True
    timeout_requeues: int = 0
    poll_s: float = 5.0
    sbatch: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name in ("timeout_min", "cpus", "array_parallelism", "array_size"):
            if getattr(self, name) < 1:
                raise InputError(f"launcher.{name}: expected at least 1, received {getattr(self, name)}")
        for name in ("gpus", "timeout_requeues"):
            if getattr(self, name) < 0:
                raise InputError(
                    f"launcher.{name}: expected a whole number from 0, received {getattr(self, name)}"
                )
        for name in ("memory_gb", "poll_s"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(
                    f"launcher.{name}: expected a positive number, received {getattr(self, name)}"
                )
        if self.timeout_requeues and not self.requeue:
            raise InputError("launcher.timeout_requeues: expected 0 with requeue=false, received more")
        for name in ("partition", "account", "qos"):
            if (value := getattr(self, name)) is not None:
                _require_line(f"launcher.{name}", value)
        for name, value in (self.sbatch or {}).items():
            _require_option(str(name), value)

    def parameters(self, name: str) -> dict[str, Any]:
        """Give the settings by the names that submitit has for them.

        Parameters
        ----------
        name : str
            Name of the jobs in the queue.

        Returns
        -------
        dict of str to Any
            Arguments of ``submitit.SlurmExecutor.update_parameters``.
        """
        more: dict[str, Any] = {"requeue" if self.requeue else "no-requeue": True, **(self.sbatch or {})}
        asked = {
            "partition": self.partition,
            "account": self.account,
            "qos": self.qos,
            "gpus_per_node": self.gpus or None,
        }
        return {
            **{key: value for key, value in asked.items() if value is not None},
            "job_name": re.sub(r"[^\w-]", "-", name),
            "time": self.timeout_min,
            "nodes": 1,
            "ntasks_per_node": 1,
            "cpus_per_task": self.cpus,
            "mem": f"{math.ceil(self.memory_gb * 1024)}M",
            "array_parallelism": self.array_parallelism,
            # Before the end of a short job there is less to be warned in.
            "signal_delay_s": min(WARNING_S, self.timeout_min * 6),
            "additional_parameters": more,
        }


def _require_option(name: str, value: Any) -> None:
    """Refuse an option of sbatch that is not one, that the launcher sets itself, or that would leave its line."""
    if not _OPTION.fullmatch(name):
        raise InputError(f"launcher.sbatch: expected long names of sbatch's options, received {name!r}")
    if name in _OWN:
        instead = f"; launcher.{_OWN[name]} sets it" if _OWN[name] else ""
        raise InputError(f"launcher.sbatch: expected none that the launcher sets, received {name}{instead}")
    if value is True:
        return
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(
            f"launcher.sbatch.{name}: expected a text, a number, or true for an option without a value, "
            f"received {value!r}"
        )
    _require_line(f"launcher.sbatch.{name}", str(value))


def _require_line(where: str, value: str) -> None:
    if not _VALUE.fullmatch(value):
        raise InputError(
            f"{where}: expected letters, digits and . , : ; / @ % + = * & | ( ) [ ] ~ ! ^ - or blanks, "
            f"received {value!r}"
        )
