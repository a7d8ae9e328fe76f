"""What a run says of the machine, code and packages it ran with, and whether its process still lives."""

from __future__ import annotations

import getpass
import json
import os
import platform
import socket
import subprocess
import time
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import psutil

# A run on another machine that has sent no sign of life for this long counts as ended.
SILENCE_S = 20 * 60.0
# A process that lives beats every half minute.
SHORT_SILENCE_S = 2 * 60.0
# MLflow's own name for it.
COMMIT_TAG = "mlflow.source.git.commit"
USER_TAG = "mlflow.user"
PID_TAG = "ctus.pid"
# Id of the job of Slurm that a run was computed in.
SLURM_TAG = "ctus.slurm_job"
_PACKAGES = (
    "ctus",
    "torch",
    "lightning",
    "numpy",
    "scipy",
    "scikit-learn",
    "open3d",
    "monai",
    "mlflow",
    "hydra-core",
)


def environment_tags() -> dict[str, str]:
    """Describe the machine, the code and the packages that a run uses.

    Returns
    -------
    dict
        Tags of the run, those of ``process_tags`` among them; the commit is absent for an installed package.
    """
    return {
        "ctus.packages": json.dumps(_versions()),
        "ctus.machine": ", ".join(
            [
                socket.gethostname(),
                f"{platform.system()} {platform.machine()}",
                f"{os.cpu_count()} CPUs",
                *gpu_names(),
            ]
        ),
        "ctus.python": platform.python_version(),
        USER_TAG: _user(),
        **process_tags(),
        **git_tags(Path(__file__).resolve()),
    }


@cache
def _versions() -> dict[str, str]:
    """The versions of the packages that numbers depend on; what a process has loaded does not change."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a container's user without a name
        return str(os.getuid()) if hasattr(os, "getuid") else "unknown"


def process_tags() -> dict[str, str]:
    """Describe the process that writes a run, and the time of its last heartbeat.

    Returns
    -------
    dict
        Tags of the run, by which ``is_gone`` decides.
    """
    return {
        "ctus.host": socket.gethostname(),
        PID_TAG: str(os.getpid()),
        "ctus.pid_space": _pid_space(),
        "ctus.process_started": f"{psutil.Process().create_time():.2f}",
        "ctus.heartbeat": f"{time.time():.0f}",
        **_slurm_tags(),
    }


def _slurm_tags() -> dict[str, str]:
    array, task = os.environ.get("SLURM_ARRAY_JOB_ID"), os.environ.get("SLURM_ARRAY_TASK_ID")
    identity = f"{array}_{task}" if array and task else os.environ.get("SLURM_JOB_ID", "")
    return {SLURM_TAG: identity} if identity else {}


def _pid_space() -> str:
    """Where process ids mean the same: this boot of this kernel and, on Linux, this container; empty elsewhere."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {Path('/proc/self/ns/pid').readlink()}"
    except OSError:
        return ""


@cache
def gpu_names() -> list[str]:
    """List the GPUs of this machine.

    Returns
    -------
    list of str
        Their names, by NVIDIA's own tool: torch would take seconds to import for those who do without.
    """
    words = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    try:
        finished = subprocess.run(words, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return []
    return finished.stdout.split("\n")[:-1] if finished.returncode == 0 else []


@cache
def git_tags(code: Path) -> dict[str, str]:
    """Name the commit of the code that runs, wherever its results go.

    Asked once: a process runs the code that it has loaded, also where another commit is checked out meanwhile.

    Parameters
    ----------
    code : Path
        A file of the code.

    Returns
    -------
    dict
        Tags of the run; none for an installed package.
    """

    def git(*words: str) -> str | None:
        try:
            finished = subprocess.run(
                ["git", "-C", str(code.parent), *words], capture_output=True, text=True, timeout=10
            )
        except (OSError, subprocess.TimeoutExpired):
            return None
        return finished.stdout.strip() if finished.returncode == 0 else None

    # A package installed below somebody's own repository is not part of it.
    if git("ls-files", "--error-unmatch", code.name) is None or (commit := git("rev-parse", "HEAD")) is None:
        return {}
    return {
        COMMIT_TAG: commit,
        "ctus.git_dirty": str(bool(git("status", "--porcelain"))).lower(),
    }


def running_commit() -> str:
    """Name the commit of the code that runs, to be asked for before a long run.

    Returns
    -------
    str
        Its first 12 digits, and whether files had changed since; empty for an installed package.
    """
    tags = git_tags(Path(__file__).resolve())
    if COMMIT_TAG not in tags:
        return ""
    return tags[COMMIT_TAG][:12] + (" with changes" if tags["ctus.git_dirty"] == "true" else "")


def is_gone(tags: Mapping[str, str]) -> bool:
    """Tell whether the process of a run that is marked as running has ended.

    Where the process's id can be looked up, the id and the start time decide; on another machine, in another
    container or before another boot, where the id means nothing, the age of the last heartbeat.

    Parameters
    ----------
    tags : Mapping[str, str]
        Tags of the run.

    Returns
    -------
    bool
        True if the process has ended.
    """
    silence_s = time.time() - _number(tags.get("ctus.heartbeat"))
    pid = tags.get(PID_TAG, "")
    if not (pid.isdecimal() and tags.get("ctus.host") == socket.gethostname() and _in_this_pid_space(tags)):
        return silence_s > SILENCE_S
    try:
        process = psutil.Process(int(pid))
        if process.status() == psutil.STATUS_ZOMBIE:
            return True
        started = process.create_time()
    except psutil.NoSuchProcess:
        return True
    except psutil.AccessDenied:
        return silence_s > SILENCE_S
    # The system gives a process id out again: the same id started at another time is another process. But a clock
    # that was set moves the start that the system tells, and then the run still beats.
    other = abs(started - _number(tags.get("ctus.process_started"))) > 1.0
    return other and silence_s > SHORT_SILENCE_S


def _in_this_pid_space(tags: Mapping[str, str]) -> bool:
    # Runs of earlier versions do not say it.
    recorded = tags.get("ctus.pid_space", "")
    return not recorded or recorded == _pid_space()


def _number(text: str | None) -> float:
    try:
        return float(text or 0)
    except ValueError:
        return 0.0
