"""Reading a file in a process of its own first, where the library may crash or never end over a broken one.

HDF5 checks little of what it follows: a changed byte can end the process, or keep it busy for good. What is read here
first has then been read once without harm, under a limit of time and memory.
"""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path

from registration.errors import InputError

TRIAL_S = 20
MEMORY_BYTES = 4 << 30
# Isolated, so that neither the current folder nor the environment decides what is imported.
_READ_TRANSFORM = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
import SimpleITK
SimpleITK.ReadTransform(sys.argv[1])
"""


def require_harmless_transform(path: Path) -> None:
    """Raise InputError unless another process can read a transform of ITK in reasonable time and memory.

    Parameters
    ----------
    path : Path
        File of a transform.

    Raises
    ------
    InputError
        If the process fails, crashes or does not end.
    """
    status = path.stat()
    _try(path.absolute(), path, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _try(place: Path, named: Path, _size: int, _changed_ns: int) -> None:
    """Once for each content of a file, as far as its size and time tell."""
    command = [sys.executable, "-I", "-c", _READ_TRANSFORM, str(place), str(MEMORY_BYTES)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=TRIAL_S, check=False)
    except subprocess.TimeoutExpired as failure:
        raise InputError(
            f"{named}: expected a transform that is read within {TRIAL_S} s, received a file that keeps its reader busy"
        ) from failure
    if done.returncode:
        how = "crashes" if done.returncode < 0 else "cannot be read as one"
        raise InputError(f"{named}: expected a complete ITK transform, received a file that {how}")
