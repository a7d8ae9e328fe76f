"""Processor, memory, free disk and GPU, without importing torch."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import psutil

from experiments.command_line.doctor.findings import Finding, State

GIB = 2**30
# Below the first ctus can't be expected to work; below the second a study may fill the disk.
LEAST_FREE_GIB, FEW_FREE_GIB = 1.0, 10.0
_WAIT_S = 10.0


def processor() -> Finding:
    """Look at cores and memory.

    Returns
    -------
    Finding
        Cores that this process may use, and memory.
    """
    cores = len(psutil.Process().cpu_affinity() or []) if hasattr(psutil.Process, "cpu_affinity") else 0
    memory = psutil.virtual_memory()
    total, free = memory.total / GIB, memory.available / GIB
    text = f"{cores or psutil.cpu_count() or 1} cores, {total:.0f} GiB memory, {free:.0f} free"
    return Finding("processor", State.OK, text)


def free_disk(folder: Path) -> Finding:
    """Look at the room on the disk of a folder.

    Parameters
    ----------
    folder : Path
        Folder of runs and outputs; it need not exist.

    Returns
    -------
    Finding
        Missing below 1 GiB, a note below 10 GiB.
    """
    there = next(each for each in (folder, *folder.parents) if each.exists())
    free = shutil.disk_usage(there).free / GIB
    text = f"{free:.1f} GiB free for runs and outputs under {folder}"
    if free < LEAST_FREE_GIB:
        return Finding("disk", State.MISSING, text, "CTUS_HOME=<folder on another disk>")
    return Finding("disk", State.OK if free >= FEW_FREE_GIB else State.NOTE, text)


def gpu() -> Finding:
    """Look for an NVIDIA GPU by ``nvidia-smi``, and for a build of torch that can use it.

    Returns
    -------
    Finding
        A note where a GPU can't be used; having none is no fault.
    """
    cards, build = _cards(), torch_build()
    if cards and build == "":
        line = f"{sys.executable} -m pip install --force-reinstall torch"
        return Finding("GPU", State.NOTE, f"{cards}, but torch is built for the processor alone", line)
    if cards:
        return Finding(
            "GPU", State.OK, f"{cards}; torch is built for {build or 'an unknown GPU'}; trainer=gpu"
        )
    if platform.system() == "Darwin" and platform.machine() == "arm64":
        return Finding("GPU", State.OK, "none of NVIDIA's; trainer=cpu (Apple's GPU is not tested)")
    return Finding("GPU", State.OK, "none; trainer=cpu trains on the processor, all else needs none")


def torch_build() -> str | None:
    """Read what GPU the installed torch is built for from the file that says so.

    Returns
    -------
    str or None
        ``CUDA 12.8`` or ``ROCm 6.4``; empty for a build for the processor alone, None if that can't be told.
    """
    try:
        path = metadata.distribution("torch").locate_file("torch/version.py")
        text = Path(str(path)).read_text(encoding="utf-8")
    except (metadata.PackageNotFoundError, OSError):
        return None
    for name, shown in (("cuda", "CUDA"), ("hip", "ROCm")):
        if found := re.search(rf"^{name}\b[^=]*= *['\"]([\d.]+)", text, re.MULTILINE):
            return f"{shown} {found[1]}"
    return ""


def _cards() -> str:
    """Names and memory of the cards; empty if there are none or their driver does not answer."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return ""
    words = [program, "--query-gpu=name,memory.total", "--format=csv,noheader"]
    try:
        ended = subprocess.run(words, capture_output=True, text=True, timeout=_WAIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return "; ".join(ended.stdout.strip().splitlines()) if ended.returncode == 0 else ""
