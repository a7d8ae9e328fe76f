"""What a job costs: seconds, core-seconds, memory, and energy where the machine tells it.

The values are tags of its run, not metrics: they differ each time that the same is computed.
"""

from __future__ import annotations

import ctypes
import os
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

TAG = "ctus.cost."
SAMPLED_EVERY_S = 2.0
POWERCAP = Path("/sys/class/powercap")
_MEGABYTE = 2**20


@dataclass(frozen=True)
class Cost:
    """What a job has needed.

    Parameters
    ----------
    seconds : float
        Wall-clock time in s.
    core_seconds : float
        Time on processors in s, user and system, of the process and of its children that have ended.
    peak_memory_mb : float
        Highest resident memory in MiB of the process with its children, sampled every two seconds; of the process
        alone without gaps. Pages that processes share count for each.
    cpu_energy_j, gpu_energy_j : float or None, optional
        Energy in J of all processors and of all GPUs of the machine; None where the machine does not tell, or where
        other jobs of the call ran at the same time.
    """

    seconds: float
    core_seconds: float
    peak_memory_mb: float
    cpu_energy_j: float | None = None
    gpu_energy_j: float | None = None

    def tags(self) -> dict[str, str]:
        """The tags of a run.

        Returns
        -------
        dict of str to str
            A value by each tag's name; none for an unknown energy.

        Examples
        --------
        >>> Cost(1.5, 3.0, 200.0).tags()
        {'ctus.cost.seconds': '1.5', 'ctus.cost.core_seconds': '3', 'ctus.cost.peak_memory_mb': '200'}
        """
        return {f"{TAG}{name}": f"{value:.6g}" for name, value in self.__dict__.items() if value is not None}


def of_tags(tags: Mapping[str, str]) -> Cost | None:
    """Read what ``Cost.tags`` wrote.

    Parameters
    ----------
    tags : Mapping[str, str]
        Tags of a run.

    Returns
    -------
    Cost or None
        The cost; None for a run that has none.
    """
    found = {name.removeprefix(TAG): float(value) for name, value in tags.items() if name.startswith(TAG)}
    try:
        return Cost(**found)
    except TypeError:  # a run of before
        return None


def total(costs: Sequence[Cost | None]) -> Cost | None:
    """Add the costs of several jobs.

    Parameters
    ----------
    costs : sequence of Cost or None
        The cost of each job.

    Returns
    -------
    Cost or None
        Sums, and the highest memory of any; no energy unless each has one. None where a job's cost is unknown, because
        a sum of the others would be too low.
    """
    known = [each for each in costs if each is not None]
    if not known or len(known) < len(costs):
        return None
    return Cost(
        sum(each.seconds for each in known),
        sum(each.core_seconds for each in known),
        max(each.peak_memory_mb for each in known),
        _sum([each.cpu_energy_j for each in known]),
        _sum([each.gpu_energy_j for each in known]),
    )


def _sum(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


class Meter:
    """Measures from when it is made until ``cost`` is asked for.

    Parameters
    ----------
    alone : bool, optional
        Whether no other job of the call runs at the same time, so that the machine's energy is that of this one.
    """

    def __init__(self, *, alone: bool = True) -> None:
        self._energy_j = (cpu_energy_j(), gpu_energy_j()) if alone else (None, None)
        _reset_peak()
        self._begun_s = time.perf_counter()
        self._cores_s = _core_seconds()
        self._sampled = resident_bytes()
        self._ended = threading.Event()
        threading.Thread(target=self._sample, daemon=True, name="memory").start()

    def cost(self) -> Cost:
        """Give the cost so far.

        Returns
        -------
        Cost
            The cost since the meter was made.
        """
        cpu_j, gpu_j = self._energy_j
        return Cost(
            time.perf_counter() - self._begun_s,
            _core_seconds() - self._cores_s,
            max(self._sampled, _peak_bytes(), resident_bytes()) / _MEGABYTE,
            None if cpu_j is None else _used(cpu_j, cpu_energy_j()),
            None if gpu_j is None else _used(gpu_j, gpu_energy_j()),
        )

    def stop(self) -> None:
        """End the sampling."""
        self._ended.set()

    def _sample(self) -> None:
        while not self._ended.wait(SAMPLED_EVERY_S):
            self._sampled = max(self._sampled, resident_bytes())


@contextmanager
def metered(*, alone: bool) -> Iterator[Meter]:
    """Measure a block.

    Parameters
    ----------
    alone : bool
        Whether no other job of the call runs at the same time.

    Yields
    ------
    Meter
        What tells the cost, inside the block and after it.
    """
    meter = Meter(alone=alone)
    try:
        yield meter
    finally:
        meter.stop()


def resident_bytes() -> int:
    """Resident memory of this process and all processes below it.

    Returns
    -------
    int
        Bytes.
    """
    found = 0
    own = psutil.Process()
    for process in [own, *own.children(recursive=True)]:
        with suppress(psutil.Error):  # it has ended
            found += process.memory_info().rss
    return found


def _core_seconds() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _reset_peak() -> None:
    # The kernel's own mark is of the whole life of the process, which may have run other jobs.
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def _peak_bytes() -> int:
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration):
        return 0


def _used(before_j: float, now_j: float | None) -> float | None:
    # A counter that has begun anew in between tells nothing.
    return None if now_j is None or now_j < before_j else now_j - before_j


def cpu_energy_j() -> float | None:
    """What the counters of all processor packages show (RAPL).

    Returns
    -------
    float or None
        J since some time in the past; None where there is no counter, or it is not for this user to read.
    """
    counters = [
        path / "energy_uj"
        for path in sorted(POWERCAP.glob("*-rapl:*"))
        if path.name.count(":") == 1 and "mmio" not in path.name
    ]
    try:
        return sum(int(path.read_text()) for path in counters) / 1e6 if counters else None
    except (OSError, ValueError):
        return None


def gpu_energy_j() -> float | None:
    """What the counters of all NVIDIA GPUs show, by the driver's own library (NVML).

    Returns
    -------
    float or None
        J since the driver was loaded; None where there is no GPU, or one does not tell.
    """
    library = _nvml()
    if library is None:
        return None
    try:
        count, used_mj = ctypes.c_uint(), 0
        library.nvmlDeviceGetCount_v2(ctypes.byref(count))
        for number in range(count.value):
            card, own_mj = ctypes.c_void_p(), ctypes.c_ulonglong()
            library.nvmlDeviceGetHandleByIndex_v2(number, ctypes.byref(card))
            if library.nvmlDeviceGetTotalEnergyConsumption(card, ctypes.byref(own_mj)) != 0:
                return None
            used_mj += own_mj.value
        return used_mj / 1000 if count.value else None
    finally:
        library.nvmlShutdown()


def _nvml() -> Any:
    """The driver's library, ready to be asked; None where there is no driver."""
    try:
        library = ctypes.CDLL("libnvidia-ml.so.1")
        return library if library.nvmlInit_v2() == 0 else None
    except (OSError, AttributeError):
        return None
