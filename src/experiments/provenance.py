"""What a run says of the machine, code and packages it ran with, and whether its process still lives."""

from __future__ import annotations

import json
import os
import platform
import socket
import subprocess
import time
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import psutil

# A run on another machine that has not said anything for this long is taken for dead.
SILENCE_S = 20 * 60.0
# MLflow's own name for it.
COMMIT_TAG = "mlflow.source.git.commit"
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
    """What a run must say of the machine, the code and the packages it ran with."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {
        "ctus.packages": json.dumps(versions),
        "ctus.machine": f"{socket.gethostname()}, {platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "ctus.python": platform.python_version(),
        "ctus.host": socket.gethostname(),
        "ctus.pid": str(os.getpid()),
        "ctus.process_started": f"{psutil.Process().create_time():.2f}",
        **_git_tags(),
    }


def _git_tags() -> dict[str, str]:
    """The commit of the code that runs, wherever its results go; nothing for an installed package."""
    code = Path(__file__).resolve()

    def git(*words: str) -> str | None:
        try:
            answer = subprocess.run(
                ["git", "-C", str(code.parent), *words], capture_output=True, text=True, timeout=10
            )
        except (OSError, subprocess.TimeoutExpired):
            return None
        return answer.stdout.strip() if answer.returncode == 0 else None

    # A package installed below somebody's own repository is not part of it.
    if git("ls-files", "--error-unmatch", code.name) is None or (commit := git("rev-parse", "HEAD")) is None:
        return {}
    return {
        COMMIT_TAG: commit,
        "ctus.git_dirty": str(bool(git("status", "--porcelain"))).lower(),
    }


def is_gone(tags: Mapping[str, str]) -> bool:
    """Whether the process of a run that is marked as running has ended, judged by the run's tags.

    On the same machine the process id and its start decide, elsewhere the age of the last heartbeat.
    """
    if tags.get("ctus.host") == socket.gethostname() and "ctus.pid" in tags:
        try:
            process = psutil.Process(int(tags["ctus.pid"]))
        except psutil.NoSuchProcess:
            return True
        # The system gives a process id out again: the same id started at another time is another process.
        return abs(process.create_time() - float(tags.get("ctus.process_started", "0"))) > 1.0
    return time.time() - float(tags.get("ctus.heartbeat", "0")) > SILENCE_S
